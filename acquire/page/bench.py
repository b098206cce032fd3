"""The bench with a page: aiming, capturing and resting, in turn."""

from __future__ import annotations

import itertools
import queue
import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from pathlib import Path
from typing import Protocol

from acquire.errors import LumisplitError
from acquire.page.aiming import Aiming, first_view
from acquire.page.capturing import CapturePage
from acquire.page.commands import BenchCommand, Order
from acquire.page.desk import Desk
from acquire.page.state import Activity, CameraView, Progress, Source
from acquire.plan import CameraPlan, Plan
from acquire.plan_file import BLACK
from acquire.recording import record
from acquire.rig import Bench, Resumption
from acquire.sequencer import Observer, Outcome
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
    profiles
        Files of the profiles that the plan names, by kind; copies lie in the session afterwards.
    """

    plan: Plan | None = None
    folder: Path | None = None
    profiles: Mapping[str, Path] = field(default_factory=dict)


class _Wish(Enum):
    AIM = auto()
    CAPTURE = auto()
    CAPTURE_ANEW = auto()
    REST = auto()


def unused(folder: Path) -> Path:
    """The first folder beside one that does not exist yet: ``night-2`` beside ``night``."""
    names = (folder.with_name(f"{folder.name}-{count}") for count in itertools.count(2))
    return next(path for path in names if not path.exists())


def _done(folder: Path) -> int:
    return len(Session.open(folder).frames) if Session.exists(folder) else 0


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
        self._plan = job.plan or AIMING_PLAN
        self._folder = job.folder
        self._wish = _Wish.AIM
        self._view: CameraView | None = None
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
        self._look_into_session()
        while not self._stop.is_set():
            try:
                if self._wish is _Wish.REST:
                    self._rest()
                else:
                    self._work()
            except (LumisplitError, DriverError) as error:
                self._wish = _Wish.REST
                self._desk.note(str(error), is_error=True)

    def _order(self, order: Order) -> None:
        match order.do:
            case "aim":
                self._wish = _Wish.AIM
            case "rest":
                self._wish = _Wish.REST
            case "start" | "start-new" if self._job.plan is None or self._folder is None:
                self._desk.remark("There is nothing to start: give a plan and --out.")
            case "start":
                self._wish = _Wish.CAPTURE
            case "start-new":
                self._wish = _Wish.CAPTURE_ANEW
            case _:
                self._desk.remark("No plan is being captured.")

    def _work(self) -> None:
        """Aim and capture in turn with devices that stay open, until they should be let go."""
        self._desk.change(lambda snapshot: replace(snapshot, activity=Activity.OPENING))
        with self._bench.held(self._plan) as bench:
            while self._wish is not _Wish.REST and not self._stop.is_set():
                if self._wish is _Wish.AIM:
                    self._aim(bench)
                else:
                    self._do_capture(bench)

    def _aim(self, bench: Bench) -> None:
        with bench.aim(Resumption(self._plan)) as devices:
            self._aiming = Aiming(
                devices,
                self._desk,
                self._view or first_view(devices, self._plan.camera.settings),
                self._plan.projector,
                lambda: self._wish is _Wish.AIM and not self._stop.is_set(),
            )
            try:
                self._aiming.run()
            finally:
                # After a capture its last frame stays in view until somebody wants another picture.
                self._view = replace(self._aiming.view, source=Source.OFF, read_back=None)
                self._aiming = None

    def _do_capture(self, bench: Bench) -> None:
        """Capture, then aim again: whatever a capture fails of but its devices ends nothing."""
        plan, folder = self._plan, self._folder
        if folder is None or self._job.folder is None:
            return
        if self._wish is _Wish.CAPTURE_ANEW:
            folder = self._folder = unused(self._job.folder)
        self._display.stage("capturing", len(plan), done := _done(folder))
        stop = StopOfOne(self._stop)
        self._desk.change(lambda snapshot: replace(snapshot, session=str(folder.absolute())))
        self._capture = capture = CapturePage(self._desk, self._display, stop, done, len(plan))
        complete = False
        try:
            session, outcome = self._record(plan, bench, folder, capture, stop)
            complete = session.complete
            self._desk.note(f"{outcome}: {len(session.frames)} of {len(plan)} frames in {folder}")
        except LumisplitError as error:
            self._desk.note(str(error), is_error=True)
        finally:
            self._capture = None
            closes = complete and bench.closes_when_complete
            self._wish = _Wish.REST if closes else _Wish.AIM

    def _record(
        self, plan: Plan, bench: Bench, folder: Path, capture: CapturePage, stop: threading.Event
    ) -> tuple[Session, Outcome]:
        profiles = self._job.profiles
        return record(plan, bench, folder, capture, stop, capture.pause, profiles=profiles)

    def _look_into_session(self) -> None:
        """What an earlier run has captured."""
        if self._job.plan is None or self._folder is None:
            return
        try:
            progress = Progress(_done(self._folder), len(self._plan))
        except LumisplitError as error:
            self._desk.note(str(error), is_error=True)
            return
        self._desk.change(lambda snapshot: replace(snapshot, progress=progress))

    def _rest(self) -> None:
        self._desk.change(
            lambda snapshot: replace(
                snapshot, activity=Activity.RESTING, shown=None, pausing=False, stopping=False
            )
        )
        while self._wish is _Wish.REST and not self._stop.wait(LOOK_S):
            pass
