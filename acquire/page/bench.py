"""The bench with a page: aiming, capturing and resting, in turn."""

from __future__ import annotations

import queue
import threading
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum, auto
from pathlib import Path
from typing import Protocol

from acquire.errors import LumisplitError
from acquire.page.aiming import Aiming
from acquire.page.capturing import CapturePage
from acquire.page.commands import BenchCommand, Order
from acquire.page.desk import Desk
from acquire.page.state import Activity
from acquire.plan import CameraPlan, Plan
from acquire.plan_file import BLACK
from acquire.recording import record
from acquire.rig import Bench, Resumption
from acquire.sequencer import Observer
from acquire.session import Session
from drivers.errors import DriverError

LOOK_S = 0.1

AIMING_PLAN = Plan(camera=CameraPlan(), patterns=(BLACK,))


class Display(Observer, Protocol):
    """How the terminal shows a capture."""

    def stage(self, name: str, total: int, done: int = 0) -> None:
        """A stage of `total` units begins, of which `done` are done already."""


@dataclass(frozen=True, slots=True)
class Job:
    """What may be captured from the page.

    Parameters
    ----------
    plan
        Whose patterns can be shown; None for only white, black and the chart.
    folder
        Where the plan is captured; None when it cannot be started.
    """

    plan: Plan | None = None
    folder: Path | None = None


class _Wish(Enum):
    AIM = auto()
    CAPTURE = auto()
    REST = auto()


class StopOfOne(threading.Event):
    """Set by itself, or with the program's."""

    def __init__(self, program: threading.Event) -> None:
        super().__init__()
        self._program = program

    def is_set(self) -> bool:
        """Whether to stop."""
        return super().is_set() or self._program.is_set()


class PagedBench:
    """Turns what the page wishes into work on the bench; `run` is the only one to use devices.

    Parameters
    ----------
    bench, job
        What to work on and with.
    desk
        Told of everything.
    display
        The terminal's, for a capture.
    stop
        Set when the program should end.
    """

    def __init__(
        self, bench: Bench, job: Job, desk: Desk, display: Display, stop: threading.Event
    ) -> None:
        self._bench, self._job, self._desk = bench, job, desk
        self._display, self._stop = display, stop
        self._wish = _Wish.AIM
        self._aiming: Aiming | None = None
        self._capture: CapturePage | None = None

    def obey(self, command: BenchCommand) -> None:
        """Take a command from the page; returns at once."""
        aiming, capture = self._aiming, self._capture
        if capture is not None:
            capture.obey(command)
        elif isinstance(command, Order):
            self._order(command)
        elif aiming is not None:
            with suppress(queue.Full):
                aiming.commands.put_nowait(command)
        else:
            self._desk.remark("The devices are let go: open the bench first.")

    def run(self) -> None:
        """Work until the program should stop."""
        while not self._stop.is_set():
            try:
                match self._wish:
                    case _Wish.AIM:
                        self._aim()
                    case _Wish.CAPTURE:
                        self._wish = _Wish.REST
                        self._do_capture()
                    case _Wish.REST:
                        self._rest()
            except (LumisplitError, DriverError) as error:
                self._wish = _Wish.REST
                self._desk.note(str(error), is_error=True)

    def _order(self, order: Order) -> None:
        match order.do:
            case "aim":
                self._wish = _Wish.AIM
            case "rest":
                self._wish = _Wish.REST
            case "start" if self._job.plan is not None and self._job.folder is not None:
                self._wish = _Wish.CAPTURE
            case "start":
                self._desk.remark("There is nothing to start: give a plan and --out.")
            case _:
                self._desk.remark("No plan is being captured.")

    def _aim(self) -> None:
        plan = self._job.plan or AIMING_PLAN
        self._desk.change(lambda snapshot: replace(snapshot, activity=Activity.OPENING))
        with self._bench.aim(Resumption(plan)) as devices:
            self._aiming = Aiming(
                devices,
                self._desk,
                plan.camera.settings,
                plan.projector.gamma,
                lambda: self._wish is _Wish.AIM and not self._stop.is_set(),
            )
            try:
                self._aiming.run()
            finally:
                self._aiming = None

    def _do_capture(self) -> None:
        plan, folder = self._job.plan, self._job.folder
        if plan is None or folder is None:
            return
        done = len(Session.open(folder).frames) if Session.exists(folder) else 0
        self._display.stage("capturing", len(plan), done)
        stop = StopOfOne(self._stop)
        self._capture = CapturePage(self._desk, self._display, stop, done, len(plan))
        try:
            session, outcome = record(
                plan, self._bench, folder, self._capture, stop, self._capture.pause
            )
            self._desk.note(f"{outcome}: {len(session.frames)} of {len(plan)} frames in {folder}")
        finally:
            self._capture = None

    def _rest(self) -> None:
        self._desk.change(
            lambda snapshot: replace(
                snapshot, activity=Activity.RESTING, shown=None, pausing=False, stopping=False
            )
        )
        while self._wish is _Wish.REST and not self._stop.wait(LOOK_S):
            pass
