"""The page over HTTP: some files from memory and one socket."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator
from contextlib import suppress
from importlib import resources
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from acquire.page.commands import COMMAND, MAX_COMMAND_BYTES, Helm, Ready, Region
from acquire.page.hub import Hub
from acquire.page.patience import UNREAD_LIMIT_S
from acquire.page.state import Setting
from acquire.page.viewer import Viewer
from acquire.validation import explain

MAX_VIEWERS = 16
MAX_MISTAKES = 10
POLICY_VIOLATION, TRY_AGAIN_LATER = 1008, 1013
TYPES: Final = {"css": "text/css", "js": "text/javascript", "svg": "image/svg+xml"}
FILES: Final = (
    "page.css",
    "page.js",
    "picture.js",
    "beside.js",
    "panels.js",
    "line.js",
    "icon.svg",
)


def application(hub: Hub) -> Starlette:
    """The page of a hub; nothing it serves is read from the disk after this call."""
    folder = resources.files("acquire.page").joinpath("static")
    files = {name: folder.joinpath(name).read_bytes() for name in FILES}
    page = _page(hub.setting).encode()

    async def front(_: Request) -> Response:
        return Response(page, media_type="text/html")

    async def file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in files:
            return PlainTextResponse("there is no such thing\n", status_code=404)
        return Response(files[name], media_type=TYPES[name.rpartition(".")[2]])

    async def socket(websocket: WebSocket) -> None:
        await _attend(hub, websocket)

    return Starlette(
        routes=[
            Route("/", front),
            WebSocketRoute("/socket", socket),
            Route("/{name}", file),
        ]
    )


def _page(setting: Setting) -> str:
    environment = Environment(
        loader=PackageLoader("acquire.page", "static"), autoescape=True, undefined=StrictUndefined
    )
    patterns = (
        dict.fromkeys(str(pattern) for pattern in setting.plan.patterns) if setting.plan else {}
    )
    return environment.get_template("page.html.jinja").render(
        setting=setting, patterns=[text for text in patterns if ":" in text]
    )


async def _attend(hub: Hub, websocket: WebSocket) -> None:
    """One browser, from its coming to its going."""
    if len(hub.viewers) >= MAX_VIEWERS or hub.ended:
        await websocket.close(TRY_AGAIN_LATER)
        return
    await websocket.accept()
    viewer = hub.join()
    telling = asyncio.create_task(_tell(hub, viewer, websocket))
    listening = asyncio.create_task(_listen(hub, viewer, websocket))
    try:
        await asyncio.wait({telling, listening}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        hub.leave(viewer)
        for task in (telling, listening):
            task.cancel()
        results = await asyncio.gather(telling, listening, return_exceptions=True)
    for error in results:
        if isinstance(error, Exception):
            raise error


async def _tell(hub: Hub, viewer: Viewer, websocket: WebSocket) -> None:
    """Send what is new, as fast as this browser takes it; what is old by then is not sent."""
    with suppress(WebSocketDisconnect, TimeoutError):
        await _keep_telling(hub, viewer, websocket)


async def _keep_telling(hub: Hub, viewer: Viewer, websocket: WebSocket) -> None:
    while True:
        await viewer.news.wait()
        viewer.news.clear()
        async for message in _news(hub, viewer):
            # Who takes nothing holds neither a place nor the command.
            async with asyncio.timeout(UNREAD_LIMIT_S):
                if isinstance(message, str):
                    await websocket.send_text(message)
                else:
                    await websocket.send_bytes(message)
        if hub.ended:
            await websocket.close()
            return


async def _news(hub: Hub, viewer: Viewer) -> AsyncIterator[str | bytes]:
    """What this viewer does not have yet."""
    state = await hub.state_for(viewer)
    if state != viewer.state:
        viewer.state = state
        yield state
    if (life := hub.life_for(viewer)) is not None:
        yield life
    if viewer.ready and (picture := await hub.picture_for(viewer)) is not None:
        viewer.ready = False
        yield picture
    if (comparison := hub.comparison_for(viewer)) is not None:
        yield comparison
    if (raster := await hub.projector_for(viewer)) is not None:
        yield raster


async def _listen(hub: Hub, viewer: Viewer, websocket: WebSocket) -> None:
    mistakes = 0
    with suppress(WebSocketDisconnect):
        while mistakes < MAX_MISTAKES:
            message = await websocket.receive()
            text = message.get("text")
            if message["type"] == "websocket.disconnect":
                return
            # A page of ours sends neither bytes, nor long messages, nor many of them.
            if text is None or len(text) > MAX_COMMAND_BYTES:
                break
            if not viewer.may_ask(time.monotonic()):
                break
            refusal = _obey(hub, viewer, text)
            if refusal:
                mistakes += 1
                await websocket.send_text(json.dumps({"kind": "refused", "why": refusal}))
        await websocket.close(POLICY_VIOLATION)


def _obey(hub: Hub, viewer: Viewer, text: str) -> str:
    """Carry out a message of a browser; why not, or nothing."""
    try:
        command = COMMAND.validate_json(text)
    except ValidationError as error:
        return f"not understood:\n{explain(error)}"
    match command:
        case Ready():
            viewer.ready = True
            viewer.news.set()
        case Region(box=box):
            viewer.box = box
            viewer.news.set()
        case Helm():
            hub.steer(viewer, command)
        case _:
            if not hub.command(viewer, command):
                return "You are watching; take control first."
    return ""
