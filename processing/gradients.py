"""Gradients of images in which some pixels are not usable.

Smoothing is a normalised convolution, G * (mask · image) / (G * mask): a linear map of the
image that is the same for every row of D, so that D = A X holds for the smoothed images and
their gradients exactly, and no value of a masked pixel enters it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

# A smoothed pixel counts where at least this part of its Gaussian's weight was usable.
_LEAST_WEIGHT = 0.5


def gradient_samples(
    images: NDArray[np.float32],
    mask: NDArray[np.bool_],
    smoothing_px: float = 0.0,
    stride_px: int = 1,
) -> NDArray[np.float32]:
    """Differences to the right and down of smoothed images, between usable pixels.

    Parameters
    ----------
    images
        float32, (n, height, width, colours).
    mask
        bool, (height, width), True where a pixel is usable.
    smoothing_px
        Standard deviation of the Gaussian, ≥ 0; 0 takes the images as they are.
    stride_px
        Every so many lines and columns a sample is taken, ≥ 1.

    Returns
    -------
    float32, (colours, n, n_samples); all differences to the right, then all down.
    """
    if images.ndim != 4 or images.shape[1:3] != mask.shape:
        raise ValueError(
            "images must be (n, height, width, colours) and mask (height, width); "
            f"their shapes are {images.shape} and {mask.shape}"
        )
    weight = _smoothed(mask.astype(np.float32), smoothing_px)
    usable = mask & (weight >= _LEAST_WEIGHT)
    every = (slice(None, None, stride_px), slice(None, None, stride_px))
    right = (usable[:, 1:] & usable[:, :-1])[every]
    down = (usable[1:] & usable[:-1])[every]
    n_right, n_down = np.count_nonzero(right), np.count_nonzero(down)
    samples = np.empty((images.shape[3], images.shape[0], n_right + n_down), np.float32)
    weight[~usable] = 1
    for index, image in enumerate(images):
        for color in range(images.shape[3]):
            plane = np.where(mask, image[..., color], np.float32(0))
            plane = _smoothed(plane, smoothing_px) / weight
            samples[color, index, :n_right] = np.diff(plane, axis=1)[every][right]
            samples[color, index, n_right:] = np.diff(plane, axis=0)[every][down]
    return samples


def _smoothed(plane: NDArray[np.float32], smoothing_px: float) -> NDArray[np.float32]:
    if smoothing_px == 0:
        return plane
    smooth: NDArray[np.float32] = ndimage.gaussian_filter(plane, smoothing_px, truncate=3)
    return smooth
