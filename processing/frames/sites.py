"""Places of a picture at which frames are compared: neighbouring pixels, two at each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.numerics.strata import stratified

Image: TypeAlias = NDArray[np.float32]
Index: TypeAlias = NDArray[np.int64]

_SITES = 4000
_SMALLEST_SIDE = 24
# Of the picture, down and to the right.
_TILES = 8


@dataclass(frozen=True, slots=True)
class Light:
    """A frame at the sites of its picture.

    Parameters
    ----------
    values
        float32, (2, n, colours), linear, black not taken off: either pixel of each site.
    usable
        bool, (n,): sites of which neither pixel is saturated.
    """

    values: Image
    usable: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Sites:
    """Spread over a picture.

    Parameters
    ----------
    shape
        (height, width) of the picture.
    """

    shape: tuple[int, int]

    def _places(self) -> tuple[Index, Index]:
        """Line and column of the first pixel of each, at no period that a pattern could have."""
        height, width = self.shape
        step = max(2, int(np.sqrt(height * width / _SITES)))
        lines = stratified(height - 1, step)
        columns = [stratified(width - 1, step, turn) for turn in range(len(lines))]
        return np.repeat(lines, len(columns[0])), np.concatenate(columns)

    @property
    def suffice(self) -> bool:
        """Whether the picture is large enough to tell anything."""
        return min(self.shape) >= _SMALLEST_SIDE

    @property
    def tiles(self) -> Index:
        """Number of the tile of each, 8 × 8 over the picture, (n,)."""
        lines, columns = self._places()
        down, right = lines * _TILES // self.shape[0], columns * _TILES // self.shape[1]
        return down * _TILES + right

    def light(self, image: Image, saturated: NDArray[np.bool_]) -> Light:
        """A frame, (height, width, colours), and its saturated pixels, (height, width)."""
        lines, columns = self._places()
        near = lines + 1, columns + 1
        values = np.stack([image[lines, columns], image[near]])
        return Light(values, ~(saturated[lines, columns] | saturated[near]))
