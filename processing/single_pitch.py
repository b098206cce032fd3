"""Direct light at one pitch freed from what noise does to it, with its standard error.

Max/min and the amplitude of a sinusoid read too much direct light, by one to four times the noise
of a frame; `processing.order_statistics` says how much. The noise of a lit and of a dark frame
differ: D is measured in units of their mean. Where the place that each pixel sees on the raster is
known, the contrast s_k of every frame is too, and

    D = 2 Σ (s_k − s̄) f_k / Σ (s_k − s̄)²,    variance 4σ² / Σ (s_k − s̄)²

is free of bias and uses all frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy import ndimage

from processing.frame_noise import ADDED, FrameNoise, FrameSample, lattice_step
from processing.order_statistics import (
    STEP,
    Distribution,
    IntervalTable,
    amplitude_distribution,
    complemented_distribution,
    mean_range,
    range_distribution,
)

Image: TypeAlias = NDArray[np.float32]
Array: TypeAlias = NDArray[np.float64]

# Parts of the lit frames that see a pixel evenly lit, and steps of contrast between the others.
_EVEN_PARTS = (1.0, 0.72, 0.5, 0.33, 0.22, 0.11, 0.05)
_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003)
# Direct light, in units of noise, from which the growth tells kinds apart.
_TELLING = 6.0
# Standard deviation of the error of the bias, in units of noise, among the pixels of a window;
# chosen on simulated scenes (sharp, pitches 10, 44, 72) and synthetic pixels, rather too wide.
_KIND_SPREAD = 0.5
# Side of the window on the lattice over which the growth is averaged.
_NEAR = 5


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


@dataclass(frozen=True, slots=True)
class Correction:
    """What to make of max/min, or of an amplitude, in units of a frame's noise.

    Parameters
    ----------
    middle, half
        float64, (kinds, entries): `processing.order_statistics.IntervalTable` for each kind of
        pixel; how many frames come near the extrema, and how near, makes the kind.
    swing, growth
        float64, (kinds, deltas) and (kinds, 2, deltas): `FrameSample.growth` to be expected.
    """

    middle: Array
    half: Array
    swing: Array
    growth: Array

    @classmethod
    def of(cls, contrasts: Array, white_deviation: float | None = None) -> Correction:
        """Correction of max/min for pixels with known contrasts.

        Parameters
        ----------
        contrasts
            (frames,) at the place of a pixel, see `processing.footprint`; or (kinds, frames).
        white_deviation
            None where direct light is max − min; where white was made use of,
            2 max(max f, W − min f) − W, the standard deviation of its noise over that of a frame.
        """
        return cls._stacked(
            [
                range_distribution(one)
                if white_deviation is None
                else complemented_distribution(one, white_deviation)
                for one in np.atleast_2d(contrasts)
            ]
        )

    @classmethod
    def of_amplitude(cls) -> Correction:
        """Correction of the amplitude of a sinusoid."""
        return cls._stacked([amplitude_distribution])

    @classmethod
    def _stacked(cls, distributions: Sequence[Distribution]) -> Correction:
        rows = [IntervalTable.of([one]) for one in distributions]
        ratios = STEP * np.arange(max(len(row.middle) for row in rows), dtype=np.float64)
        filled = [row(ratios) for row in rows]
        middle, half = (np.stack([one[k] for one in filled]) for k in (0, 1))
        means = [mean_range(one) for one in distributions]
        growth = [[_grown(delta, mean, added) for added in ADDED] for delta, mean in means]
        return cls(middle, half, np.array([mean for _, mean in means]), np.array(growth))

    def kinds(self, light: Array, growth: Array) -> NDArray[np.int64]:
        """Which kind each pixel of a lattice is, from what noise does to its neighbourhood.

        Parameters
        ----------
        light
            (rows, columns, colours), (max − min)/σ; 0 where a pixel is of no use.
        growth
            (2, rows, columns, colours), `FrameSample.growth`.
        """
        counts = light > _TELLING
        misfit = np.empty((len(self.middle), *light.shape))
        for k, (mean, curves) in enumerate(zip(self.swing, self.growth, strict=True)):
            off = [
                np.where(counts, seen - np.interp(light, mean, curve), 0)
                for seen, curve in zip(growth, curves, strict=True)
            ]
            misfit[k] = sum(_around(one) ** 2 for one in off)
        found: NDArray[np.int64] = np.argmin(misfit, axis=0)
        return np.where(_around(counts.astype(float)) > 0, found, 0)


def _grown(swing: Array, mean: Array, added: float) -> Array:
    """Growth of the mean range: noise that is larger by ν is light that is smaller by ν."""
    larger = np.sqrt(1 + added)
    grown: Array = larger * np.interp(swing / larger, swing, mean) - mean
    return grown


def _around(image: Array) -> Array:
    """Mean over neighbours on the lattice and over the colours."""
    near = ndimage.uniform_filter(image.mean(axis=2, keepdims=True), (_NEAR, _NEAR, 1))
    mean: Array = np.broadcast_to(near, image.shape)
    return mean


@lru_cache(maxsize=16)
def extrema_correction(n_frames: int, white_deviation: float | None = None) -> Correction:
    """Correction for the frames of a pitch where no place is known.

    Of the frames in which a pixel is lit, some may see it evenly lit (a number of them, the first
    kind all), the others less and less (by a step in contrast from each to the next): the pixel's
    footprint straddles an edge, or light that travelled tilts the plateau.

    Parameters
    ----------
    n_frames
        Of the pitch, ≥ 2.
    white_deviation
        See `Correction.of`.
    """
    half = max(n_frames // 2, 1)
    even = sorted({max(1, round(half * part)) for part in _EVEN_PARTS}, reverse=True)
    kinds = []
    for n_even in even:
        for step in _STEPS if n_even < half else _STEPS[:1]:
            falling = np.maximum(1 - step * np.arange(1, half - n_even + 1), 0.0)
            lit = np.concatenate([np.ones(n_even), falling])
            kinds.append(np.concatenate([lit, -lit]))
    return Correction.of(np.stack(kinds), white_deviation)


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
        Of the pixels of `processing.frame_noise.lattice`, (rows, columns, colours), see
        `Correction.kinds`; all are of the first kind where it is not given.
    leak
        b, as `direct_light` was separated with.
    """
    if kinds is None:
        kinds = np.zeros((1, 1, white.shape[-1]), np.int64)
    return _estimate(direct_light, white, kinds, noise, correction, (leak, 1.0, True))


def measured_kinds(
    sample: FrameSample, noise: FrameNoise, usable: NDArray[np.bool_], correction: Correction
) -> NDArray[np.int64]:
    """Kinds of the pixels of the lattice, for `extrema_estimate`.

    Parameters
    ----------
    sample
        The frames.
    noise
        Of a frame.
    usable
        bool, (rows, columns), True where a pixel of the lattice counts.
    correction
        The kinds.
    """
    light, growth = sample.growth(noise)
    counts = usable[..., np.newaxis] & np.isfinite(light)
    return correction.kinds(np.where(counts, light, 0), growth)


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
    basis = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    if np.linalg.matrix_rank(basis) < 3:
        raise ValueError(f"{len(angles)} phases do not fix a sinusoid: its three unknowns need 3")
    covariance = np.linalg.inv(basis @ basis.T)
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
            pixel, see `processing.footprint.contrast`.
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
    estimated, deviation = np.empty(white.shape, np.float32), np.empty(white.shape, np.float32)
    measured = kinds.size > kinds.shape[-1]
    step = lattice_step(white.shape) if measured else max(white.shape)
    half = np.hypot(correction.half, _KIND_SPREAD) if measured else correction.half
    # Both of an entry side by side: they are looked up together, all over the tables.
    tables = np.stack([correction.middle, half], axis=-1).astype(np.float32)
    _correct(
        direct_light, white, kinds, step, extrema, noise.constant, noise.slope, tables, 1 / STEP,
        leak, gain, estimated, deviation,
    )  # fmt: skip
    return Estimate(estimated, deviation)


@njit(cache=True, error_model="numpy")
def _look_up(table, at):  # type: ignore[no-untyped-def]
    """Middle and half width, linear between entries."""
    last = len(table) - 1
    index = min(int(at), last - 1)
    part = min(at - index, 1.0)
    middle = table[index, 0] + part * (table[index + 1, 0] - table[index, 0])
    half = table[index, 1] + part * (table[index + 1, 1] - table[index, 1])
    return middle, half, max(at - last, 0.0)


@njit(parallel=True, cache=True, error_model="numpy")
def _correct(  # type: ignore[no-untyped-def]
    direct, white, kinds, step, extrema, constant, slope, tables, per_step, leak, gain,
    estimated, deviation,
):  # fmt: skip
    height, width, colours = direct.shape
    for y in prange(height):
        for x in range(width):
            for c in range(colours):
                table = tables[kinds[y // step, x // step, c]]
                # The plain reading of the pattern alone; light halfway between lit and dark.
                reading = max(direct[y, x, c] * (1 - leak), 0.0) * per_step
                level = 0.5 * (1 + leak) * white[y, x, c]
                lit = dark = max(constant[c] + slope[c] * max(level, 0.0), 1e-30)
                if extrema:
                    one = np.sqrt(lit)
                    first, _, beyond = _look_up(table, reading / one)
                    swing = 0.5 * max((first + beyond / per_step) * one, 0.0)
                    lit = max(constant[c] + slope[c] * max(level + swing, 0.0), 1e-30)
                    dark = max(constant[c] + slope[c] * max(level - swing, 0.0), 1e-30)
                one = 0.5 * (np.sqrt(lit) + np.sqrt(dark)) * gain
                found, width_, beyond = _look_up(table, reading / one)
                # Errors of the two extrema add up in squares, their biases as they are.
                error = gain * np.sqrt(0.5 * (lit + dark)) / (1 - leak)
                estimated[y, x, c] = (found + beyond / per_step) * one / (1 - leak)
                deviation[y, x, c] = width_ * error
