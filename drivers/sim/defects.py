"""What can be wrong with a bench, each off unless it is given."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class Defects:
    """Deviations of a simulated bench from an ideal one.

    Parameters
    ----------
    gamma
        The projector emits (raster/255)^gamma, in (0, 10].
    black_level
        Light of a black projector pixel, fraction of white, in [0, 1).
    blur_px
        Standard deviation of the projector's Gaussian defocus, in camera pixels.
    latency_s
        Time from the start of `show` until the new light is on the scene.
    late, dropped, swapped, timeouts, torn
        Probability, for each exposure, that the projector still shows the previous raster; that
        it is black; that the camera hands over the file it delivered last once more; that no
        file comes; that the raster is drawn down to some row only, below it the previous one.
    full_well_e
        Electrons at the sensor's white level at ISO 200; switches shot noise on.
    read_noise_e
        Standard deviation of the read-out in electrons; needs `full_well_e` for its scale.
    drift
        Relative change of the lamp over the run, linear in the exposure's number, > −1.
    flicker
        Relative amplitude of the lamp at its 60 Hz refresh, phase random for each exposure.
    ambient
        Uniform light that the projector does not control, fraction of the brightest photosite
        under white.
    move_px
        Shift of the scene to the right over the run, in camera pixels, linear in the exposure's
        number.
    shade
        Part of the projector's picture, from the left, that something in front of it hides in the
        second half of the run.
    slip_px
        Projector pixels by which its picture stands farther to the right in the second half of the
        run; what leaves on one side is lost, what enters on the other is black.
    zoom
        Factor, ≠ 0, by which its picture is larger about its middle, both ways, in the second half
        of the run; −1 turns it by 180°.
    iso_turned
        ISO speed that somebody sets at the camera in the middle of the run, ≥ 25. The files tell
        it, the camera's answers do not.
    """

    gamma: float = 1.0
    black_level: float = 0.0
    blur_px: float = 0.0
    latency_s: float = 0.0
    late: float = 0.0
    dropped: float = 0.0
    swapped: float = 0.0
    timeouts: float = 0.0
    torn: float = 0.0
    full_well_e: float | None = None
    read_noise_e: float = 0.0
    drift: float = 0.0
    flicker: float = 0.0
    ambient: float = 0.0
    move_px: float = 0.0
    shade: float = 0.0
    slip_px: float = 0.0
    zoom: float = 1.0
    iso_turned: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and not math.isfinite(value):
                raise ValueError(f"{field.name} must be a finite number, not {value}")
        for name in ("late", "dropped", "swapped", "timeouts", "torn"):
            self._require(name, 0 <= getattr(self, name) <= 1, "a probability in [0, 1]")
        for name in ("blur_px", "latency_s", "read_noise_e", "ambient"):
            self._require(name, getattr(self, name) >= 0, "at least 0")
        self._require("gamma", 0 < self.gamma <= 10, "in (0, 10]")
        self._require("black_level", 0 <= self.black_level < 1, "a fraction of white in [0, 1)")
        self._require("shade", 0 <= self.shade < 1, "a part of the picture in [0, 1)")
        self._require("flicker", 0 <= self.flicker <= 1, "a relative amplitude in [0, 1]")
        self._require("slip_px", self.slip_px == round(self.slip_px), "a number of whole pixels")
        self._require("zoom", 0.05 <= abs(self.zoom) <= 20, "from 0.05 to 20, or less than −0.05")
        self._require("drift", self.drift > -1, "above −1: a lamp cannot lose more than its light")
        if self.iso_turned is not None:
            self._require("iso_turned", 25 <= self.iso_turned <= 51200, "from 25 to 51200")
        if self.full_well_e is not None:
            self._require("full_well_e", self.full_well_e > 0, "a number of electrons above 0")
        elif self.read_noise_e:
            raise ValueError(
                "read_noise_e is in electrons and has no scale: give full_well_e as well"
            )

    def _require(self, name: str, holds: bool, what: str) -> None:
        if not holds:
            raise ValueError(f"{name} must be {what}, not {getattr(self, name)}")
