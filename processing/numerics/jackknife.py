"""Confidence of a figure of the whole picture, by leaving out one part of it after the other.

Neighbouring pixels share light, footprints and noise, so that they are no independent samples;
whole parts of a picture nearly are. With θ₍ⱼ₎ from all but part j of g, the jackknife's

    variance(θ) = (g − 1)/g Σ_j (θ₍ⱼ₎ − mean θ₍·₎)²

(Efron and Tibshirani, An Introduction to the Bootstrap, 1993, eq. 11.5). What all parts share (an
error of the blur, of the references) it cannot know.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
CONFIDENCE = 0.95
# Fewer parts say too little about how they scatter.
FEWEST_PARTS = 5.0
_TILES_A_SIDE = 8


def tiles(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The tile, 0 … 63, of each usable pixel of a picture cut 8 × 8, (n,) in raster order."""
    down, right = np.nonzero(mask)
    height, width = mask.shape
    rows, columns = (down * _TILES_A_SIDE // height), (right * _TILES_A_SIDE // width)
    labels: NDArray[np.int64] = rows * _TILES_A_SIDE + columns
    return labels


def half_width(without: Array, sizes: Array) -> Array:
    """Half of the 95 % confidence interval of estimates.

    By Student's t of (Σ m)²/Σ m² − 1 degrees of freedom: unequal parts count for fewer (Kish,
    Survey Sampling, 1965, section 11.7).

    Parameters
    ----------
    without
        (parts, ...): the estimates without each part.
    sizes
        m, (parts,): how much each holds, > 0.

    Returns
    -------
    (...), NaN where there are fewer than 5 such parts, or an estimate is not finite.
    """
    if sizes.shape != without.shape[:1]:
        raise ValueError(f"estimates {without.shape} do not belong to parts {sizes.shape}")
    parts = len(sizes)
    effective = float(sizes.sum() ** 2 / np.sum(sizes**2)) if parts else 0.0
    if effective < FEWEST_PARTS:
        return np.full(without.shape[1:], np.nan)
    variance = (parts - 1) * np.var(without, axis=0)
    # Rounded, so that its last bits, which are the library's, do not matter.
    quantile = round(float(stats.t.ppf(0.5 + CONFIDENCE / 2, effective - 1)), 9)
    found: Array = quantile * np.sqrt(variance)
    return found
