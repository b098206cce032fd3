"""Joins the desk with the browsers: what is known to all of them, commands of one of them."""

from __future__ import annotations

import asyncio
import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from acquire.errors import LumisplitError
from acquire.page.chart import shown_raster
from acquire.page.commands import BENCH_COMMAND, BenchCommand
from acquire.page.commands import Helm as HelmCommand
from acquire.page.comparison import SPAN
from acquire.page.darkroom import Box, Negative, Print, negative, printed, printed_raster
from acquire.page.helm import Helm
from acquire.page.session_view import LastFrame, SessionView
from acquire.page.state import SNAPSHOT, Activity, Setting, Snapshot
from acquire.page.viewer import Viewer, packed, packed_print
from acquire.plan import ProjectorPlan
from drivers.errors import DriverError
from drivers.window_channel import Message

TICK_S = 1.0
LIVE_EVERY_S, FRAME_EVERY_S = 0.05, 0.5
NOTES_SHOWN = 20


class Hub:
    """Everything that the page's process knows; used from its event loop only.

    Parameters
    ----------
    setting
        What never changes.
    command
        Sends a command to the desk.
    """

    def __init__(self, setting: Setting, command: Callable[[str], None]) -> None:
        self.setting, self.snapshot = setting, Snapshot()
        self.viewers: dict[int, Viewer] = {}
        self.ended = False
        self._command, self._helm, self._count = command, Helm(), 0
        self._session: SessionView | None = None
        self._session_path: str | None = None
        self._darkroom = ThreadPoolExecutor(1, thread_name_prefix="darkroom")
        self._arrived: Message | None = None
        self._work = asyncio.Event()
        self._picture: tuple[int, Negative, dict[str, Any]] | None = None
        self._prints: dict[Box | None, Print] = {}
        self._comparison: tuple[int, bytes] | None = None
        self._trouble = ""
        self._heard_s = time.monotonic()
        self._free_bytes: int | None = None

    def hear(self, message: Message) -> None:
        """Take a message from the desk."""
        self._heard_s = time.monotonic()
        if message.kind == "picture":
            self._arrived = message
            self._work.set()
            return
        self.snapshot = SNAPSHOT.validate_json(message.text)
        self._turn_to(self.snapshot.session)
        self._work.set()
        self._tell_all()

    def _turn_to(self, path: str | None) -> None:
        """Look at another session from now on."""
        if path == self._session_path:
            return
        self._session_path = path
        self._session = None if path is None else SessionView(Path(path), self.setting)

    def end(self) -> None:
        """The desk is gone."""
        self.ended = True
        self._tell_all()

    def join(self) -> Viewer:
        """A browser has come."""
        self._count += 1
        viewer = Viewer(self._count)
        self.viewers[viewer.number] = viewer
        self._helm = self._helm.joined(viewer.number)
        self._work.set()
        self._tell_all()
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """A browser has gone."""
        self.viewers.pop(viewer.number, None)
        self._helm = self._helm.left(viewer.number)
        self._tell_all()

    def steer(self, viewer: Viewer, command: HelmCommand) -> None:
        """Change who commands."""
        number, helm = viewer.number, self._helm
        match command.do:
            case "take" | "ask":
                self._helm = helm.asked(number, time.monotonic())
            case "hand-over" | "keep":
                self._helm = helm.answered(number, hand_over=command.do == "hand-over")
            case "leave":
                self._helm = helm.given_up(number)
        self._tell_all()

    def command(self, viewer: Viewer, command: BenchCommand) -> bool:
        """Pass a command on; False from a viewer who only watches."""
        if viewer.number != self._helm.holder:
            return False
        self._command(BENCH_COMMAND.dump_json(command).decode())
        return True

    async def tick(self) -> None:
        """Once a second: who commands, the disk, a sign of life; as long as the page is served."""
        while True:
            self._helm = self._helm.at(time.monotonic())
            self._work.set()  # a frame that was taken again is not told of
            if self._session_path:
                folder = Path(self._session_path)
                there = next(path for path in (folder, *folder.parents) if path.exists())
                with suppress(OSError):
                    self._free_bytes = shutil.disk_usage(there).free
            for viewer in self.viewers.values():
                viewer.is_due = True
            self._tell_all()
            await asyncio.sleep(TICK_S)

    async def develop(self) -> None:
        """Decode what came last, whenever somebody looks; what came between is dropped."""
        while True:
            await self._work.wait()
            self._work.clear()
            if not self.viewers:
                continue
            await asyncio.sleep(await self._develop_newest())

    def life_for(self, viewer: Viewer) -> str | None:
        """A sign of life, with the time since the desk was heard; None when it is not due."""
        due, viewer.is_due = viewer.is_due, False
        silent_s = round(time.monotonic() - self._heard_s)
        return json.dumps({"kind": "alive", "silent_s": silent_s}) if due else None

    async def state_for(self, viewer: Viewer) -> str:
        """What this viewer is told, as JSON."""
        return json.dumps(self._state() | self._standing(viewer))

    async def picture_for(self, viewer: Viewer) -> bytes | None:
        """The newest picture as this viewer wants it; None when it has it."""
        if self._picture is None:
            return None
        number, picture, head = self._picture
        if viewer.picture == (number, viewer.box):
            return None
        box = viewer.box
        if box not in self._prints:
            loop = asyncio.get_running_loop()
            shown = await loop.run_in_executor(self._darkroom, printed, picture, box)
            if self._picture is not None and self._picture[0] == number:
                looked_at = {one.box for one in self.viewers.values()}
                self._prints = {old: self._prints[old] for old in looked_at & set(self._prints)}
                self._prints[box] = shown
        else:
            shown = self._prints[box]
        viewer.picture = number, box
        viewer.pattern = head["frame"]["pattern"] if head["frame"] else ""
        width, height = picture.size_px
        return packed_print({"kind": "picture", "size": [width, height], **head}, shown)

    def comparison_for(self, viewer: Viewer) -> bytes | None:
        """What the frame that this viewer sees should show; None when it has it."""
        if self._comparison is None or viewer.picture is None:
            return None
        number, message = self._comparison
        if viewer.picture[0] != number or viewer.compared == number:
            return None
        viewer.compared = number
        return message

    async def projector_for(self, viewer: Viewer) -> bytes | None:
        """What the projector shows, or what the last frame should; None when it has it."""
        what = viewer.pattern
        if self.snapshot.shown is not None:
            what = self.snapshot.shown.what
        if viewer.projector == what or not what:
            return None
        viewer.projector = what
        plan = self.setting.plan
        projector = plan.projector if plan else ProjectorPlan()
        draw = partial(_drawn, what, self.setting.projector_px, projector)
        file = await asyncio.get_running_loop().run_in_executor(self._darkroom, draw)
        return packed({"kind": "projector", "what": what}, file)

    def close(self) -> None:
        """Let the darkroom go."""
        self._darkroom.shutdown(wait=False, cancel_futures=True)

    def _tell_all(self) -> None:
        for viewer in self.viewers.values():
            viewer.news.set()

    def _standing(self, viewer: Viewer) -> dict[str, Any]:
        helm = self._helm
        return {
            "you": viewer.number,
            "viewers": len(self.viewers),
            "holder": helm.holder,
            "asking": helm.asking,
        }

    def _state(self) -> dict[str, Any]:
        progress, setting = self.snapshot.progress, self.setting
        state = asdict(self.snapshot)
        state["notes"] = state["notes"][-NOTES_SHOWN:]
        if progress is not None:
            missing = progress.total - progress.done
            state["progress"] |= {
                "frame_s": progress.frame_s,
                "left_s": progress.left_s,
                "needed_bytes": missing * setting.frame_bytes,
            }
        if self.ended:
            state["activity"] = Activity.ENDED
        state["session"] = Path(self._session_path).name if self._session_path else None
        return state | {
            "kind": "state",
            "free_bytes": self._free_bytes,
            "trouble": self._trouble,
        }

    async def _develop_newest(self) -> float:
        """Decode the newest; how long to leave the processor to others.

        After a frame of a session at least as long as it took: a capture may run beside.
        """
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        arrived, self._arrived = self._arrived, None
        session = self._session
        try:
            if arrived is not None:
                picture = await loop.run_in_executor(
                    self._darkroom, negative, arrived.text, arrived.data
                )
                self._hang(picture, None)
                return LIVE_EVERY_S
            if session is None:
                return LIVE_EVERY_S
            frame = await loop.run_in_executor(self._darkroom, session.newest)
            if frame is None:
                return LIVE_EVERY_S
            if session is self._session:
                self._hang(frame.picture, frame)
        except (LumisplitError, DriverError) as error:
            self._trouble = str(error)
            self._tell_all()
        return max(FRAME_EVERY_S, loop.time() - began_s)

    def _hang(self, picture: Negative, frame: LastFrame | None) -> None:
        """The newest picture: of a frame of the session, or only looked at."""
        number = 1 if self._picture is None else self._picture[0] + 1
        head = {"number": number, "frame": None if frame is None else frame.about}
        self._picture = number, picture, head
        self._comparison = None if frame is None else (number, _packed(number, frame))
        self._prints.clear()
        self._trouble = ""
        self._tell_all()


def _packed(number: int, frame: LastFrame) -> bytes:
    about = asdict(frame.comparison)
    files = about.pop("prediction"), about.pop("difference")
    return packed({"kind": "comparison", "number": number, "span": SPAN, **about}, *files)


def _drawn(what: str, projector_px: tuple[int, int], projector: ProjectorPlan) -> bytes:
    return printed_raster(shown_raster(what, projector_px, projector))
