"""Noise of single samples: of the read-out, and of shots, whose variance grows with the light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Files of a computed scene have only the rounding of their counts.
LEAST_VARIANCE = 1e-10
FEWEST_PAIRS = 3


@dataclass(frozen=True, slots=True)
class SampleNoise:
    """Variance a + b·light.

    Parameters
    ----------
    read
        a, without any light.
    shot
        b, per unit of light.
    """

    read: float
    shot: float = 0.0

    def at(self, light: NDArray[np.floating]) -> NDArray[np.float64]:
        """Variance of samples of this light, same shape."""
        shot = self.shot * np.maximum(light.astype(np.float64), 0)
        variance: NDArray[np.float64] = np.maximum(self.read + shot, LEAST_VARIANCE)
        return variance


def noise_through(first: tuple[float, float], second: tuple[float, float]) -> SampleNoise:
    """The noise that has two variances at two lights, (light, variance) each; none negative."""
    (dark, low), (bright, high) = sorted((first, second))
    shot = max(high - low, 0.0) / max(bright - dark, 1e-12) if bright > dark else 0.0
    read = min(max(low - shot * dark, 0.0), low)
    return SampleNoise(read, (max(high, low) - read) / bright if bright > 0 and high > low else 0.0)


def noise_of_pairs(frames: NDArray[np.float32], pairs: list[tuple[int, int]]) -> SampleNoise | None:
    """Noise from the sums of complementary frames, (frames, n); None below three pairs.

    All the sums are white plus black. Each is scaled to the level of their median; the medians
    over the pairs stand a minority of wrong frames. The darker and the brighter half of the
    places tell the two kinds of noise apart.
    """
    if len(pairs) < FEWEST_PAIRS or frames.shape[1] < 2:
        return None
    stack = np.stack([frames[i].astype(np.float64) + frames[j] for i, j in pairs])
    levels = stack.mean(axis=1)
    stack *= (np.median(levels) / np.maximum(levels, 1e-9))[:, np.newaxis]
    typical = np.median(stack, axis=0)
    # The median of n values has π/(2n) of the variance of one (less so for few: on the safe side).
    own = 1 - 1 / len(stack)
    bright = typical > np.median(typical)
    if not bright.any() or bright.all():
        bright = np.arange(len(typical)) % 2 == 0
    points = []
    for half in (bright, ~bright):
        squares = np.mean((stack[:, half] - typical[half]) ** 2, axis=1)
        variance = float(np.median(squares)) / (2 * own)
        points.append((float(typical[half].mean()) / 2, variance))
    return noise_through(points[0], points[1])
