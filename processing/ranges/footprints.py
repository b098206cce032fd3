"""How large a camera pixel's footprint on the projector is, and which way it lies.

Where a surface is seen more steeply by the projector than by the camera, a camera pixel, and the
blur of the camera's lens with it, spread over more projector pixels. With J = ∂(place)/∂(camera
pixel), a blur of variance c² in camera pixels has the covariance c² J Jᵀ on the projector.

What is decoded is the mean place of the light in a pixel. Where texture or a shadow weights the
light, the mean moves less or more than the surface does: with J that of the surface and J' that of
the decoded places, the covariance under a Gaussian weight is c² J J'ᵀ (Tweedie's formula: the
variance of what is averaged is c² times the slope of its mean; Efron, Tweedie's formula and
selection bias, J. Am. Stat. Assoc. 106, 2011). J is J' averaged over a neighbourhood. Both are
taken from the smoother side of a pixel where its sides differ, so that depth edges do not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.ranges.place_lattice import UNIQUE, PlaceLattice

Array = NDArray[np.float64]

# Steeper than this many times the typical pixel is taken for an error of decoding.
_STEEPEST = 4.0
# Sides of a pixel that differ by less than this part of the smaller one lie on one surface.
_AGREEMENT = 0.7
# Neighbourhood over which the texture of a surface averages out.
_SURFACE_PX = 5


def footprints(
    places_px: NDArray[np.floating],
    mask: NDArray[np.bool_],
    step_px: float = 1.0,
    alike: PlaceLattice = UNIQUE,
) -> Array:
    """J J'ᵀ of every pixel in projector pixels squared, float64, (3, height, width): yy, xx, yx.

    Parameters
    ----------
    places_px
        (2, height, width), y and x of what each pixel sees; anything outside the mask.
    mask
        bool, (height, width), where they are known.
    step_px
        Distance between the pixels given, in camera pixels.
    alike
        Places that look alike.
    """
    known = np.where(mask, places_px, np.nan).astype(np.float64)
    # (y or x of the place, along columns or lines, height, width)
    slopes = np.stack([_slope(known, axis, alike) / step_px for axis in (1, 2)], axis=1)
    size = np.sum(slopes**2, axis=(0, 1))
    if not np.isfinite(size).any():
        return np.broadcast_to(np.array([1.0, 1.0, 0.0])[:, None, None], (3, *size.shape)).copy()
    typical = float(np.nanmedian(size))
    sound = size < _STEEPEST**2 * typical
    surface = _mean_over(slopes, sound)
    product = np.einsum("iahw,jahw->ijhw", np.where(sound, slopes, surface), surface)
    tensor = np.stack([product[0, 0], product[1, 1], (product[0, 1] + product[1, 0]) / 2])
    # Patterns that vary in one direction leave the other at 0.
    lost = ~((tensor[0] >= 0) & (tensor[1] >= 0) & (tensor[0] + tensor[1] > 0))
    tensor[:, lost] = np.array([0.5, 0.5, 0.0])[:, np.newaxis] * typical
    return tensor


def _mean_over(slopes: Array, sound: NDArray[np.bool_]) -> Array:
    """Mean over the sound pixels of a neighbourhood; NaN where there are none."""
    weight = ndimage.uniform_filter(sound.astype(np.float64), _SURFACE_PX, mode="nearest")
    kept = np.where(sound, slopes, 0)
    total = ndimage.uniform_filter(kept, (0, 0, _SURFACE_PX, _SURFACE_PX), mode="nearest")
    mean: Array = total / np.where(weight > 1e-6, weight, np.nan)
    return mean


def _slope(values: Array, axis: int, alike: PlaceLattice) -> Array:
    """Mean of the differences to the next and from the last pixel, or the smaller of the two.

    The smaller one where they differ much, the only one where there is one; else NaN.
    """
    step = alike.shortest(np.diff(values, axis=axis))
    edge = [(0, 0)] * values.ndim
    edge[axis] = (0, 1)
    ahead = np.pad(step, edge, constant_values=np.nan)
    edge[axis] = (1, 0)
    behind = np.pad(step, edge, constant_values=np.nan)
    size_ahead, size_behind = (np.nansum(np.abs(one), axis=0) for one in (ahead, behind))
    size_ahead[np.isnan(ahead).any(axis=0)] = np.inf
    size_behind[np.isnan(behind).any(axis=0)] = np.inf
    apart = np.sum(np.abs(ahead - behind), axis=0)
    one_surface = apart <= _AGREEMENT * np.minimum(size_ahead, size_behind)
    gentler = np.where(size_ahead <= size_behind, ahead, behind)
    chosen: Array = np.where(one_surface, (ahead + behind) / 2, gentler)
    return chosen
