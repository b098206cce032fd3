"""Gradients of images in which some pixels are not usable.

Smoothing is a normalised convolution, G * (mask · image) / (G * mask): a linear map of the
image that is the same for every row of D, so that D = A X holds for the smoothed images and
their gradients exactly, and no value of a masked pixel enters it.

Only the lines of which samples are taken are smoothed, all colours of a line together, by threads
that share out blocks of lines; neither their number nor the processor changes a bit.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import exp
from processing.numerics.strata import stratified
from processing.numerics.threads import in_threads

Image = NDArray[np.float32]
Lines = NDArray[np.int64]

# A smoothed pixel counts where at least this part of its Gaussian's weight was usable.
_LEAST_WEIGHT = 0.5
# Standard deviations after which the Gaussian ends.
_REACH = 3.0
_BLOCK_LINES = 16


def gradient_samples(
    images: Image,
    mask: NDArray[np.bool_],
    smoothing_px: float = 0.0,
    stride_px: int = 1,
) -> Image:
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
        A sample is taken in one of so many lines and columns, ≥ 1, see
        `processing.numerics.strata`.

    Returns
    -------
    float32, (colours, n, n_samples); all differences to the right in raster order, then all down.
    """
    if images.ndim != 4 or images.shape[1:3] != mask.shape:
        raise ValueError(
            "images must be (n, height, width, colours) and mask (height, width); "
            f"their shapes are {images.shape} and {mask.shape}"
        )
    lines = stratified(len(mask), stride_px)
    taps = _gaussian(smoothing_px)

    def sampled(first: int) -> tuple[Image, Image]:
        some = slice(first, first + _BLOCK_LINES)
        turns = np.arange(len(lines))[some]
        columns = np.stack([stratified(mask.shape[1], stride_px, turn) for turn in turns])
        return _sampled(images, mask, taps, lines[some], columns)

    blocks = in_threads(sampled, range(0, len(lines), _BLOCK_LINES))
    right, down = zip(*blocks, strict=True)
    samples: Image = np.concatenate([*right, *down], axis=-1)
    return samples


def _sampled(
    images: Image, mask: NDArray[np.bool_], taps: Image, lines: Lines, columns: Lines
) -> tuple[Image, Image]:
    """Differences to the right and down at some columns of some lines, (colours, n, samples)."""
    height, width = mask.shape
    n_images, n_colors = len(images), images.shape[3]
    reach = len(taps) - 1
    near = slice(max(lines[0] - reach, 0), min(lines[-1] + 2 + reach, height))
    # Each line, and the one below it, which the lowest line has not got.
    wanted = np.stack([lines, np.minimum(lines + 1, height - 1)], axis=1)
    kept = mask[near]
    whole = bool(kept.all())
    kept_values = np.repeat(kept, n_colors, axis=1)
    usable, weight = mask[wanted], None
    if reach and not whole:
        weight = _smoothed(kept.astype(np.float32), near.start, height, wanted, taps, 1)
        usable &= weight >= _LEAST_WEIGHT
        weight[~usable] = 1
        weight = np.repeat(weight, n_colors, axis=-1)
    usable[lines == height - 1, 1] = False
    room = (n_colors, n_images, columns.size)
    right, down = np.empty(room, np.float32), np.empty(room, np.float32)
    n_right = n_down = 0
    for index in range(n_images):
        part = images[index, near].reshape(len(kept), width * n_colors)
        if not whole:
            part = np.where(kept_values, part, np.float32(0))
        smooth = _smoothed(part, near.start, height, wanted, taps, n_colors)
        if weight is not None:
            smooth /= weight
        n_right, n_down = _take(smooth, usable, columns, right[:, index], down[:, index])
    return right[..., :n_right], down[..., :n_down]


def _gaussian(smoothing_px: float) -> Image:
    """Weights from the middle outwards, float32; the middle one alone where it is not smoothed."""
    if smoothing_px == 0:
        return np.ones(1, np.float32)
    places = np.arange(int(_REACH * smoothing_px + 0.5) + 1)
    weights = exp(-0.5 * (places / smoothing_px) ** 2)
    taps: Image = (weights / (2 * weights.sum() - weights[0])).astype(np.float32)
    return taps


def _smoothed(
    lines: Image, first: int, height: int, wanted: Lines, taps: Image, step: int
) -> Image:
    """Some lines of an image smoothed both ways, (…, values), the picture mirrored at its edges.

    Parameters
    ----------
    lines
        (lines, values), from line `first` of `height`; those wanted and what is near them.
    wanted
        Lines of the picture, any shape.
    taps
        Of the Gaussian, from the middle outwards.
    step
        Colours: the distance of the values of neighbouring pixels.
    """
    if len(taps) == 1:
        plain: Image = lines[wanted - first]
        return plain
    smooth = np.empty((wanted.size, lines.shape[1]), np.float32)
    _smooth(lines, first, height, wanted.ravel(), taps, step, smooth)
    both: Image = smooth.reshape(*wanted.shape, -1)
    return both


@numba.njit(cache=True)
def _mirrored(place, length):  # type: ignore[no-untyped-def]
    """The index at a place on, or beyond the edges: … 1 0 | 0 1 … n − 1 | n − 1 … ."""
    around = place % (2 * length)
    return around if around < length else 2 * length - 1 - around


# Only element by element, and nothing is contracted: vectors of any width give the same bits.
@numba.njit(cache=True, nogil=True)
def _smooth(lines, first, height, wanted, taps, step, out):  # type: ignore[no-untyped-def]
    reach, size = len(taps) - 1, lines.shape[1]
    width = size // step
    padded = np.empty(size + 2 * reach * step, np.float32)
    inner = padded[reach * step : reach * step + size]
    for k in range(len(wanted)):
        at, target, tap = lines[wanted[k] - first], out[k], taps[0]
        for i in range(size):
            inner[i] = tap * at[i]
        for t in range(1, reach + 1):
            above = lines[_mirrored(wanted[k] - t, height) - first]
            below = lines[_mirrored(wanted[k] + t, height) - first]
            tap = taps[t]
            for i in range(size):
                inner[i] += tap * (above[i] + below[i])
        for t in range(1, reach + 1):
            before, behind = _mirrored(-t, width) * step, _mirrored(width - 1 + t, width) * step
            for c in range(step):
                padded[(reach - t) * step + c] = inner[before + c]
                padded[(reach + width - 1 + t) * step + c] = inner[behind + c]
        tap = taps[0]
        for i in range(size):
            target[i] = tap * inner[i]
        for t in range(1, reach + 1):
            left, right = padded[(reach - t) * step :], padded[(reach + t) * step :]
            tap = taps[t]
            for i in range(size):
                target[i] += tap * (left[i] + right[i])


@numba.njit(cache=True, nogil=True)
def _take(smooth, usable, columns, right, down):  # type: ignore[no-untyped-def]
    """Fill `right` and `down`, (colours, samples), from pairs of lines; return how many of each."""
    n_colors, width = len(right), usable.shape[2]
    n_right = n_down = 0
    for k in range(len(columns)):
        at, below = smooth[k, 0], smooth[k, 1]
        for x in columns[k]:
            if not usable[k, 0, x]:
                continue
            place = x * n_colors
            if x + 1 < width and usable[k, 0, x + 1]:
                for c in range(n_colors):
                    right[c, n_right] = at[place + n_colors + c] - at[place + c]
                n_right += 1
            if usable[k, 1, x]:
                for c in range(n_colors):
                    down[c, n_down] = below[place + c] - at[place + c]
                n_down += 1
    return n_right, n_down
