"""Where the place on the projector jumps from one camera pixel to the next: depth edges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.ranges.place_lattice import UNIQUE, PlaceLattice

Array = NDArray[np.float64]
_Lines = tuple[slice, slice]

# In camera pixels: what is a jump on the projector, how far from one footprints are divided, how
# far to look for a neighbour that sees the second place, and how well they must agree.
_JUMP_PX = 2.0
_REACH_PX = 2
_NEIGHBOUR_PX = 3
_AGREEMENT_PX = 2.0


def near_jumps(
    places_px: NDArray[np.floating],
    mask: NDArray[np.bool_],
    scale_px: float,
    alike: PlaceLattice = UNIQUE,
) -> NDArray[np.bool_]:
    """Pixels beside which the place on the projector jumps, bool, (height, width).

    Parameters
    ----------
    places_px
        (2, height, width), y and x.
    mask
        bool, (height, width), where they are known.
    scale_px
        Usual distance on the projector between neighbouring pixels.
    alike
        Places that look alike.
    """
    jumps = np.zeros(mask.shape, bool)
    for ahead, behind, step_px in _neighbours(places_px, alike):
        jumped = (step_px > _JUMP_PX * scale_px) & mask[ahead] & mask[behind]
        jumps[ahead] |= jumped
        jumps[behind] |= jumped
    side = 2 * _REACH_PX - 1
    near: NDArray[np.bool_] = ndimage.binary_dilation(jumps, np.ones((side, side), bool)) & mask
    return near


def places_beside(places_px: NDArray[np.floating], pixels: NDArray[np.int64]) -> Array:
    """Places of the eight neighbours, float64, (2, n, 8); a pixel's own where there is none.

    Parameters
    ----------
    places_px
        (2, height, width), y and x; NaN where there is none.
    pixels
        (2, n): rows and columns.
    """
    height, width = places_px.shape[1:]
    own = places_px[:, pixels[0], pixels[1]]
    found = []
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            if down or right:
                row = np.clip(pixels[0] + down, 0, height - 1)
                column = np.clip(pixels[1] + right, 0, width - 1)
                place = places_px[:, row, column]
                found.append(np.where(np.isfinite(place).all(axis=0), place, own))
    return np.stack(found, axis=-1).astype(np.float64)


def seen_beside(
    places_px: NDArray[np.floating],
    pixels: NDArray[np.int64],
    second_px: Array,
    scale_px: float,
    alike: PlaceLattice = UNIQUE,
) -> NDArray[np.bool_]:
    """Whether a pixel nearby sees the second place as its only one.

    A mirror image of the pattern is a second place, too, but no neighbour sees it.

    Parameters
    ----------
    places_px, scale_px, alike
        As for `near_jumps`.
    pixels
        (2, n): rows and columns.
    second_px
        (2, n), see `processing.ranges.depth_edges.TwoPlaces`.
    """
    agreed = np.zeros(pixels.shape[1], bool)
    height, width = places_px.shape[1:]
    offsets = range(-_NEIGHBOUR_PX, _NEIGHBOUR_PX + 1)
    for down in offsets:
        for right in offsets:
            row = np.clip(pixels[0] + down, 0, height - 1)
            column = np.clip(pixels[1] + right, 0, width - 1)
            apart = np.abs(alike.shortest(places_px[:, row, column] - second_px)).max(axis=0)
            agreed |= apart < _AGREEMENT_PX * scale_px
    away = np.abs(alike.shortest(places_px[:, pixels[0], pixels[1]] - second_px)).max(axis=0)
    second: NDArray[np.bool_] = agreed & (away > _JUMP_PX * scale_px)
    return second


def up_to_jumps(
    region: NDArray[np.bool_],
    undecided: NDArray[np.bool_],
    places_px: NDArray[np.floating],
    scale_px: float,
    alike: PlaceLattice = UNIQUE,
) -> NDArray[np.bool_]:
    """A region with those undecided pixels beside it that see the same surface.

    Parameters
    ----------
    region
        bool, (height, width).
    undecided
        bool, (height, width): pixels beside a jump, of which nothing is known.
    places_px, scale_px, alike
        As for `near_jumps`.
    """
    grown = region.copy()
    for ahead, behind, step_px in _neighbours(places_px, alike):
        same = step_px < _JUMP_PX * scale_px
        grown[ahead] |= region[behind] & same & undecided[ahead]
        grown[behind] |= region[ahead] & same & undecided[behind]
    return grown


def _neighbours(
    places_px: NDArray[np.floating], alike: PlaceLattice
) -> Iterator[tuple[_Lines, _Lines, NDArray[np.floating]]]:
    """Pixels, those above or left of them, and how far their places are apart, each way."""
    on, back, every = slice(1, None), slice(None, -1), slice(None)
    for axis, ahead, behind in (
        (1, (on, every), (back, every)),
        (2, (every, on), (every, back)),
    ):
        yield ahead, behind, np.abs(alike.shortest(np.diff(places_px, axis=axis))).max(axis=0)
