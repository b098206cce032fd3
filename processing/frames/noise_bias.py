"""How much noise adds to max/min and to amplitudes at a pixel, in units of a frame's noise.

That depends on how many frames come near the extrema, and how near: on the kind of pixel. Where no
place is known, the kind is one whose bias is that of the pixels around
(`processing.frames.bias_reading`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.frames.bias_reading import reading_bias
from processing.frames.frame_noise import FrameNoise, FrameSample
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
# Direct light, in units of noise, from which a pixel tells its bias.
_TELLING = 6.0
# Side of the window on the lattice over which the bias is averaged.
_NEAR = 5
# Standard deviation of the bias among the pixels of a window, in units of noise: where there is
# none, and where there is as much as an even plateau has. Chosen on simulated scenes (pitches 10,
# 20, 44 and 88) and plateaus of any tilt.
_UNEVEN = (0.47, 0.18)
# Where white was made use of, all of the bias is carried on from its growth: standard deviation of
# the error of that.
_GROWTH_DOUBT = 0.4


@dataclass(frozen=True, slots=True)
class Correction:
    """What to make of max/min, or of an amplitude, in units of a frame's noise.

    Parameters
    ----------
    middle, half
        float64, (kinds, entries): `processing.frames.order_statistics.IntervalTable` for each kind
        of pixel; how many frames come near the extrema, and how near, makes the kind.
    uneven
        float64, (kinds, entries), standard deviation of the bias among neighbours of one kind.
    delta
        float64, (deltas,), direct light.
    reading
        float64, (kinds, deltas), what max/min reads there on average.
    """

    middle: Array
    half: Array
    uneven: Array
    delta: Array
    reading: Array

    @classmethod
    def of(
        cls, contrasts: Array | Sequence[Array], white_deviation: float | None = None
    ) -> Correction:
        """Correction of max/min for pixels with known contrasts.

        Parameters
        ----------
        contrasts
            (frames,) at the place of a pixel, see `processing.frames.footprint`; or those of
            several kinds of pixels.
        white_deviation
            None where direct light is max − min; where white was made use of,
            2 max(max f, W − min f) − W, the standard deviation of its noise over that of a frame.
        """

        def of_kind(kind: Array) -> _Kind:
            if white_deviation is None:
                return IntervalTable.of([range_distribution(kind)]), mean_extrema(kind)
            distribution = complemented_distribution(kind, white_deviation)
            return IntervalTable.of([distribution]), mean_range(distribution)

        several = [contrasts] if isinstance(contrasts, np.ndarray) else contrasts
        doubt = 0.0 if white_deviation is None else _GROWTH_DOUBT
        return cls._stacked(in_threads(of_kind, several), doubt)

    @classmethod
    def of_amplitude(cls) -> Correction:
        """Correction of the amplitude of a sinusoid."""
        return cls._stacked(
            [(IntervalTable.of([amplitude_distribution]), mean_range(amplitude_distribution))]
        )

    @classmethod
    def _stacked(cls, kinds: Sequence[_Kind], doubt: float = 0.0) -> Correction:
        rows = [table for table, _ in kinds]
        ratios = STEP * np.arange(max(len(row.middle) for row in rows), dtype=np.float64)
        filled = [row(ratios) for row in rows]
        middle, half = (np.stack([one[k] for one in filled]) for k in (0, 1))
        least, most = _UNEVEN
        part = np.clip((ratios - middle) / np.maximum(ratios - middle[0], 1e-9), 0, 1)
        uneven = np.hypot(least + (most - least) * part, doubt)
        delta, reading = kinds[0][1][0], np.stack([mean for _, (_, mean) in kinds])
        return cls(middle, half, uneven, delta, reading)

    def kinds(self, reading: Array, bias: Array) -> NDArray[np.int64]:
        """Which kind each pixel of a lattice is taken for: one that is biased as its neighbourhood.

        Parameters
        ----------
        reading, bias
            (rows, columns, colours), see `processing.frames.bias_reading.reading_bias`; a reading
            of 0 where a pixel is of no use.
        """
        counts = reading > _TELLING
        misfit = np.empty((len(self.middle), *reading.shape))
        for k, mean in enumerate(self.reading):
            expected = np.interp(reading, mean, mean - self.delta)
            misfit[k] = np.abs(_around(np.where(counts, bias - expected, 0)))
        found: NDArray[np.int64] = np.argmin(misfit, axis=0)
        return np.where(_around(counts.astype(float)) > 0, found, 0)


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
    # With white every frame stands beside every other, without it only lit ones beside lit ones.
    alike = max(n_frames // 2, 1) if white_deviation is None else n_frames
    even = sorted({max(1, round(alike * part)) for part in _EVEN_PARTS}, reverse=True)
    if white_deviation is not None:
        # Lit frames are noisier than the mean: their bias is that of more frames of mean noise.
        even += [2 * alike, 4 * alike]
    kinds = []
    for n_even in even:
        for step in _STEPS if n_even < alike else _STEPS[:1]:
            falling = np.maximum(1 - step * np.arange(1, alike - n_even + 1), 0.0)
            kinds.append(np.concatenate([np.ones(n_even), falling]))
    if white_deviation is None:
        return Correction.of([np.concatenate([lit, -lit]) for lit in kinds])
    turned = [lit * (-1.0) ** np.arange(len(lit)) for lit in kinds]
    return Correction.of(turned, white_deviation)


def measured_kinds(
    sample: FrameSample,
    noise: FrameNoise,
    usable: NDArray[np.bool_],
    correction: Correction,
    white: Array | None = None,
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
    white
        (rows, columns, colours), the white frame where `correction` is for one that was made use
        of.
    """
    reading, bias = reading_bias(sample, noise, white)
    counts = usable[..., np.newaxis] & np.isfinite(reading)
    return correction.kinds(np.where(counts, reading, 0), np.where(counts, bias, 0))
