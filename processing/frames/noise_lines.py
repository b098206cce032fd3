"""How the noise of a frame grows with its light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import least_squares
from processing.numerics.threads import in_threads

Image = NDArray[np.float32]
Array = NDArray[np.float64]

_BINS = 32


def noise_lines(variance: Image | None, white: Image, mask: NDArray[np.bool_]) -> Array:
    """Variance of a frame's noise against white, a line for each colour.

    Shot noise grows with the light, read noise does not; both are ≥ 0.

    Parameters
    ----------
    variance
        float32, (height, width, colours), noisy estimates pixel by pixel; None where unknown.
    white
        float32, (height, width, colours).
    mask
        bool, (height, width), True where a pixel counts.

    Returns
    -------
    (colours, 2): variance at white 0, and its rise with white; NaN where unknown.
    """
    colours = white.shape[2]
    if variance is None:
        return np.full((colours, 2), np.nan)
    measured = variance

    def line(colour: int) -> tuple[float, float]:
        return _line(white[..., colour][mask], measured[..., colour][mask])

    return np.array(in_threads(line, range(colours)), np.float64)


def _line(light: Image, variance: Image) -> tuple[float, float]:
    """Least squares through the means of bins that hold equally many pixels."""
    order = np.array_split(np.argsort(light, kind="stable"), min(_BINS, len(light)))
    at = np.array([light[part].mean(dtype=np.float64) for part in order])
    mean = np.array([variance[part].mean(dtype=np.float64) for part in order])
    if np.ptp(at) == 0:
        return float(mean.mean()), 0.0
    middle = at.mean()
    rows = np.stack([np.ones_like(at), at - middle], axis=1)
    expected = np.ones_like(at)
    for _ in range(3):
        level, slope = least_squares(rows / expected[:, np.newaxis], mean / expected)
        constant = level - slope * middle
        # Variances scatter in proportion to themselves: dark bins know the read noise best.
        expected = np.maximum(constant + slope * at, 0.1 * mean.mean())
    if slope < 0:
        return float(mean.mean()), 0.0
    if constant < 0:
        return 0.0, float(mean.sum() / at.sum())
    return float(constant), float(slope)
