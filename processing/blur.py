"""Blur of projector, lens and pixel, read off the scene itself.

Blur of variance s² a side lowers the harmonic of pitch P along one diagonal by exp(−π² s²/P²),
wherever the light came from. Spreads of 8 pixels and more have died out at the finest pitches, so
that in opaque parts of a scene the ratio of the slopes at two of them tells s², pixel by pixel.
Where light scatters below the surface it reads too large; the most frequent value (the mean of
the shortest half of all) is taken, which is right as long as most of the scene is opaque. The
variances along both diagonals may differ, as those of the two green pixels of a mosaic do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

# Slopes below this fraction of white are no basis for a ratio.
_LEAST_SLOPE = 0.08
# Two pairs of pitches must agree on the variance within this.
_AGREEMENT_PX2 = 1.0


BLUR_UNSURE = (
    "the blur of projector and camera could not be told from scattering: pitches that should "
    "show the same blur disagree, or too few are resolved; measure the blur on a board, and until "
    "then take direct light and subsurface scattering for estimates"
)


@dataclass(frozen=True, slots=True)
class Blur:
    """Blur of one colour, in projector pixels squared.

    Parameters
    ----------
    side_px2
        Variance along the rows and columns of the projector, ≥ 0.
    skew_px2
        Covariance between them: the variance of (y + x)/√2 is side + skew, of (y − x)/√2 side −
        skew.
    box_px
        Width of a camera pixel on the projector: as far as the variance allows, the blur is
        uniform over that width. 0 where it is unknown.
    """

    side_px2: float
    skew_px2: float = 0.0
    box_px: float = 0.0

    def widened(self, further_px2: NDArray[np.float64]) -> Blur:
        """With more variance along (y + x)/√2 and (y − x)/√2, nowhere below 0."""
        side_px2 = max(self.side_px2 + float(further_px2.mean()), 0.0)
        skew_px2 = self.skew_px2 + float(further_px2[0] - further_px2[1]) / 2
        return replace(self, side_px2=side_px2, skew_px2=min(max(skew_px2, -side_px2), side_px2))

    def diagonal_gain(self, pitch_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Factor of Z⁺ that the skew makes, and inverse of that of Z⁻; (pitches,)."""
        gain: NDArray[np.float64] = np.exp(-((np.pi / pitch_px) ** 2) * self.skew_px2)
        return gain


def further_blur(
    slopes: NDArray[np.float64], pitch_px: NDArray[np.float64], white: NDArray[np.float64]
) -> tuple[NDArray[np.float64], bool]:
    """Variance that the slopes show beyond the blur that they were corrected for.

    Parameters
    ----------
    slopes
        (n, pitches, 2), of sample pixels along both diagonals.
    pitch_px
        (pitches,), not decreasing; families of one pitch are averaged.
    white
        (n,), of the same pixels.

    Returns
    -------
    (2,) variance along (y + x)/√2 and (y − x)/√2, NaN where no two pitches can be compared, and
    whether a third pitch confirms it.
    """
    pitch_px, member = np.unique(pitch_px, return_inverse=True)
    slopes = np.stack([slopes[:, member == k].mean(axis=1) for k in range(len(pitch_px))], axis=1)
    typical = np.median(slopes.mean(axis=2) / white[:, np.newaxis], axis=0)
    usable = np.flatnonzero(typical > _LEAST_SLOPE)[:3]
    if len(usable) < 2:
        return np.full(2, np.nan), False
    rates = (np.pi / pitch_px[usable]) ** 2
    compared = np.maximum(slopes[:, usable], 1e-9)
    ratios = -np.diff(np.log(compared), axis=1) / np.diff(rates)[:, np.newaxis]
    modes = np.array([[shorth(ratios[:, k, d]) for d in range(2)] for k in range(len(rates) - 1)])
    confirmed = len(modes) > 1 and bool(np.all(np.abs(modes[1] - modes[0]) < _AGREEMENT_PX2))
    return modes[0], confirmed


def shorth(values: NDArray[np.float64]) -> float:
    """Mean of the shortest interval that holds half of the values."""
    ordered = np.sort(values)
    half = max(len(ordered) // 2, 1)
    widths = ordered[half:] - ordered[: len(ordered) - half]
    start = int(np.argmin(widths)) if len(widths) else 0
    return float(ordered[start : start + half].mean())
