"""Shares of the light, freed from scatter between neighbouring pixels.

What the fit of single pixels makes of direct and near light in a translucent region, or of any
light where the camera is out of focus, scatters from pixel to pixel more than the light does:
footprints and texture are known to some per cent, and light of short range is told from direct
light by what they leave.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.ranges.blur import PIXEL_PX2, Blur

Image = NDArray[np.float32]
Array = NDArray[np.float64]

_SIDE_PX = 5
# Light below this is none.
_DARK = 1e-9
# How many times a pixel's variance the camera's is where its lens begins to be out of focus:
# sharp ones were measured at up to 1.2 times.
_SHARP = 2.0


def unsharpness(blur: Blur) -> float:
    """How far a camera's blur is its lens's instead of its pixels', from 0 to below 1.

    0 where the blur was given without the camera's part.
    """
    return max(1 - _SHARP * PIXEL_PX2 / blur.camera_px2, 0.0) if blur.camera_px2 > 0 else 0.0


def smoothed(
    part: Image,
    whole: Image,
    region: NDArray[np.bool_],
    *,
    edges: float = 0.0,
    freed: float = 1.0,
    of: Image | None = None,
) -> Image:
    """A part of the light whose share of the whole is freed from scatter.

    The mean share over 5 × 5 pixels of the region, and of what the pixel's own differs from it the
    part that is no scatter: 1 − (scatter)/(variance), both over 5 × 5 (J.-S. Lee, Digital image
    enhancement and noise filtering by use of local statistics, IEEE Trans. Pattern Anal. Mach.
    Intell. 2, 1980, with the noise taken from the neighbours).

    Parameters
    ----------
    part, whole
        float32, (height, width), 0 ≤ part ≤ whole.
    region
        bool, (height, width): pixels that are freed, by each other.
    edges
        How far the share may have edges, from 0 to 1, beside which neighbours differ without
        scatter.
    freed
        What of the scatter is taken away, from 0 to 1.
    of
        float32, (height, width): what the share is of in the end; `whole` if it is not given.

    Returns
    -------
    float32, (height, width), `part` outside of the region.
    """
    boxes = ndimage.find_objects(region.astype(np.int8))
    if not boxes or freed == 0:
        return part
    box = boxes[0]
    share = _share(part[box], whole[box], region[box], edges, freed)
    found = part.copy()
    found[box] = np.where(region[box], share * (whole if of is None else of)[box], part[box])
    return found


def _share(
    part: Image, whole: Image, region: NDArray[np.bool_], edges: float, freed: float
) -> Array:
    weight = np.where(region, whole, 0).astype(np.float64)
    mine = np.where(region, part, 0).astype(np.float64)
    own = mine / np.maximum(weight, _DARK)
    wide = np.maximum(_mean(weight), _DARK)
    mean = _mean(mine) / wide
    variance = _mean(weight * (own - mean) ** 2) / wide
    scatter = np.zeros_like(own)
    if edges < 1:
        scatter += (1 - edges) * _from_neighbours(own, mine, weight) / wide
    if edges > 0:
        scatter += edges * _along_edges(own, np.where(_inner(region), weight, 0))
    taken = freed * np.minimum(scatter / np.maximum(variance, 1e-12), 1)
    share: Array = np.clip(own + taken * (mean - own), 0, 1)
    return share


def _from_neighbours(own: Array, mine: Array, weight: Array) -> Array:
    """Scatter where nothing has edges: a pixel against the mean of its eight neighbours."""
    beside = 9 * _mean(weight, 3) - weight
    others = np.where(beside > _DARK, (9 * _mean(mine, 3) - mine) / np.maximum(beside, _DARK), own)
    # A mean of eight scatters, too.
    return 8 / 9 * _mean(weight * (own - others) ** 2)


def _along_edges(own: Array, weight: Array) -> Array:
    """Scatter beside edges: against the mean of two opposite neighbours.

    In those two of four directions in which it is least, as an edge makes it large across.
    """
    padded = np.pad(own, 1)
    height, width = own.shape
    each = []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        ahead, behind = (
            padded[1 + sign * down :, 1 + sign * right :][:height, :width] for sign in (1, -1)
        )
        # A mean of two scatters, too.
        each.append(_mean(2 / 3 * weight * (own - (ahead + behind) / 2) ** 2))
    wide = _mean(weight)
    least: Array = np.sort(each, axis=0)[:2].mean(axis=0)
    return np.where(wide > _DARK, least / np.maximum(wide, _DARK), 0)


def _inner(region: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels with all of their neighbours."""
    inner: NDArray[np.bool_] = ndimage.binary_erosion(region, np.ones((3, 3), bool))
    return inner


def _mean(values: Array, side_px: int = _SIDE_PX) -> Array:
    mean: Array = ndimage.uniform_filter(values, side_px, mode="constant")
    return mean
