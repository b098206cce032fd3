"""How much noise has added to max/min, read off the frames of a pitch themselves.

The largest of some frames f_k = μ_k + noise of deviation σ lies above the largest μ_k by a bias
that depends on how many others come within the noise of it: on an even plateau it is largest; on
one that travelled light tilts, or of which a footprint's edge takes off a part, it is smaller.
Two things tell. First, a frame and its complement add up to white W, so that the same light is
seen twice,

    e_k = a f_k + (1 − a) (W − f_k'),    a = σ_dark²/(σ_lit² + σ_dark²),

with less noise s = σ_lit σ_dark/√(σ_lit² + σ_dark²): 2 max e − W reads what max − min reads, with
less bias. Second, the rest of the bias is carried on from how such a reading G grows with further
noise (Cook and Stefanski, Journal of the American Statistical Association 89, 1994):

    G(s) − G(0) = 4.5 [G(√2 s) − G(s)] − 0.48 [G(3 s) − G(s)].

Of all weights whose absolute values add up to 5, these have the least error at the worst of many
plateaus (even ones of any part of the frames, straight and bent ones that fall by 0 to 60 s):
0.2 s for 4 to 18 pairs, where the bias of max e is up to 1.8 s. What is linear in means over
neighbours holds for any mixture of kinds. Another estimate could hardly do much better: a plateau
of 18 that falls by s has 0.41 s less bias than an even one, and growths that differ by 0.02 s and
0.06 s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.frames.frame_noise import FrameNoise, FrameSample
from processing.frames.harmonics import complementary_pairs

Array: TypeAlias = NDArray[np.float64]

# Variances of added noise in units of what is there, and what their growths count.
_ADDED = (1.0, 8.0)
_WEIGHTS = (4.5, -0.48)
_DRAWS = 3
# A dark frame's noise is carried on from brighter ones: its variance counts as at least this part
# of a lit frame's, so that an error of it weighs little.
_LEAST_DARK = 0.1


def reading_bias(
    sample: FrameSample, noise: FrameNoise, white: Array | None = None
) -> tuple[Array, Array]:
    """What max/min reads, and how much of that noise has added.

    Parameters
    ----------
    sample
        Frames of a binary pattern.
    noise
        Of a frame.
    white
        (rows, columns, colours), where direct light is 2 max(max f, W − min f) − W instead of
        max f − min f.

    Returns
    -------
    reading, bias
        (rows, columns, colours), in units of the mean noise of a lit and of a dark frame. The bias
        is that of a single pixel and noisy: only a mean over many is of use. The draws are the same
        at every call.
    """
    frames = sample.frames
    if white is not None:
        whole = white

        def complemented(some: Array) -> Array:
            found: Array = np.abs(2 * some - whole).max(axis=0)
            return found

        read = complemented(frames)
        grown = _extrapolated(frames, noise.deviation(frames), complemented)
        return _in_units(read, grown, white / 2, read - grown, noise)
    level, read = frames.mean(axis=0), np.ptp(frames, axis=0)
    pairs = complementary_pairs(sample.patterns)
    if 2 * len(pairs) < len(frames):
        grown = _extrapolated(frames, noise.deviation(frames), lambda some: np.ptp(some, axis=0))
        return _in_units(read, grown, level, read - grown, noise)
    lit, own = _joined(frames, pairs, noise)

    def doubled(some: Array) -> Array:
        found: Array = 2 * (some.max(axis=0) - level)
        return found

    steady = doubled(lit)
    bias = read - steady + _extrapolated(lit, own, doubled)
    return _in_units(read, bias, level, steady, noise)


def _joined(frames: Array, pairs: list[tuple[int, int]], noise: FrameNoise) -> tuple[Array, Array]:
    """e_k and its noise s, from frames that all have their complement."""
    first, second = (frames[[pair[k] for pair in pairs]] for k in (0, 1))
    lit, dark = np.maximum(first, second), np.minimum(first, second)
    level = frames.mean(axis=0)
    # The range would take dark frames for darker than they are.
    half = (lit - dark).max(axis=0) / 2
    for _ in range(2):
        bright, faint = (noise.deviation(level + end * half) ** 2 for end in (1, -1))
        least = np.maximum(faint, _LEAST_DARK * bright)
        part = least / np.maximum(bright + least, 1e-30)
        both = part * lit + (1 - part) * (2 * level - dark)
        half = both.max(axis=0) - level
    return both, np.sqrt(part**2 * bright + (1 - part) ** 2 * faint)


def _extrapolated(frames: Array, own: Array, reading: Callable[[Array], Array]) -> Array:
    """What noise of the deviation `own` has added to the reading of some frames."""
    plain = reading(frames)
    total = np.zeros_like(plain)
    rng = np.random.default_rng(0)
    for _ in range(_DRAWS):
        drawn = own * rng.standard_normal(frames.shape, np.float32)
        for variance, weight in zip(_ADDED, _WEIGHTS, strict=True):
            total += weight / _DRAWS * (reading(frames + np.sqrt(variance) * drawn) - plain)
    return total


def _in_units(
    reading: Array, bias: Array, level: Array, swing: Array, noise: FrameNoise
) -> tuple[Array, Array]:
    lit, dark = (noise.deviation(level + end * swing / 2) for end in (1, -1))
    unit = np.maximum((lit + dark) / 2, 1e-12)
    return reading / unit, bias / unit
