"""What a projector, a camera and a clock must do for a capture, and what a camera hands over."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Raster: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """Exposure settings, as asked of a camera or as read back from it.

    Parameters
    ----------
    exposure_s
        Exposure time in seconds, > 0.
    aperture
        f-number, > 0; None when the lens has no electronic aperture.
    iso
        ISO speed, > 0; None when the camera has no such setting.
    """

    exposure_s: float
    aperture: float | None = None
    iso: int | None = None


@dataclass(frozen=True, slots=True)
class RawFrame:
    """One exposure: the bytes exactly as the camera delivered them.

    Parameters
    ----------
    data
        The file's content, never altered after this point.
    media_type
        IANA media type of `data`, for example ``image/x-adobe-dng``.
    settings
        The settings that the camera reports for this exposure.
    started_s, finished_s
        Start of the exposure and end of the delivery, seconds of the bench's clock.
    monotonic_s
        End of the delivery by a clock that nobody can set; None where the camera has none.
    """

    data: bytes
    media_type: str
    settings: CameraSettings
    started_s: float
    finished_s: float
    monotonic_s: float | None = None


class Projector(Protocol):
    """A source of light that shows rasters.

    After `close` the projector is black; `close` may be called more than once and from any state.
    """

    @property
    def resolution(self) -> tuple[int, int]:
        """(height, width) in projector pixels; the only raster size that `show` takes."""

    def show(self, raster: Raster) -> None:
        """Show a raster, (height, width) or (height, width, 3), row 0 on top.

        Returns when its light is on the scene and settled. Raises ValueError for another shape
        or dtype and `drivers.errors.ProjectorError` when the device fails.
        """

    def check(self) -> None:
        """Raise `drivers.errors.ProjectorError` unless what was shown last is still shown.

        Called after an exposure: a frame is kept only if its pattern stood throughout.
        """

    def close(self) -> None:
        """Go black and let the device go."""


class Camera(Protocol):
    """A camera that takes one exposure at a time."""

    def capture(self, settings: CameraSettings) -> RawFrame:
        """Expose once and deliver the file.

        The settings read back must be those that were asked for; a camera that cannot set them
        raises `drivers.errors.SettingsError`. Raises `drivers.errors.CameraTimeoutError` when no
        file came (worth another try) and `drivers.errors.CameraError` otherwise.
        """

    def close(self) -> None:
        """Let the device go; may be called more than once."""


@runtime_checkable
class LiveCamera(Protocol):
    """A camera that shows what it sees before it exposes, for aiming and focusing."""

    def live_view(self, settings: CameraSettings | None = None) -> Generator[bytes]:
        """Picture or raw files, one a frame; close the generator to end the live view.

        With `settings` the camera is set to them first. How far the picture shows their exposure
        is up to the camera. Raises `drivers.errors.CameraError` where there is no live view now.
        """

    def read_back(self) -> CameraSettings | None:
        """The settings as the camera has them now; None where it does not tell."""


class Clock(Protocol):
    """Time as the bench lives it: the host's for real devices, computed for simulated ones."""

    def now(self) -> float:
        """Seconds since 1970-01-01 UTC."""

    def monotonic(self) -> float:
        """Seconds that never jump, whoever sets the clock; 0 at any moment."""

    def awake(self) -> float:
        """Like `monotonic`, but standing still while the computer is suspended."""

    def sleep(self, duration_s: float) -> None:
        """Let `duration_s` ≥ 0 seconds go by."""


@dataclass(frozen=True, slots=True)
class Devices:
    """What a capture needs of a bench.

    `warnings` are what a person should change on the devices, as found on opening them;
    `camera_body` is maker, model and serial number, empty where the camera does not tell.
    """

    projector: Projector
    camera: Camera
    clock: Clock
    warnings: tuple[str, ...] = ()
    camera_body: str = ""
