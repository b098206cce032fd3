"""A capture that a page looks at and may rest or end."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

from acquire.page.commands import BenchCommand, Order
from acquire.page.desk import Desk
from acquire.page.state import Activity, Progress
from acquire.pause import Pause
from acquire.plan import Step
from acquire.sequencer import Observer


class CapturePage:
    """Hears of a capture, passes it on, and keeps the page's orders.

    Parameters
    ----------
    desk
        Told of everything.
    observer
        The terminal's.
    stop
        Set when the page ends the capture.
    done, total
        Frames on the disk and in the plan.
    """

    def __init__(
        self, desk: Desk, observer: Observer, stop: threading.Event, done: int, total: int
    ) -> None:
        self._desk, self._observer, self._stop = desk, observer, stop
        self.pause = Pause(self._rest_changed)
        self._first_s: float | None = None
        self._rest_began_s = self._rested_s = 0.0
        progress = Progress(done, total)
        desk.change(
            lambda snapshot: replace(
                snapshot, activity=Activity.CAPTURING, shown=None, progress=progress
            )
        )

    def frame_kept(self, step: Step, total: int) -> None:
        """A frame is on the disk."""
        self._observer.frame_kept(step, total)
        known = self._desk.snapshot.progress
        done, now_s = max(step.index + 1, known.done if known else 0), time.monotonic()
        if self._first_s is None:
            self._first_s, self._rested_s = now_s, 0.0
            progress = Progress(done, total, done)
        else:
            first = done if known is None else known.done_before
            progress = Progress(done, total, first, now_s - self._first_s - self._rested_s)
        self._desk.change(lambda snapshot: replace(snapshot, progress=progress))

    def warning(self, message: str) -> None:
        """Something a person should know; the capture goes on."""
        self._observer.warning(message)
        self._desk.remark(message)

    def obey(self, command: BenchCommand) -> None:
        """Carry out what concerns a capture under way."""
        match command:
            case Order(do="pause"):
                self.pause.ask()
            case Order(do="go-on"):
                self.pause.go_on()
            case Order(do="stop"):
                self._stop.set()
                self._desk.change(lambda snapshot: replace(snapshot, stopping=True))
                return
            case _:
                self._desk.remark("Not while the plan is captured: pause or stop it first.")
                return
        pausing = self.pause.is_asked
        self._desk.change(lambda snapshot: replace(snapshot, pausing=pausing))

    def _rest_changed(self) -> None:
        now_s = time.monotonic()
        if self.pause.is_resting:
            self._rest_began_s = now_s
        else:
            self._rested_s += now_s - self._rest_began_s
        activity = Activity.PAUSED if self.pause.is_resting else Activity.CAPTURING
        pausing = self.pause.is_asked
        self._desk.change(lambda snapshot: replace(snapshot, activity=activity, pausing=pausing))
