"""Projector places from Gray code and shifted sinusoids, one way (columns or rows) at a time.

The Gray code names a cell of some projector pixels, the phase of the sinusoids the place in their
period; the cell says which period. With N even shifts the harmonics of order 2 to N − 2 that a
projector's response makes fall out of the phase.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

Image: TypeAlias = NDArray[np.float32]
NOISE_WINDOW_PX = 9
CERTAIN_DEVIATIONS = 4.0


@dataclass(frozen=True, slots=True)
class Phase:
    """What sinusoids of one pitch say of every pixel; (height, width) each.

    Parameters
    ----------
    place_px
        Projector column or row modulo the period 2·pitch.
    deviation_px
        Its standard error from the noise of the frames.
    direct
        Twice the amplitude: the direct light times the modulation that blur leaves.
    noise
        Standard deviation of a frame.
    """

    pitch_px: int
    place_px: NDArray[np.float64]
    deviation_px: NDArray[np.float64]
    direct: NDArray[np.float64]
    noise: NDArray[np.float64]


class Sinusoids:
    """Gathers frames I_k = B + A cos(π (x + s_k)/P), s_k = 2 P k/N.

    Parameters
    ----------
    pitch_px
        P, half a period.
    steps
        N, even, at least 4.
    """

    def __init__(self, pitch_px: int, steps: int) -> None:
        if steps < 4 or steps % 2:
            raise ValueError(f"sinusoids need an even number of steps, at least 4, not {steps}")
        self._pitch_px = pitch_px
        self._steps = steps
        self._phasor: NDArray[np.complex128] | None = None
        self._alternate: NDArray[np.float64] | None = None
        self._seen: set[int] = set()

    def add(self, light: Image, shift_px: int) -> None:
        """Add the frame at one shift, (height, width), any unit."""
        step = shift_px * self._steps / (2 * self._pitch_px)
        if step != int(step) or not 0 <= step < self._steps or int(step) in self._seen:
            raise ValueError(
                f"shift {shift_px} is no new one of {self._steps} over {2 * self._pitch_px} px"
            )
        self._seen.add(int(step))
        turned = light * np.exp(-1j * np.pi * shift_px / self._pitch_px)
        alternate = light * (-1.0) ** int(step)
        if self._phasor is None or self._alternate is None:
            self._phasor, self._alternate = turned, alternate.astype(np.float64)
        else:
            self._phasor += turned
            self._alternate += alternate

    def phase(self) -> Phase:
        """Place, error and direct light once every shift is there."""
        if self._phasor is None or self._alternate is None or len(self._seen) != self._steps:
            raise ValueError(f"{len(self._seen)} of {self._steps} shifts are there")
        amplitude = np.maximum(2 * np.abs(self._phasor) / self._steps, 1e-30)
        period_px = 2 * self._pitch_px
        place_px = np.angle(self._phasor) * self._pitch_px / np.pi % period_px
        # Light of the highest harmonic that N frames can tell is noise alone.
        noise = np.sqrt(uniform_filter(self._alternate**2 / self._steps, NOISE_WINDOW_PX))
        error_px = self._pitch_px / np.pi * noise * np.sqrt(2 / self._steps) / amplitude
        return Phase(self._pitch_px, place_px, error_px, 2 * amplitude, noise)


class GrayCode:
    """Gathers the bits of a Gray code, each with its complement.

    A bit is certain where no global light can have turned it: with D direct and G global light
    under white and a frame's difference Δ from its complement, a false bit has |Δ| ≤ G − D
    (after Xu & Aliaga, Robust pixel classification for 3D modeling with structured light, 2007).

    Parameters
    ----------
    finest
        Lowest bit projected, ≥ 0; a cell is 2^finest pixels.
    phase
        Of the sinusoids that vary the same way.
    white
        White less black, (height, width).
    """

    def __init__(self, finest: int, phase: Phase, white: Image) -> None:
        if white.shape != phase.direct.shape:
            raise ValueError(f"white {white.shape} does not fit the phase {phase.direct.shape}")
        self._finest = finest
        self._phase = phase
        self._least = np.maximum(
            white - 2 * phase.direct, CERTAIN_DEVIATIONS * np.sqrt(2) * phase.noise
        )
        self._code = np.zeros(white.shape, np.int64)
        self._doubts = np.zeros(white.shape, np.int64)
        self._doubtful = np.zeros(white.shape, np.int64)

    def add(self, bit: int, light: Image, complement: Image) -> None:
        """Add a bit's frame and that of its complement."""
        difference = light - complement
        place = 1 << (bit - self._finest)
        self._code |= np.where(difference > 0, place, 0)
        doubt = np.abs(difference) <= self._least
        self._doubts += doubt
        self._doubtful = np.where(doubt, place, self._doubtful)

    def places(self, size_px: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Columns or rows of a projector with `size_px` of them, and which can be trusted.

        One bit may be in doubt, as where a stripe ends, if both readings lead to one place.
        """
        places, near = self._unwrapped(self._code)
        other, near_other = self._unwrapped(self._code ^ self._doubtful)
        agreed = (self._doubts == 0) | ((self._doubts == 1) & near_other & (places == other))
        inside = (places > -0.5) & (places < size_px - 0.5)
        return places, near & agreed & inside

    def _unwrapped(self, code: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        cell = code.copy()
        for shift in (1, 2, 4, 8, 16):
            cell ^= cell >> shift
        side_px = 1 << self._finest
        middle = cell * side_px + (side_px - 1) / 2
        period_px = 2 * self._phase.pitch_px
        within = self._phase.place_px
        places = within + period_px * np.rint((middle - within) / period_px)
        return places, np.abs(places - middle) <= 1.5 * side_px
