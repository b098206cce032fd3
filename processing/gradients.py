"""Gradients of images in which some pixels are not usable.

Smoothing is a normalised convolution, G * (mask · image) / (G * mask): a linear map of the
image that is the same for every row of D, so that D = A X holds for the smoothed images and
their gradients exactly, and no value of a masked pixel enters it.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numba
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
    n_samples = np.count_nonzero(right) + np.count_nonzero(down)
    samples = np.empty((images.shape[3], images.shape[0], n_samples), np.float32)
    weight[~usable] = 1
    for index, image in enumerate(images):
        smooth = image if smoothing_px == 0 else _normalised(image, mask, weight, smoothing_px)
        _take_differences(smooth, right, down, stride_px, samples[:, index])
    return samples


def _normalised(
    image: NDArray[np.float32],
    mask: NDArray[np.bool_],
    weight: NDArray[np.float32],
    smoothing_px: float,
) -> NDArray[np.float32]:
    """Smoothed over usable pixels, (height, width, colours)."""
    smooth = np.empty_like(image)

    def fill(color: int) -> None:
        plane = np.where(mask, image[..., color], np.float32(0))
        np.divide(_smoothed(plane, smoothing_px), weight, out=smooth[..., color])

    with ThreadPoolExecutor(numba.get_num_threads(), thread_name_prefix="smooth") as threads:
        list(threads.map(fill, range(image.shape[2])))
    return smooth


@numba.njit(cache=True)
def _take_differences(image, right, down, stride_px, samples):  # type: ignore[no-untyped-def]
    """Fill `samples`, (colours, n), with the differences to the right, then with those down."""
    n = 0
    for usable, y_step, x_step in ((right, 0, 1), (down, 1, 0)):
        for line in range(usable.shape[0]):
            y = line * stride_px
            for column in range(usable.shape[1]):
                if usable[line, column]:
                    x = column * stride_px
                    for color in range(image.shape[2]):
                        samples[color, n] = (
                            image[y + y_step, x + x_step, color] - image[y, x, color]
                        )
                    n += 1


def _smoothed(plane: NDArray[np.float32], smoothing_px: float) -> NDArray[np.float32]:
    if smoothing_px == 0:
        return plane
    smooth: NDArray[np.float32] = ndimage.gaussian_filter(plane, smoothing_px, truncate=3)
    return smooth
