"""The process that serves the page: ``python -m acquire.page.process LISTENING CHANNEL``.

Both arguments are descriptors that the parent has opened. It ends when the channel does.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import threading
from contextlib import suppress

import cv2
import uvicorn

from acquire.page.commands import MAX_COMMAND_BYTES
from acquire.page.guard import Guard
from acquire.page.hub import Hub
from acquire.page.patience import ImpatientProtocol, let_go_of_deaf
from acquire.page.server import application
from acquire.page.state import SETTING
from drivers.window_channel import Channel, Message

NICENESS = 10  # a capture on the same computer goes first
SETTING_LIMIT_S = 30.0
LOOK_S = 1.0
# At most, until every browser has been told that the work has ended. The desk waits longer.
GOODBYE_S = 2.0
GLANCE_S = 0.02
MAX_CONNECTIONS = 64


def main(listening_descriptor: int, channel_descriptor: int) -> None:
    """Serve until the channel ends."""
    with suppress(OSError):
        os.nice(NICENESS)
    cv2.setNumThreads(1)
    listening = socket.socket(fileno=listening_descriptor)
    channel = Channel(socket.socket(fileno=channel_descriptor))
    first = channel.receive(SETTING_LIMIT_S)
    if first is not None:
        asyncio.run(_serve(listening, channel, first))


async def _serve(listening: socket.socket, channel: Channel, first: Message) -> None:
    hub = Hub(
        SETTING.validate_json(first.data), lambda text: channel.send(Message("command", text))
    )
    let_go_of_deaf(listening)
    port: int = listening.getsockname()[1]
    server = uvicorn.Server(
        uvicorn.Config(
            Guard(application(hub), port, first.text),
            loop="asyncio",
            http=ImpatientProtocol,
            ws="websockets-sansio",
            ws_max_size=MAX_COMMAND_BYTES,
            ws_per_message_deflate=False,
            lifespan="off",
            log_level="warning",
            access_log=False,  # it would hold the token
            server_header=False,
            proxy_headers=False,
            limit_concurrency=MAX_CONNECTIONS,
            timeout_keep_alive=30,
            timeout_graceful_shutdown=2,
        )
    )
    work = [asyncio.create_task(hub.tick()), asyncio.create_task(hub.develop())]
    threading.Thread(
        target=_hear, args=(asyncio.get_running_loop(), channel, hub, server), daemon=True
    ).start()
    try:
        await server.serve(sockets=[listening])
    finally:
        for task in work:
            task.cancel()
        hub.close()


def _hear(
    loop: asyncio.AbstractEventLoop, channel: Channel, hub: Hub, server: uvicorn.Server
) -> None:
    """Always take what the desk sends, so that it never waits."""
    with suppress(EOFError, OSError, RuntimeError):
        while True:
            message = channel.receive(LOOK_S)
            if message is not None:
                loop.call_soon_threadsafe(hub.hear, message)
    with suppress(RuntimeError):  # the loop may have ended before
        loop.call_soon_threadsafe(_say_goodbye, loop, hub, server)


def _say_goodbye(loop: asyncio.AbstractEventLoop, hub: Hub, server: uvicorn.Server) -> None:
    hub.end()
    latest_s = loop.time() + GOODBYE_S

    def leave() -> None:
        if hub.viewers and loop.time() < latest_s:
            loop.call_later(GLANCE_S, leave)
        else:
            server.should_exit = True

    leave()


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
