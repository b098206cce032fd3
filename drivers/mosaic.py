"""The counts of a Bayer sensor as linear light: one pixel a quad, or one a photosite."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivers.image import LinearImage

# A photosite counts as saturated from 1 % of the range below the white level: makers' white
# levels are medians, and response bends just below them.
SATURATION_MARGIN = 0.01
BAYER = frozenset({"RGGB", "GRBG", "GBRG", "BGGR"})

Counts: TypeAlias = NDArray[np.uint16]
Values: TypeAlias = NDArray[np.float32]
Flags: TypeAlias = NDArray[np.bool_]
Number = TypeVar("Number")
Four: TypeAlias = tuple[Number, Number, Number, Number]
Place: TypeAlias = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Mosaic:
    """What a Bayer sensor counted.

    Parameters
    ----------
    counts
        uint16, C-contiguous, (height, width) of the whole sensor, masked borders included.
    margin, size
        (top, left) and (height, width) of its visible part, at least 2 × 2 photosites.
    colours
        Of the visible part's first quad, row by row: one of `BAYER`.
    black
        Level of each photosite of that quad, in counts.
    white
        White level in counts, above every black level.
    """

    counts: Counts
    margin: Place
    size: Place
    colours: str
    black: Four[float]
    white: float

    def __post_init__(self) -> None:
        if self.colours not in BAYER:
            raise ValueError(f"a Bayer quad is one of {sorted(BAYER)}, not {self.colours!r}")
        ends = tuple(m + s for m, s in zip(self.margin, self.size, strict=True))
        inside = all(end <= side for end, side in zip(ends, self.counts.shape, strict=True))
        if min(self.size) < 2 or min(self.margin) < 0 or not inside:
            raise ValueError(
                f"counts of shape {self.counts.shape} do not hold {self.size} photosites "
                f"(at least 2 × 2) from {self.margin} on"
            )

    @property
    def gains(self) -> Four[float]:
        """Fraction of the range that a count of each photosite of the quad stands for."""
        return _four(1 / (self.white - black) for black in self.black)

    @property
    def limits(self) -> Four[int]:
        """Count from which each photosite of the quad is saturated."""
        return _four(
            int(np.ceil(self.white - SATURATION_MARGIN * (self.white - black)))
            for black in self.black
        )


def superpixels(mosaic: Mosaic, room: LinearImage | None = None) -> LinearImage:
    """A pixel for each quad: its red, the mean of its greens, its blue; nothing is interpolated.

    An odd last row or column is dropped.

    Parameters
    ----------
    mosaic
        What was counted.
    room
        An image no longer needed, whose memory is written over if it is of the right shape.

    Returns
    -------
    (height // 2, width // 2) pixels; `saturated` where any of the four photosites is.
    """
    image = _room((mosaic.size[0] // 2, mosaic.size[1] // 2), room)
    order = _four(sorted(range(4), key=lambda site: "RGB".index(mosaic.colours[site])))
    top, left = mosaic.margin
    _superpixels(
        mosaic.counts,
        _four((top + site // 2, left + site % 2) for site in order),
        _four(np.float32(mosaic.black[site]) for site in order),
        _four(np.float32(mosaic.gains[site]) for site in order),
        _four(np.uint16(mosaic.limits[site]) for site in order),
        image.values,
        image.saturated,
    )
    return image


def bilinear(mosaic: Mosaic, room: LinearImage | None = None) -> LinearImage:
    """A pixel for each photosite, the two colours that it lacks from its neighbours.

    A missing colour is the mean of the two or four nearest photosites that have it, each with its
    own black level subtracted, signed; beyond its edge the mosaic goes on mirrored. Parameters are
    those of `superpixels`.

    Returns
    -------
    (height, width) pixels; `saturated` where the photosite or any that was averaged is.
    """
    image = _room(mosaic.size, room)
    _bilinear(
        mosaic.counts,
        mosaic.margin,
        divmod(mosaic.colours.index("R"), 2),
        _four(np.float32(black) for black in mosaic.black),
        _four(np.float32(gain) for gain in mosaic.gains),
        _four(np.uint16(limit) for limit in mosaic.limits),
        image.values,
        image.saturated,
    )
    return image


def _four(numbers: Iterable[Number]) -> Four[Number]:
    first, second, third, fourth = numbers
    return first, second, third, fourth


def _room(size: Place, used: LinearImage | None) -> LinearImage:
    """Taken from numpy, which asks for huge pages: numba's own arrays take three times as long."""
    if used is not None and used.saturated.shape == size:
        return used
    return LinearImage(np.empty((*size, 3), np.float32), np.empty(size, np.bool_))


# Levels are passed as tuples: the compiler knows that what is written does not change them, and
# makes vector code of the loops.


@njit(cache=True, nogil=True)
def _superpixels(
    counts: Counts,
    first: Four[Place],
    black: Four[np.float32],
    gain: Four[np.float32],
    limit: Four[np.uint16],
    values: Values,
    saturated: Flags,
) -> None:  # pragma: no cover - compiled
    """Fill `values` and `saturated`; all fours are red, green, green, blue."""
    (red_y, red_x), (green_y, green_x), (other_y, other_x), (blue_y, blue_x) = first
    for i in range(values.shape[0]):
        _quads(
            counts[red_y + 2 * i, red_x:],
            counts[green_y + 2 * i, green_x:],
            counts[other_y + 2 * i, other_x:],
            counts[blue_y + 2 * i, blue_x:],
            black,
            gain,
            limit,
            values[i].reshape(-1),
            saturated[i],
        )


@njit(cache=True, nogil=True)
def _quads(
    red: Counts,
    green: Counts,
    other: Counts,
    blue: Counts,
    black: Four[np.float32],
    gain: Four[np.float32],
    limit: Four[np.uint16],
    values: Values,
    saturated: Flags,
) -> None:  # pragma: no cover - compiled
    """One row of quads."""
    half = np.float32(0.5)
    for j in range(saturated.shape[0]):
        values[3 * j] = (np.float32(red[2 * j]) - black[0]) * gain[0]
        values[3 * j + 1] = half * (
            (np.float32(green[2 * j]) - black[1]) * gain[1]
            + (np.float32(other[2 * j]) - black[2]) * gain[2]
        )
        values[3 * j + 2] = (np.float32(blue[2 * j]) - black[3]) * gain[3]
    for j in range(saturated.shape[0]):
        saturated[j] = (
            (red[2 * j] >= limit[0])
            | (green[2 * j] >= limit[1])
            | (other[2 * j] >= limit[2])
            | (blue[2 * j] >= limit[3])
        )


@njit(cache=True, nogil=True)
def _bilinear(
    counts: Counts,
    margin: Place,
    red: Place,
    black: Four[np.float32],
    gain: Four[np.float32],
    limit: Four[np.uint16],
    values: Values,
    saturated: Flags,
) -> None:  # pragma: no cover - compiled
    """Fill `values` and `saturated`; `red` is its place in the quad, row by row the fours."""
    height, width = saturated.shape
    # Row y of the sensor, scaled and mirrored at its ends, stands in line (y + 1) % 3.
    light = np.empty((3, width + 2), np.float32)
    full = np.empty((3, width + 2), np.bool_)
    for y in (1, 0):
        row = counts[margin[0] + y, margin[1] : margin[1] + width]
        _line(row, y, black, gain, limit, light[1 - y], full[1 - y])
    for y in range(height):
        above, here, below = y % 3, (y + 1) % 3, (y + 2) % 3
        following = y + 1 if y + 1 < height else height - 2
        row = counts[margin[0] + following, margin[1] : margin[1] + width]
        _line(row, following % 2, black, gain, limit, light[below], full[below])
        has_red = y % 2 == red[0]
        colour = red[1] if has_red else 1 - red[1]
        own = 0 if has_red else 2
        out = values[y].reshape(-1)
        _interpolate(light[above], light[here], light[below], colour, own, out)
        _spread(full[above], full[here], full[below], colour, saturated[y])


@njit(cache=True, nogil=True)
def _line(
    row: Counts,
    down: int,
    black: Four[np.float32],
    gain: Four[np.float32],
    limit: Four[np.uint16],
    light: Values,
    full: Flags,
) -> None:  # pragma: no cover - compiled
    """A row of photosites as light, and where it is saturated, with one mirrored at each end."""
    width = row.shape[0]
    for right in (0, 1):
        site = 2 * down + right
        offset, factor, ceiling = black[site], gain[site], limit[site]
        for j in range((width + 1 - right) // 2):
            light[1 + right + 2 * j] = (np.float32(row[right + 2 * j]) - offset) * factor
            full[1 + right + 2 * j] = row[right + 2 * j] >= ceiling
    light[0], light[width + 1] = light[2], light[width - 1]
    full[0], full[width + 1] = full[2], full[width - 1]


@njit(cache=True, nogil=True)
def _interpolate(
    above: Values, here: Values, below: Values, colour: int, own: int, values: Values
) -> None:  # pragma: no cover - compiled
    """One row of pixels whose columns `colour`, `colour` + 2, … have the colour `own`."""
    width = here.shape[0] - 2
    half, quarter = np.float32(0.5), np.float32(0.25)
    for j in range((width + 1 - colour) // 2):
        x = colour + 2 * j
        cross = (above[x + 1] + below[x + 1]) + (here[x] + here[x + 2])
        corners = (above[x] + below[x]) + (above[x + 2] + below[x + 2])
        values[3 * x + own] = here[x + 1]
        values[3 * x + 1] = quarter * cross
        values[3 * x + 2 - own] = quarter * corners
    green = 1 - colour
    for j in range((width + 1 - green) // 2):
        x = green + 2 * j
        values[3 * x + own] = half * (here[x] + here[x + 2])
        values[3 * x + 1] = here[x + 1]
        values[3 * x + 2 - own] = half * (above[x + 1] + below[x + 1])


@njit(cache=True, nogil=True)
def _spread(
    above: Flags, here: Flags, below: Flags, colour: int, saturated: Flags
) -> None:  # pragma: no cover - compiled
    """Saturation of one row of pixels, from the photosites that `_interpolate` reads."""
    width = saturated.shape[0]
    for x in range(width):
        saturated[x] = here[x] | here[x + 1] | here[x + 2] | above[x + 1] | below[x + 1]
    for j in range((width + 1 - colour) // 2):
        x = colour + 2 * j
        saturated[x] |= above[x] | above[x + 2] | below[x] | below[x + 2]
