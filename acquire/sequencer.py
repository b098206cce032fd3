"""The capture loop: show, settle, expose, keep, next.

The next pattern goes up while the last frame is written, but no exposure starts before the last
frame is on the disk: whatever happens, at most the frame in flight is lost. When the last frame of
a pitch is there, all of them are judged and those that do not show their pattern are taken again
(`acquire.proof`) before the next pitch begins.
"""

from __future__ import annotations

import hashlib
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

import numpy as np

from acquire.errors import BenchError, StorageError
from acquire.pause import Pause
from acquire.proof import Prover, Unit
from acquire.session import FrameRecord, Session
from acquire.session.log import MAX_TEXT, Kind, Note, append_note
from drivers.errors import CameraTimeoutError
from drivers.media import PICTURE_TYPES
from drivers.raster import raster_digest

if TYPE_CHECKING:
    from acquire.plan import Step
    from drivers.protocols import CameraSettings, Clock, Devices, RawFrame


LOOK_S = 0.1  # how often a resting capture looks whether it should stop
# The two clocks that tell a suspension are read one after the other, on a busy computer.
SUSPENDED_S = 0.5


class Outcome(StrEnum):
    """How a capture ended without an error."""

    COMPLETE = "complete"
    STOPPED = "stopped"


class Observer(Protocol):
    """Hears of the capture as it goes on."""

    def frame_kept(self, step: Step, total: int) -> None:
        """Called after a frame and its line are on the disk."""

    def warning(self, message: str) -> None:
        """Called when the capture goes on, but a person should know why."""


def capture(
    session: Session,
    devices: Devices,
    observer: Observer,
    stop: threading.Event,
    pause: Pause | None = None,
    *,
    keep_unproven: bool = False,
) -> Outcome:
    """Capture what the session's plan still lacks.

    Parameters
    ----------
    session
        Locked by the caller; frames that it holds already are not taken again.
    devices
        The caller closes them, which blanks the projector.
    observer
        Told of every frame that is kept.
    stop
        When set, the frame in flight is finished and kept, then the capture ends.
    pause
        While asked for, no frame is taken and the projector is black.
    keep_unproven
        Go on, and note it, where a frame does not show its pattern however often it is taken.

    Raises
    ------
    ProofError
        A frame does not show its pattern, however often it is taken.
    DriverError
        A device failed; every finished exposure is kept first.
    StorageError
        The disk does not take a frame; the session stays whole.
    """
    journal = Journal(session, devices.clock, observer)
    session.begin_run(devices.clock.now())
    for warning in devices.warnings:
        journal.note(f"camera: {warning}")
    try:
        with Prover(session, journal.note, keep_unproven=keep_unproven) as prover:
            outcome = _Capture(
                session, devices, observer, stop, pause or Pause(), prover, journal
            ).run()
    except BaseException as error:
        reason = str(error) or type(error).__name__
        try:
            session.end_run(devices.clock.now(), "failed", reason)
        except StorageError:
            # On a full disk a line may still find room where the record does not.
            journal.keep(reason, Kind.END)
        raise
    session.end_run(devices.clock.now(), outcome)
    return outcome


class Journal:
    """Tells the observer what a person should know, and keeps it in the session's log."""

    def __init__(self, session: Session, clock: Clock, observer: Observer) -> None:
        self._session, self._clock, self._observer = session, clock, observer
        self._lock = threading.Lock()  # the proof warns from the thread that writes the frames

    def note(self, text: str, kind: Kind = Kind.WARNING, step: int | None = None) -> None:
        """Tell and keep."""
        self._observer.warning(text)
        self.keep(text, kind, step)

    def keep(self, text: str, kind: Kind, step: int | None = None) -> None:
        """Keep what is told otherwise."""
        note = Note(time_s=self._clock.now(), kind=kind, step=step, text=text[:MAX_TEXT])
        with self._lock:
            append_note(self._session.folder, note)


class _Capture:
    def __init__(
        self,
        session: Session,
        devices: Devices,
        observer: Observer,
        stop: threading.Event,
        pause: Pause,
        prover: Prover,
        journal: Journal,
    ) -> None:
        self.session, self.devices, self.observer = session, devices, observer
        self.stop, self.pause, self.prover = stop, pause, prover
        self.plan, self.journal = session.plan, journal
        self.shown = session.lines[-1].step if session.lines else None

    def run(self) -> Outcome:
        with ThreadPoolExecutor(1, thread_name_prefix="disk") as disk:
            for unit in self.prover.resume():
                self._prove(unit)
            writing: Future[Step] | None = None
            try:
                for index in range(len(self.session.frames), len(self.plan)):
                    if self.pause.is_asked:
                        self._finish(writing)
                        writing = None
                        self._rest()
                    if self.stop.is_set():
                        break
                    step = self.plan.step(index)
                    digest = self._show(step)
                    self._finish(writing)
                    writing = None
                    if self.stop.is_set():
                        break
                    frame = self._take(step)
                    writing = disk.submit(self._keep, step, digest, frame)
                    for unit in self.prover.closing_at(index):
                        self._finish(writing)
                        writing = None
                        self._prove(unit)
            finally:
                self._finish(writing)
        whole = self.session.complete and self.prover.is_done
        return Outcome.COMPLETE if whole else Outcome.STOPPED

    def _prove(self, unit: Unit) -> None:
        """Judge a unit and take again what does not show its pattern, until all do."""
        while not self.stop.is_set():
            retake = self.prover.next_retake(unit)
            if retake is None:
                return
            index, why = retake
            self.journal.note(why, Kind.RETAKE, index)
            step = self.plan.step(index)
            digest = self._show(step)
            frame = self._take(step)
            self._keep(step, digest, frame)

    def _rest(self) -> None:
        """Wait in the dark; then show again what was shown, so that the run goes on unchanged."""
        black = np.zeros(self.devices.projector.resolution, np.uint8)
        self.devices.projector.show(black)
        with self.pause.resting():
            while not self.stop.is_set() and not self.pause.wait(LOOK_S):
                self.devices.projector.check()
        if self.shown is not None and not self.stop.is_set():
            self._show(self.plan.step(self.shown))

    def _show(self, step: Step) -> str:
        projector = self.devices.projector
        self.suspended_s = self._suspended()
        raster = self.plan.projector.raster(step.pattern, projector.resolution)
        projector.show(raster)
        self.shown = step.index
        return raster_digest(raster)

    def _suspended(self) -> float:
        """Seconds that the computer has been suspended, since some moment before."""
        clock = self.devices.clock
        return clock.monotonic() - clock.awake()

    def _take(self, step: Step) -> RawFrame:
        """A frame all through which its pattern stood: in a suspension it may have gone."""
        while True:
            frame = self._expose(step)
            slept_s = self._suspended() - self.suspended_s
            self.devices.projector.check()
            if slept_s < SUSPENDED_S:
                return frame
            self.journal.note(
                f"step {step.index}: the computer was suspended for {slept_s:.0f} s meanwhile; the "
                "frame was not kept and is taken again. Switch its standby off for a capture.",
                Kind.SUSPENSION,
                step.index,
            )
            self._show(step)

    def _expose(self, step: Step) -> RawFrame:
        for attempt in range(self.plan.camera.retries + 1):
            try:
                frame = self.devices.camera.capture(step.settings)
            except CameraTimeoutError as error:
                if attempt == self.plan.camera.retries or self.stop.is_set():
                    raise CameraTimeoutError(
                        f"Step {step.index} ({step.pattern}): {_sentence(error)} Tried "
                        f"{attempt + 1} time(s), as the plan's camera.retries says. Every frame "
                        "before it is safe; the same command goes on from here."
                    ) from error
                self.journal.note(
                    f"step {step.index}: {_sentence(error)} Trying again.", Kind.TIMEOUT, step.index
                )
            else:
                _check_settings(step, frame.settings)
                _check_kind(step, frame)
                if frame.monotonic_s is None:
                    frame = replace(frame, monotonic_s=self.devices.clock.monotonic())
                return frame
        raise AssertionError

    def _keep(self, step: Step, digest: str, frame: RawFrame) -> Step:
        sha256 = hashlib.sha256(frame.data).hexdigest()
        known = step.index < len(self.session.frames)
        attempt = self.session.frames[step.index].attempt + 1 if known else 0
        record = FrameRecord.of(step.index, attempt, step.pattern, digest, frame, sha256)
        self.session.store(record, frame.data)
        self.prover.take(len(self.session.lines) - 1, record, frame.data)
        return step

    def _finish(self, writing: Future[Step] | None) -> None:
        if writing is not None:
            self.observer.frame_kept(writing.result(), len(self.plan))


def _sentence(error: Exception) -> str:
    said = str(error)
    return said if said.endswith((".", "?", "!")) else f"{said}."


def _check_settings(step: Step, actual: CameraSettings) -> None:
    if actual != step.settings:
        raise BenchError(
            f"Step {step.index}: the camera exposed with {actual}, the plan asks for "
            f"{step.settings}. The frame was not kept. Set the camera's dial to M and lock its "
            "settings, or correct the plan's [camera]."
        )


def _check_kind(step: Step, frame: RawFrame) -> None:
    if frame.media_type in PICTURE_TYPES:
        raise BenchError(
            f"Step {step.index}: the camera delivered {frame.media_type}, whose values are no "
            "longer proportional to light. The frame was not kept. Set the camera's picture "
            "quality to RAW."
        )
