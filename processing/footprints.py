"""How large a camera pixel's footprint on the projector is, and which way it lies.

Where a surface is seen more steeply by the projector than by the camera, a camera pixel, and the
blur of the camera's lens with it, spread over more projector pixels. With J = ∂(place)/∂(camera
pixel), a blur of variance c² in camera pixels has the covariance c² J Jᵀ on the projector. J is
taken from the decoded places themselves, from the smoother side of every pixel, so that depth
edges do not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]

# Steeper than this many times the typical pixel is taken for an error of decoding.
_STEEPEST = 4.0


def footprints(
    places_px: NDArray[np.floating], mask: NDArray[np.bool_], step_px: float = 1.0
) -> Array:
    """J Jᵀ of every pixel, float64, (3, height, width): yy, xx and yx, in projector pixels squared.

    Parameters
    ----------
    places_px
        (2, height, width), y and x of what each pixel sees; anything outside the mask.
    mask
        bool, (height, width), where they are known.
    step_px
        Distance between the pixels given, in camera pixels.
    """
    known = np.where(mask, places_px, np.nan).astype(np.float64)
    down, right = (_gentler(known, axis) / step_px for axis in (1, 2))
    tensor = np.stack(
        [
            down[0] ** 2 + right[0] ** 2,
            down[1] ** 2 + right[1] ** 2,
            down[0] * down[1] + right[0] * right[1],
        ]
    )
    size = tensor[0] + tensor[1]
    if not np.isfinite(size).any():
        return np.broadcast_to(np.array([1.0, 1.0, 0.0])[:, None, None], tensor.shape).copy()
    typical = float(np.nanmedian(size))
    wild = ~(size < _STEEPEST**2 * typical)
    tensor[:, wild] = np.array([0.5, 0.5, 0.0])[:, np.newaxis] * typical
    smooth: Array = ndimage.uniform_filter(tensor, (0, 3, 3), mode="nearest")
    return smooth


def _gentler(values: Array, axis: int) -> Array:
    """Difference to the next or from the last pixel, whichever is smaller; NaN where neither is."""
    step = np.diff(values, axis=axis)
    edge = [(0, 0)] * values.ndim
    edge[axis] = (0, 1)
    ahead = np.pad(step, edge, constant_values=np.nan)
    edge[axis] = (1, 0)
    behind = np.pad(step, edge, constant_values=np.nan)
    size_ahead, size_behind = (np.nansum(np.abs(one), axis=0) for one in (ahead, behind))
    size_ahead[np.isnan(ahead).any(axis=0)] = np.inf
    size_behind[np.isnan(behind).any(axis=0)] = np.inf
    chosen: Array = np.where(size_ahead <= size_behind, ahead, behind)
    return chosen
