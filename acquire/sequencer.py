"""The capture loop: show, settle, expose, keep, next.

The next pattern goes up while the last frame is written, but no exposure starts before the last
frame is on the disk: whatever happens, at most the frame in flight is lost.
"""

from __future__ import annotations

import hashlib
import threading
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol

import numpy as np

from acquire.errors import BenchError, StorageError
from acquire.pause import Pause
from acquire.session import FrameRecord, Session
from drivers.errors import CameraTimeoutError
from drivers.media import PICTURE_TYPES
from drivers.raster import raster_digest

if TYPE_CHECKING:
    from acquire.plan import Step
    from drivers.protocols import CameraSettings, Devices, RawFrame


LOOK_S = 0.1  # how often a resting capture looks whether it should stop


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

    Raises
    ------
    DriverError
        A device failed; every finished exposure is kept first.
    StorageError
        The disk does not take a frame; the session stays whole.
    """
    for warning in devices.warnings:
        observer.warning(f"camera: {warning}")
    session.begin_run(devices.clock.now())
    try:
        outcome = _Capture(session, devices, observer, stop, pause or Pause()).run()
    except BaseException as error:
        reason = str(error) or type(error).__name__
        with suppress(StorageError):
            session.end_run(devices.clock.now(), "failed", reason)
        raise
    session.end_run(devices.clock.now(), outcome)
    return outcome


class _Capture:
    def __init__(
        self,
        session: Session,
        devices: Devices,
        observer: Observer,
        stop: threading.Event,
        pause: Pause,
    ) -> None:
        self.session, self.devices, self.observer = session, devices, observer
        self.stop, self.pause = stop, pause
        self.plan = session.plan

    def run(self) -> Outcome:
        remaining = range(len(self.session.frames), len(self.plan))
        with ThreadPoolExecutor(1, thread_name_prefix="disk") as disk:
            writing: Future[Step] | None = None
            try:
                for index in remaining:
                    if self.pause.is_asked:
                        self._finish(writing)
                        writing = None
                        self._rest(index)
                    if self.stop.is_set():
                        break
                    step = self.plan.step(index)
                    digest = self._show(step)
                    self._finish(writing)
                    writing = None
                    if self.stop.is_set():
                        break
                    frame = self._expose(step)
                    self.devices.projector.check()
                    writing = disk.submit(self._keep, step, digest, frame)
            finally:
                self._finish(writing)
        return Outcome.COMPLETE if self.session.complete else Outcome.STOPPED

    def _rest(self, index: int) -> None:
        """Wait in the dark; then show again what was shown, so that the run goes on unchanged."""
        black = np.zeros(self.devices.projector.resolution, np.uint8)
        self.devices.projector.show(black)
        with self.pause.resting():
            while not self.stop.is_set() and not self.pause.wait(LOOK_S):
                self.devices.projector.check()
        if index and not self.stop.is_set():
            self._show(self.plan.step(index - 1))

    def _show(self, step: Step) -> str:
        projector = self.devices.projector
        raster = self.plan.projector.raster(step.pattern, projector.resolution)
        projector.show(raster)
        return raster_digest(raster)

    def _expose(self, step: Step) -> RawFrame:
        for attempt in range(self.plan.camera.retries + 1):
            try:
                frame = self.devices.camera.capture(step.settings)
            except CameraTimeoutError as error:
                if attempt == self.plan.camera.retries or self.stop.is_set():
                    raise CameraTimeoutError(
                        f"Step {step.index} ({step.pattern}): {error} Tried {attempt + 1} "
                        "time(s), as the plan's camera.retries says. Every frame before it is "
                        "safe; the same command goes on from here."
                    ) from error
                self.observer.warning(f"step {step.index}: {error} Trying again.")
            else:
                _check_settings(step, frame.settings)
                _check_kind(step, frame)
                return frame
        raise AssertionError

    def _keep(self, step: Step, digest: str, frame: RawFrame) -> Step:
        sha256 = hashlib.sha256(frame.data).hexdigest()
        record = FrameRecord.of(step.index, step.pattern, digest, frame, sha256)
        self.session.store(record, frame.data)
        return step

    def _finish(self, writing: Future[Step] | None) -> None:
        if writing is not None:
            self.observer.frame_kept(writing.result(), len(self.plan))


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
