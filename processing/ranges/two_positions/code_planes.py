"""Planes through the places of neighbouring pixels, of which those on other surfaces count little.

Places on a surface change evenly from pixel to pixel. A pixel's place is that of the plane fitted
to what its neighbours measured, each weighted by how well it knows its own place, by how near it
is, and by how well it agrees (a redescending weight, Geman and McClure 1985), so that depth edges
stay sharp.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import exp
from processing.ranges.kernels import compiled

Array = NDArray[np.float64]

_REACH_PX, _SIGMA_PX = 3, 1.5
# Disagreement that halves a weight's root, in finest pitches, and at least so many pixels.
_AGREEMENT, _LEAST_AGREEMENT_PX = 0.5, 0.75
# Steeper than this a surface is not looked for, in projector pixels a camera pixel.
_STEEPEST = 6.0
# A pixel keeps its own surface where this part of its neighbours lies on it.
_SUPPORT = 0.3
_FITS = 2
# Weight of what a pixel without knowledge of its own says, and what the gradient so far weighs.
_FLOOR, _GRADIENT_PRIOR = 0.02, 0.3


def gradients(places_px: Array, mask: NDArray[np.bool_]) -> Array:
    """∂(place)/∂(line, column), (2, lines, columns): the median of 5 × 5 central differences."""
    found = np.zeros((2, *mask.shape))
    _gradients(places_px, mask, found)
    return found


def smoothed(
    places_px: Array,
    steps_px: Array,
    precision: Array,
    mask: NDArray[np.bool_],
    slopes: Array,
    finest_px: float,
) -> tuple[Array, Array]:
    """Places and slopes of the planes.

    Parameters
    ----------
    places_px
        (lines, columns), so far.
    steps_px, precision
        (lines, columns): how far from it each pixel measured its place, and with what weight.
    mask
        bool, (lines, columns).
    slopes
        (2, lines, columns), so far.
    finest_px
        Finest pitch: what is farther apart than half of it lies on another surface.
    """
    agreement_px = max(_AGREEMENT * finest_px, _LEAST_AGREEMENT_PX)
    reach = np.arange(-_REACH_PX, _REACH_PX + 1, dtype=np.float64)
    near = exp(-0.5 * (reach[:, np.newaxis] ** 2 + reach**2) / _SIGMA_PX**2)
    found, turned = places_px.copy(), slopes.copy()
    _planes(places_px, places_px + steps_px, precision, mask, slopes, near, agreement_px, found,
            turned)  # fmt: skip
    return found, turned


@compiled
def _insert(ordered, count, value):  # type: ignore[no-untyped-def]
    """Into an increasing row of numbers."""
    at = count
    while at > 0 and ordered[at - 1] > value:
        ordered[at] = ordered[at - 1]
        at -= 1
    ordered[at] = value


@compiled
def _gradients(places, mask, found):  # type: ignore[no-untyped-def]
    height, width = mask.shape
    ordered = np.empty(25)
    for axis in range(2):
        down, right = 1 - axis, axis
        for y in range(height):
            for x in range(width):
                if not mask[y, x]:
                    continue
                count = 0
                for row in range(max(y - 2, down), min(y + 3, height - down)):
                    for column in range(max(x - 2, right), min(x + 3, width - right)):
                        if mask[row + down, column + right] and mask[row - down, column - right]:
                            rise = places[row + down, column + right]
                            rise -= places[row - down, column - right]
                            _insert(ordered, count, 0.5 * rise)
                            count += 1
                if count:
                    found[axis, y, x] = min(max(ordered[count // 2], -_STEEPEST), _STEEPEST)


@compiled
def _planes(  # type: ignore[no-untyped-def]
    places, measured, precision, mask, slopes, near, agreement, found, turned
):  # fmt: skip
    ordered = np.empty((2 * _REACH_PX + 1) ** 2)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x]:
                centre = _begin(places, measured, mask, slopes, y, x, agreement, ordered)
                _plane(
                    measured, precision, mask, slopes[0, y, x], slopes[1, y, x], near, agreement,
                    y, x, centre, found, turned,
                )  # fmt: skip


@compiled
def _begin(places, measured, mask, slopes, y, x, agreement, ordered):  # type: ignore[no-untyped-def]
    """The pixel's own place, or where few agree with that the median of its neighbours."""
    height, width = mask.shape
    rise, run, own = slopes[0, y, x], slopes[1, y, x], places[y, x]
    count, agreed = 0, 0
    for dy in range(-_REACH_PX, _REACH_PX + 1, 2):
        for dx in range(-_REACH_PX, _REACH_PX + 1, 2):
            row, column = y + dy, x + dx
            if 0 <= row < height and 0 <= column < width and mask[row, column]:
                value = measured[row, column] - rise * dy - run * dx
                _insert(ordered, count, value)
                count += 1
                agreed += abs(value - own) < 2 * agreement
    return own if agreed >= _SUPPORT * count or not count else ordered[count // 2]


@compiled
def _plane(  # type: ignore[no-untyped-def]
    measured, precision, mask, rise, run, near, agreement, y, x, centre, found, turned
):  # fmt: skip
    """Weighted least squares; the gradient is held to what it was."""
    height, width = mask.shape
    for _ in range(_FITS):
        w, wy, wx, wyy, wyx, wxx, b, by, bx = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for row in range(max(y - _REACH_PX, 0), min(y + _REACH_PX + 1, height)):
            for column in range(max(x - _REACH_PX, 0), min(x + _REACH_PX + 1, width)):
                if mask[row, column]:
                    dy, dx = row - y, column - x
                    away = measured[row, column] - centre
                    off = (away - rise * dy - run * dx) / agreement
                    trust = 1 / (1 + off * off)
                    weight = near[dy + _REACH_PX, dx + _REACH_PX] * trust * trust
                    weight *= precision[row, column] + _FLOOR
                    w += weight
                    wy += weight * dy
                    wx += weight * dx
                    wyy += weight * dy * dy
                    wyx += weight * dy * dx
                    wxx += weight * dx * dx
                    b += weight * away
                    by += weight * dy * away
                    bx += weight * dx * away
        hold = _GRADIENT_PRIOR * w
        wyy, wxx, by, bx = wyy + hold, wxx + hold, by + hold * rise, bx + hold * run
        # By elimination; w > 0, for the pixel itself counts.
        wyy, wyx, wxx = wyy - wy * wy / w, wyx - wy * wx / w, wxx - wx * wx / w
        by, bx = by - wy * b / w, bx - wx * b / w
        determinant = max(wyy * wxx - wyx * wyx, 1e-30)
        one, other = (by * wxx - bx * wyx) / determinant, (bx * wyy - by * wyx) / determinant
        centre += (b - wy * one - wx * other) / w
    found[y, x] = centre
    turned[0, y, x] = min(max(one, -_STEEPEST), _STEEPEST)
    turned[1, y, x] = min(max(other, -_STEEPEST), _STEEPEST)
