"""A bench made of a recording: what was shown is recognised, what was captured is handed over."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import TypeAlias

from drivers.errors import CameraError, ProjectorError, ReplayError
from drivers.protocols import CameraSettings, Raster, RawFrame
from drivers.raster import check_raster, raster_digest

Recorded: TypeAlias = tuple[str, Callable[[], RawFrame]]


class ReplayProjector:
    """A projector that shows to a recording (see `drivers.protocols.Projector`).

    Parameters
    ----------
    resolution
        (height, width) of the rasters that were recorded.
    """

    def __init__(self, resolution: tuple[int, int]) -> None:
        self._resolution = resolution
        self._shown: str | None = None
        self._open = True

    @property
    def resolution(self) -> tuple[int, int]:
        """(height, width) in projector pixels."""
        return self._resolution

    @property
    def shown(self) -> str | None:
        """Digest of the raster that is on; None when nothing has been shown or it is closed."""
        return self._shown

    def show(self, raster: Raster) -> None:
        """Remember the raster's digest."""
        check_raster(raster, self._resolution)
        if not self._open:
            raise ProjectorError("the replay's projector is closed; open the recording again")
        self._shown = raster_digest(raster)

    def check(self) -> None:
        """Raise `ProjectorError` once it is closed."""
        if not self._open:
            raise ProjectorError("the replay's projector is closed; open the recording again")

    def close(self) -> None:
        """Show nothing any more."""
        self._shown = None
        self._open = False


class ReplayCamera:
    """A camera that delivers recorded frames (see `drivers.protocols.Camera`).

    Rasters repeat in a run; the frames of each are handed over in the order of the recording.

    Parameters
    ----------
    projector
        The replay's projector; what it shows decides which frame comes.
    recording
        (digest of the raster as `drivers.raster.raster_digest` gives it, reader of the frame)
        in the order of capture. A reader is called when its frame is asked for, not before.
    """

    def __init__(self, projector: ReplayProjector, recording: Iterable[Recorded]) -> None:
        self._projector = projector
        self._queues: dict[str, deque[Callable[[], RawFrame]]] = {}
        self._recorded: dict[str, int] = {}
        for digest, reader in recording:
            self._queues.setdefault(digest, deque()).append(reader)
            self._recorded[digest] = self._recorded.get(digest, 0) + 1
        self._open = True

    def capture(self, settings: CameraSettings) -> RawFrame:
        """The next frame that was recorded for what the projector shows."""
        if not self._open:
            raise CameraError("the replay's camera is closed; open the recording again")
        digest = self._projector.shown
        if digest is None:
            raise ReplayError("nothing has been shown yet: show a raster before capturing")
        queue = self._queues.get(digest)
        if queue is None:
            raise ReplayError(
                f"the recording has no frame for this raster (sha256 {digest[:12]}…): "
                "it was made with another plan, another projector size or another version"
            )
        if not queue:
            raise ReplayError(
                f"the recording has {self._recorded[digest]} frame(s) for this raster "
                f"(sha256 {digest[:12]}…) and all have been handed over: the plan asks for more"
            )
        frame = queue[0]()
        if frame.settings != settings:
            raise ReplayError(
                f"the recording was made with {frame.settings}, asked for is {settings}: "
                "replay it with the settings of its own plan"
            )
        queue.popleft()
        return frame

    def close(self) -> None:
        """Let the recording go."""
        self._open = False
        self._queues = {}
