"""Direct light at one pitch freed from what noise does to it, with its standard error.

Max/min and the amplitude of a sinusoid read too much direct light, by one to four times the noise
of a frame; `processing.frames.order_statistics` says how much. The noise of a lit and of a dark
frame differ: D is measured in units of their mean. Where the place that each pixel sees on the
raster is known, the contrast s_k of every frame is too, and

    D = 2 Σ (s_k − s̄) f_k / Σ (s_k − s̄)²,    variance 4σ² / Σ (s_k − s̄)²

is free of bias and uses all frames.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from processing.frames.frame_noise import FrameNoise, lattice_step
from processing.frames.noise_bias import Correction
from processing.frames.order_statistics import STEP
from processing.numerics.elementary import cos, sin
from processing.numerics.linear_algebra import inverse, product
from processing.numerics.threads import in_threads

Image: TypeAlias = NDArray[np.float32]
Array: TypeAlias = NDArray[np.float64]

# Standard deviation of the error of a measured bias, in units of the noise s of
# `processing.frames.bias_reading`, of which max/min has it twice.
_BIAS_DOUBT = 0.45
# Values that are taken through all steps together, in the first cache.
_TOGETHER = 512
_LINES = 32


@dataclass(frozen=True, slots=True)
class Estimate:
    """Direct light at a pitch and how far it may be off.

    Parameters
    ----------
    direct_light
        float32, (height, width, colours), in the unit of the frames; below 0 where there is
        none but noise. It is what the same estimator would read without noise.
    deviation
        float32, the same shape: standard error. The truth lies within one at 68 % of the pixels.
    """

    direct_light: Image
    deviation: Image


def extrema_estimate(
    direct_light: Image,
    white: Image,
    noise: FrameNoise,
    correction: Correction,
    *,
    kinds: NDArray[np.int64] | None = None,
    leak: float = 0.0,
) -> Estimate:
    """Free max/min from the bias of noise.

    Parameters
    ----------
    direct_light
        float32, (height, width, colours), as `ExtremaSeparation.separate` gives it.
    white
        float32, the same shape, the scene under full light.
    noise
        Of a frame.
    correction
        `Correction.of` where contrasts are known, or `extrema_correction`.
    kinds
        Of the pixels of `processing.frames.frame_noise.lattice`, (rows, columns, colours), see
        `Correction.kinds`; all are of the first kind where it is not given.
    leak
        b, as `direct_light` was separated with.
    """
    if kinds is None:
        kinds = np.zeros((1, 1, white.shape[-1]), np.int64)
    return _estimate(direct_light, white, kinds, noise, correction, (leak, 1.0, True))


def amplitude_estimate(
    direct_light: Image,
    white: Image,
    noise: FrameNoise,
    phases: Iterable[float],
    leak: float = 0.0,
) -> Estimate:
    """Free the amplitude of a sinusoid from the bias of noise.

    Parameters
    ----------
    direct_light, white, noise, leak
        As for `extrema_estimate`; `direct_light` from `SinusoidSeparation.separate`.
    phases
        Of all frames, in radians. Their noise is taken at half of white, which is exact where
        four or more spread evenly.
    """
    angles = np.array(list(phases))
    basis = np.stack([np.ones_like(angles), cos(angles), sin(angles)])
    if np.linalg.matrix_rank(basis) < 3:
        raise ValueError(f"{len(angles)} phases do not fix a sinusoid: its three unknowns need 3")
    covariance = inverse(product(basis, basis.T))
    gain = 2 * float(np.sqrt(np.trace(covariance[1:, 1:]) / 2))
    kinds = np.zeros((1, 1, white.shape[-1]), np.int64)
    correction = Correction.of_amplitude()
    return _estimate(direct_light, white, kinds, noise, correction, (leak, gain, False))


class CorrelationSeparation:
    """Direct light from all frames of a pitch, where the place that each pixel sees is known.

    Parameters
    ----------
    shape
        (height, width, colours) of the frames.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._sums = np.zeros((4, *shape), np.float64)
        self._n_frames = 0

    def add(self, frame: Image, contrast: Array) -> None:
        """Take in one frame.

        Parameters
        ----------
        frame
            float32, (height, width, colours), black subtracted.
        contrast
            (height, width) or (height, width, colours), in [−1, 1]: what the pattern shows each
            pixel, see `processing.frames.footprint.contrast`.
        """
        if frame.shape != self._sums.shape[1:] or contrast.shape[:2] != frame.shape[:2]:
            raise ValueError(
                f"frame {frame.shape}, contrast {contrast.shape} and the pitch's frames "
                f"{self._sums.shape[1:]} do not fit"
            )
        seen = contrast if contrast.ndim == 3 else contrast[..., np.newaxis]
        self._sums[0] += frame
        self._sums[1] += seen
        self._sums[2] += seen * frame
        self._sums[3] += seen**2
        self._n_frames += 1

    def estimate(self, noise: FrameNoise, leak: float = 0.0) -> Estimate:
        """Direct light and its standard error; NaN and infinite where the contrast never changed.

        Parameters
        ----------
        noise
            Of a frame.
        leak
            b of the projector, in [0, 1).
        """
        light, contrast, product, square = self._sums
        if self._n_frames < 2:
            raise ValueError(f"a slope needs at least 2 frames, there are {self._n_frames}")
        count = self._n_frames
        energy = square - contrast**2 / count
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = 2 / (1 - leak) / np.where(energy > 1e-9, energy, 0)
            direct = gain * (product - contrast * light / count)
            deviation = gain * np.sqrt(energy) * noise.deviation(light / count)
        return Estimate(direct.astype(np.float32), deviation.astype(np.float32))


def _estimate(
    direct_light: Image,
    white: Image,
    kinds: NDArray[np.int64],
    noise: FrameNoise,
    correction: Correction,
    how: tuple[float, float, bool],
) -> Estimate:
    if direct_light.shape != white.shape or len(noise.slope) != white.shape[-1]:
        raise ValueError(
            f"direct light {direct_light.shape}, white {white.shape} and noise "
            f"{noise.slope.shape} (one a colour) do not fit"
        )
    leak, gain, extrema = how
    if not 0 <= leak < 1:
        raise ValueError(f"leak is a fraction of white in [0, 1), not {leak}")
    height, width, n_colors = white.shape
    measured = kinds.size > n_colors
    step = lattice_step(white.shape) if measured else max(white.shape)
    half = np.sqrt(correction.half**2 + correction.uneven**2) if measured else correction.half
    # Both of an entry side by side: they are looked up together.
    tables = np.stack([correction.middle, half], axis=-1).astype(np.float32)
    # The table of each value of a line: where it begins when they lie one after the other.
    begins = (kinds.astype(np.int32) * np.int32(tables.shape[1])).repeat(step, axis=1)
    begins = np.ascontiguousarray(begins[:, :width]).reshape(len(kinds), width * n_colors)
    lines = np.stack([np.tile(one, width) for one in (noise.constant, noise.slope)])
    about = (lines.astype(np.float32), tables.reshape(-1, 2), tables.shape[1])
    doubt = _BIAS_DOUBT if measured else 0.0
    numbers = np.array(
        [1 - leak, 1 / STEP, (1 + leak) / 2, gain, 1 / (1 - leak), doubt**2], np.float32
    )
    estimated, deviation = np.empty(white.shape, np.float32), np.empty(white.shape, np.float32)
    images = [
        np.ascontiguousarray(image).reshape(height, width * n_colors)
        for image in (direct_light, white, estimated, deviation)
    ]

    def correct(first: int) -> None:
        direct, lit, found, error = (image[first : first + _LINES] for image in images)
        bands = np.arange(first, first + len(direct)) // step
        _correct(direct, lit, found, error, begins, bands, about, numbers, extrema)

    in_threads(correct, range(0, height, _LINES))
    return Estimate(estimated, deviation)


# Element by element, and nothing is contracted: vectors of any width give the same bits. Only the
# tables are looked up one by one.
_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def _variance(light, constant, slope):  # type: ignore[no-untyped-def]
    least = np.float32(1e-30)
    variance = constant + slope * (light if light > np.float32(0) else np.float32(0))
    return variance if variance > least else least


@_compiled
def _place(reading, unit, entries, index, part, beyond):  # type: ignore[no-untyped-def]
    """Where readings lie in a table: entry, part of the way to the next, and what is beyond."""
    end = np.float32(entries - 1)
    for i in range(len(reading)):
        at = reading[i] / unit[i]
        held = at if at < end else end
        entry = np.int32(held)
        entry = entry if entry < entries - 2 else np.int32(entries - 2)
        index[i], part[i], beyond[i] = entry, held - np.float32(entry), at - held


@_compiled
def _look_up(column, begin, index, part, found):  # type: ignore[no-untyped-def]
    for i in range(len(index)):
        at = begin[i] + index[i]
        found[i] = column[at] + part[i] * (column[at + 1] - column[at])


@_compiled
def _correct(  # type: ignore[no-untyped-def]
    direct, white, estimated, deviation, begins, bands, about, numbers, extrema
):
    """Correct some lines, (lines, values), of which each has its kinds in one of `begins`."""
    (constant, slope), tables, entries = about
    kept, per_step, level_of_white, gain, freed, doubt = numbers
    half, zero = np.float32(0.5), np.float32(0)
    reading, level, unit, part, beyond, middle, width, lit, dark = np.empty(
        (9, _TOGETHER), np.float32
    )
    index = np.empty(_TOGETHER, np.int32)
    for y in range(len(direct)):
        for start in range(0, direct.shape[1], _TOGETHER):
            some = slice(start, min(start + _TOGETHER, direct.shape[1]))
            n = some.stop - some.start
            seen, whole, begin = direct[y, some], white[y, some], begins[bands[y], some]
            fixed, rising = constant[some], slope[some]
            for i in range(n):
                # The plain reading of the pattern alone; light halfway between lit and dark.
                plain = seen[i] * kept
                reading[i] = (plain if plain > zero else zero) * per_step
                level[i] = level_of_white * whole[i]
                lit[i] = dark[i] = _variance(level[i], fixed[i], rising[i])
            if extrema:
                for i in range(n):
                    unit[i] = np.sqrt(lit[i])
                _place(reading[:n], unit, entries, index, part, beyond)
                _look_up(tables[:, 0], begin, index[:n], part, middle)
                for i in range(n):
                    swing = half * ((middle[i] + beyond[i] / per_step) * unit[i])
                    swing = swing if swing > zero else zero
                    lit[i] = _variance(level[i] + swing, fixed[i], rising[i])
                    dark[i] = _variance(level[i] - swing, fixed[i], rising[i])
            for i in range(n):
                unit[i] = half * (np.sqrt(lit[i]) + np.sqrt(dark[i])) * gain
            _place(reading[:n], unit, entries, index, part, beyond)
            _look_up(tables[:, 0], begin, index[:n], part, middle)
            _look_up(tables[:, 1], begin, index[:n], part, width)
            found, error = estimated[y, some], deviation[y, some]
            for i in range(n):
                found[i] = (middle[i] + beyond[i] / per_step) * unit[i] * freed
                # Errors of the two extrema add up in squares, their biases as they are.
                both = lit[i] + dark[i]
                square = width[i] * width[i] * (half * both) + doubt * (lit[i] * dark[i] / both)
                error[i] = gain * np.sqrt(square) * freed
