"""The contrast of a pattern in what a camera pixel sees of the projector's raster.

A pixel sees a square of side w around its place (y, x), in projector pixels. Averaged over it, the
code of a checker, ±1, is the product of what varies down and to the right,

    s = S(y + shift_y) S(x + shift_x),    S(t) = (T(t + w/2) − T(t − w/2))/w,

with the triangle wave T(t) = P − |t mod 2P − P| of the pitch P. A sinusoid keeps its shape.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.patterns import Family, Pattern

Array = NDArray[np.float64]


def contrast(pattern: Pattern, place_px: Array, footprint_px: float = 0.0) -> Array:
    """Contrast of a pattern at places, in [−1, 1].

    Parameters
    ----------
    pattern
        Any; 1 everywhere for white, −1 for black.
    place_px
        (2, …): y and x, counted from the upper and left edge of the raster (the centre of its
        first pixel is at ½).
    footprint_px
        w, side of the square that a pixel sees, ≥ 0.
    """
    if pattern.family.is_reference:
        return np.full(place_px.shape[1:], 1.0 if pattern.family is Family.WHITE else -1.0)
    seen: Array = np.ones(place_px.shape[1:])
    if pattern.family.varies_down:
        seen = seen * _wave(pattern, place_px[0] + pattern.shift_y_px, footprint_px)
    if pattern.family.varies_right:
        seen = seen * _wave(pattern, place_px[1] + pattern.shift_x_px, footprint_px)
    return seen


def _wave(pattern: Pattern, at: Array, footprint_px: float) -> Array:
    pitch_px = pattern.pitch_px
    if not pattern.family.is_binary:
        # A projector pixel holds one value: the cosine is averaged over its width as well.
        damping = np.sinc(footprint_px / (2 * pitch_px)) * np.sinc(0.5 / pitch_px)
        waved: Array = damping * np.cos(np.pi * (at - 0.5) / pitch_px)
        return waved
    if footprint_px == 0:
        return np.where(at % (2 * pitch_px) < pitch_px, 1.0, -1.0)
    reach = footprint_px / 2
    difference = _triangle(at + reach, pitch_px) - _triangle(at - reach, pitch_px)
    averaged: Array = difference / footprint_px
    return averaged


def _triangle(at: Array, pitch_px: int) -> Array:
    return pitch_px - np.abs(at % (2 * pitch_px) - pitch_px)
