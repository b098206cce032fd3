"""Noise of an image, measured in the image itself, and the smoothing that it calls for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Standard deviation of a normal distribution over its median absolute value.
_MEDIAN_TO_DEVIATION = 1.4826
# The kernel (1, -2, 1)' (1, -2, 1) multiplies white noise by the root of its sum of squares.
_KERNEL_GAIN = 6.0
# Neighbourhoods that give the noise to 0.3 %; of larger images only some lines are looked at.
_ENOUGH = 1 << 18


def noise_deviation(image: NDArray[np.float32], mask: NDArray[np.bool_]) -> float:
    """Standard deviation of white noise in an image, whatever smooth picture lies below it.

    The difference of two Laplacians (Immerkær 1996) is blind to planes and to straight edges
    along rows and columns. Other edges are left out with the half of the neighbourhoods that
    has the larger Sobel gradients (Tai and Yang 2008), of which the difference is independent
    in white noise; the median of absolute values (Donoho 1995) stands what edges remain.

    Parameters
    ----------
    image
        float32, (height, width, colours), at least 3 pixels each way.
    mask
        bool, (height, width), True where a pixel is usable. Neighbourhoods of 3 × 3 that hold
        another pixel are left out.

    Returns
    -------
    Mean over the colours, in the unit of the image; 0 where no neighbourhood is left.
    """
    height, width = mask.shape
    if image.shape[:2] != (height, width) or min(height, width) < 3:
        raise ValueError(
            "noise is measured in 3 × 3 pixels and more: image and mask have shapes "
            f"{image.shape} and {mask.shape}"
        )
    spacing = -(-mask.size // _ENOUGH)
    above, at, below = (slice(k, height - 2 + k, spacing) for k in range(3))
    whole = mask[above] & mask[at] & mask[below]
    usable = whole[:, :-2] & whole[:, 1:-1] & whole[:, 2:]
    if not usable.any():
        return 0.0
    lines = image[above], image[at], image[below]
    along = lines[0] - 2 * lines[1] + lines[2]
    difference = (along[:, :-2] - 2 * along[:, 1:-1] + along[:, 2:])[usable]
    edges = _squared_sobel(*lines)[usable]
    quiet = edges <= np.median(edges)
    medians = np.median(np.abs(difference[quiet]), axis=0)
    return float(_MEDIAN_TO_DEVIATION / _KERNEL_GAIN * medians.mean())


def _squared_sobel(
    above: NDArray[np.float32], at: NDArray[np.float32], below: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Square of the gradient of lines, all colours together, (lines, width − 2)."""
    down = above + 2 * at + below
    right = down[:, 2:] - down[:, :-2]
    fall = below - above
    steep = fall[:, :-2] + 2 * fall[:, 1:-1] + fall[:, 2:]
    squared: NDArray[np.float32] = np.sum(right**2 + steep**2, axis=2)
    return squared
