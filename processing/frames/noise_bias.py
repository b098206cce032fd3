"""How much noise adds to max/min and to amplitudes at a pixel, in units of a frame's noise.

That depends on how many frames come near the extrema, and how near: on the kind of pixel. Where no
place is known, the kind is recognised by what further noise adds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.frames.frame_noise import ADDED, FrameNoise, FrameSample
from processing.frames.order_statistics import (
    STEP,
    IntervalTable,
    amplitude_distribution,
    complemented_distribution,
    mean_extrema,
    mean_range,
    range_distribution,
)
from processing.numerics.threads import in_threads

Array: TypeAlias = NDArray[np.float64]
# Intervals, and the mean of R against δ.
_Kind: TypeAlias = tuple[IntervalTable, tuple[Array, Array]]

# Parts of the lit frames that see a pixel evenly lit, and steps of contrast between the others.
_EVEN_PARTS = (1.0, 0.72, 0.5, 0.33, 0.22, 0.11, 0.05)
_STEPS = (0.3, 0.1, 0.03, 0.01, 0.003)
# Direct light, in units of noise, from which the growth tells kinds apart.
_TELLING = 6.0
# By so much, in units of noise, the range of every kind is taken to be larger: of kinds that grow
# nearly alike the one of less bias is then found, which is right more often.
_LEAN = 0.125
# Side of the window on the lattice over which the growth is averaged.
_NEAR = 5


@dataclass(frozen=True, slots=True)
class Correction:
    """What to make of max/min, or of an amplitude, in units of a frame's noise.

    Parameters
    ----------
    middle, half
        float64, (kinds, entries): `processing.frames.order_statistics.IntervalTable` for each kind
        of pixel; how many frames come near the extrema, and how near, makes the kind.
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
            (frames,) at the place of a pixel, see `processing.frames.footprint`; or (kinds,
            frames).
        white_deviation
            None where direct light is max − min; where white was made use of,
            2 max(max f, W − min f) − W, the standard deviation of its noise over that of a frame.
        """

        def of_kind(kind: Array) -> _Kind:
            if white_deviation is None:
                return IntervalTable.of([range_distribution(kind)]), mean_extrema(kind)
            distribution = complemented_distribution(kind, white_deviation)
            return IntervalTable.of([distribution]), mean_range(distribution)

        return cls._stacked(in_threads(of_kind, list(np.atleast_2d(contrasts))))

    @classmethod
    def of_amplitude(cls) -> Correction:
        """Correction of the amplitude of a sinusoid."""
        return cls._stacked(
            [(IntervalTable.of([amplitude_distribution]), mean_range(amplitude_distribution))]
        )

    @classmethod
    def _stacked(cls, kinds: Sequence[_Kind]) -> Correction:
        rows = [table for table, _ in kinds]
        means = [(delta, mean + _LEAN) for _, (delta, mean) in kinds]
        ratios = STEP * np.arange(max(len(row.middle) for row in rows), dtype=np.float64)
        filled = [row(ratios) for row in rows]
        middle, half = (np.stack([one[k] for one in filled]) for k in (0, 1))
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
