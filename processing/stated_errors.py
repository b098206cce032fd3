"""Standard errors of the components of light: from noise, and from what the model leaves out.

The noise of the frames is carried through the fit exactly (`processing.range_fit`). What the
ranges, the places and the footprints cannot express makes errors that no statistics of the frames
show. Five signs of them are at hand at every pixel; the model's error is their root sum of
squares, each times a coefficient:

- misfit: the formal error of the fit, larger where its residuals exceed the noise;
- rivalry: how far the direct light of an opaque and that of a translucent surface differ;
- roughness: root mean square, over 5 × 5 pixels, of what the direct share of white differs from
  the median of its 3 × 3 neighbours, times white;
- doubt: subsurface light, did the surface scatter, where it is held to be opaque;
- mixture: light that is not direct where the surface is held to be translucent.

The coefficients minimise the pinball loss at 72 % of log |error| over path-traced scenes
(`benchmarks.rendered_decomposition`: occluder, glossy, ball and clutter), every capture with the
same weight; where a capture of these was then covered at less than 60 % of its pixels, a
component's coefficients were all raised until none was. Subsurface light was calibrated on the
ball alone. Doubt and mixture share their coefficients where it is not: of the calibration scenes
the ball alone mixes. Shelf, wax and fruit were not fitted to.

`benchmarks.stated_errors_fit` fits them again to all captures of those four scenes, those with the
camera's lens out of focus among them, and leaves out each scene in turn. Its coefficients cover no
better than these, which an earlier fit to 13 of the captures made and which it does not reproduce.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Image = NDArray[np.float32]

SIGNS = ("misfit", "rivalry", "roughness", "doubt", "mixture")
# One row a component: direct, subsurface, inter-reflection; columns as `SIGNS`.
COEFFICIENTS = np.array(
    [
        [0.33, 0.21, 0.38, 0.13, 0.13],
        [0.0, 0.25, 2.74, 1.68, 0.0],
        [0.36, 0.24, 0.37, 0.09, 0.09],
    ]
)
_MEDIAN_PX, _MEAN_PX = 3, 5


def signs(
    misfits: Image,
    components: Image,
    rival: Image,
    scattered: Image,
    found: NDArray[np.bool_],
    mask: NDArray[np.bool_],
) -> tuple[Image, Image, Image, Image, Image]:
    """The five signs of one colour; all but the first are the same for every component.

    Parameters
    ----------
    misfits
        float32, (3, height, width), see `processing.account_fit.AccountFit`.
    components
        float32, (3, height, width): direct, subsurface, inter-reflection.
    rival
        float32, (height, width): direct light by the account that was not chosen.
    scattered
        float32, (height, width): subsurface light if the surface is translucent.
    found
        bool, (height, width), where it is.
    mask
        bool, (height, width), of measured pixels.

    Returns
    -------
    (3, height, width) and four times (height, width), in the unit of light, ≥ 0.
    """
    white = components.sum(axis=0)
    share = np.where(mask, components[0] / np.maximum(white, np.float32(1e-9)), np.float32(0))
    off = np.where(mask, share - ndimage.median_filter(share, _MEDIAN_PX), np.float32(0))
    power = ndimage.uniform_filter(off**2, _MEAN_PX)
    roughness: Image = np.sqrt(np.maximum(power, 0)) * white
    rest = components[1] + components[2]
    doubt = np.where(found, np.float32(0), np.minimum(scattered, rest))
    mixture = np.where(found, rest, np.float32(0))
    return misfits, np.abs(components[0] - rival), roughness, doubt, mixture


def model_errors(found: tuple[Image, Image, Image, Image, Image]) -> Image:
    """Standard errors that the model makes, float32, (3, height, width), from `signs`."""
    misfits, *shared = found
    squares = COEFFICIENTS[:, 0, np.newaxis, np.newaxis] ** 2 * misfits**2
    for column, sign in enumerate(shared, start=1):
        squares += COEFFICIENTS[:, column, np.newaxis, np.newaxis] ** 2 * sign**2
    errors: Image = np.sqrt(squares).astype(np.float32)
    return errors
