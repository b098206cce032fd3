"""Standard errors of the components of light: from noise, and from what the model leaves out.

The noise of the frames is carried through the fit exactly (`processing.ranges.pixels`). What the
ranges, the places and the footprints cannot express makes errors that no statistics of the frames
show. Six signs of them are at hand at every pixel; the model's error is their root sum of
squares, each times a coefficient:

- misfit: the formal error of the fit, larger where its residuals exceed the noise;
- rivalry: how far the direct light of an opaque and that of a translucent surface differ;
- roughness: root mean square, over 5 × 5 pixels, of what the direct share of white differs from
  the median of its 3 × 3 neighbours, times white;
- doubt: subsurface light, did the surface scatter, where it is held to be opaque;
- mixture: light that is not direct where the surface is held to be translucent;
- defocus: misfit times the variance of the camera's blur beyond a pixel's, in camera pixels
  squared. A lens out of focus mixes the light of neighbours, as no blur of the projector does, and
  takes roughness away while the errors grow; they still go with misfit.

The coefficients minimise the pinball loss at 75 % of log |error| over all captures of eight
path-traced scenes (`benchmarks.rendered_decomposition`: two baselines, noise-free, noisy, projector
blurred, camera out of focus), every capture with the same weight: at that quantile direct light of
a scene that was left out is covered at 0.59 at least. They are what `benchmarks.stated_errors_fit`
prints, which tells what they cover of scenes left out as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.ranges.blur import PIXEL_PX2, Blur

Image = NDArray[np.float32]

SIGNS = ("misfit", "rivalry", "roughness", "doubt", "mixture", "defocus")
# One row a component: direct, subsurface, inter-reflection; columns as `SIGNS`.
COEFFICIENTS = np.array(
    [
        [0.26, 0.15, 0.48, 0.17, 0.1, 1.31],
        [0.0, 0.14, 1.87, 1.0, 0.17, 0.0],
        [0.36, 0.11, 0.43, 0.19, 0.04, 1.06],
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
    """All signs of one colour but defocus; the first alone differs between the components.

    Parameters
    ----------
    misfits
        float32, (3, height, width), see `processing.ranges.account_fit.AccountFit`.
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


def defocus_px2(blur: Blur) -> float:
    """Variance a side of the camera's blur beyond a sharp pixel's, in camera pixels squared, ≥ 0.

    0 where the blur was given without its camera's part.
    """
    return max(blur.camera_px2 - PIXEL_PX2, 0.0)


def model_errors(found: tuple[Image, Image, Image, Image, Image], beyond_px2: float) -> Image:
    """Standard errors that the model makes, float32, (3, height, width), from `signs`.

    Parameters
    ----------
    found
        Of `signs`.
    beyond_px2
        `defocus_px2` of the colour.
    """
    misfits, *shared = found
    squared = (COEFFICIENTS**2)[:, :, np.newaxis, np.newaxis]
    squares = (squared[:, 0] + squared[:, -1] * beyond_px2**2) * misfits**2
    for column, sign in enumerate(shared, start=1):
        squares += squared[:, column] * sign**2
    errors: Image = np.sqrt(squares).astype(np.float32)
    return errors
