"""How far one picture lies from another: phase correlation, then least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2

_STEPS = 6
# A window whose gradients hold less than so many times the energy of noise shows no movement.
LEAST_TEXTURE = 4.0


def movement(
    reference: NDArray[np.float32], picture: NDArray[np.float32], noise: float
) -> tuple[float, float] | None:
    """Shift of a picture against a reference, (down, right), in pixels.

    The peak of the phase correlation (Kuglin and Hines 1975) gives whole pixels, Gauss–Newton
    steps on the difference of the pictures the rest (Lucas and Kanade 1981). Both are weighted
    with a Hann window; a gain between the pictures is fitted along.

    Parameters
    ----------
    reference, picture
        float32, (height, width), of the same light.
    noise
        Variance of a pixel's noise in the picture.

    Returns
    -------
    None where the reference has too little texture for its noise.
    """
    if reference.shape != picture.shape:
        raise ValueError(f"pictures of {reference.shape} and {picture.shape} cannot be compared")
    height, width = reference.shape
    if min(height, width) < 8:
        return None
    hann = np.outer(np.hanning(height), np.hanning(width))
    first = reference.astype(np.float64)
    second = picture.astype(np.float64)
    slopes = np.gradient(first)
    texture = min(float(np.mean(hann * slope**2)) for slope in slopes)
    if texture <= LEAST_TEXTURE * noise * float(hann.mean()) / 2:
        return None
    shift = _whole_pixels(first, second, hann)
    for _ in range(_STEPS):
        step = _step(first, second, hann, shift)
        shift = shift + step
        if np.abs(step).max() < 1e-3:
            break
    return float(shift[0]), float(shift[1])


def _whole_pixels(
    first: NDArray[np.float64], second: NDArray[np.float64], hann: NDArray[np.float64]
) -> NDArray[np.float64]:
    one = rfft2(hann * (first - first.mean()))
    other = rfft2(hann * (second - second.mean()))
    cross = other * one.conj()
    surface = irfft2(cross / np.maximum(np.abs(cross), 1e-30), first.shape)
    peak = np.array(np.unravel_index(int(np.argmax(surface)), surface.shape), np.float64)
    size = np.array(first.shape)
    return np.where(peak > size / 2, peak - size, peak)


def _step(
    first: NDArray[np.float64],
    second: NDArray[np.float64],
    hann: NDArray[np.float64],
    shift: NDArray[np.float64],
) -> NDArray[np.float64]:
    moved = _shifted(second, shift)
    down, right = np.gradient(moved)
    columns = np.stack([moved, down, right])
    weighted = columns * hann
    normal = np.einsum("aij,bij->ab", weighted, columns)
    gain, along_y, along_x = np.linalg.lstsq(
        normal, np.einsum("aij,ij->a", weighted, first), rcond=None
    )[0]
    scale = gain if abs(gain) > 1e-3 else 1.0
    return np.clip(np.array([along_y, along_x]) / scale, -1, 1)


def _shifted(picture: NDArray[np.float64], shift: NDArray[np.float64]) -> NDArray[np.float64]:
    """Moved back by `shift`, linear between pixels, the edge repeated."""
    moved = picture
    for axis in (0, 1):
        size = picture.shape[axis]
        place = np.clip(np.arange(size) + shift[axis], 0, size - 1)
        left = np.minimum(place.astype(np.int64), size - 2)
        part = place - left
        part = part[:, np.newaxis] if axis == 0 else part
        low, high = np.take(moved, left, axis), np.take(moved, left + 1, axis)
        moved = (1 - part) * low + part * high
    return moved
