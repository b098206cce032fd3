"""Places on the raster that no pattern tells apart.

Patterns of pitches P repeat every 2L, L their least common multiple: 480 px for pitches of 8, 12,
16, 24 and 40, 128 px for octaves of 8 to 64. A checker repeats along the diagonals already: (y, x),
(y + L, x + L) and (y + L, x − L) look alike. Which of them is decoded is chance, so two pixels are
as far apart as the nearest of those.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign


@dataclass(frozen=True, slots=True)
class PlaceLattice:
    """Steps between places that look alike.

    Parameters
    ----------
    half_px
        L; infinite where every place of the raster is one of its own.
    is_diagonal
        Whether both directions are told by checkers, and not each by its own patterns.
    """

    half_px: float = math.inf
    is_diagonal: bool = False

    @classmethod
    def of(cls, designs: Sequence[PitchDesign], projector_px: tuple[int, int]) -> PlaceLattice:
        """Of all patterns of a capture, on a projector of (height, width)."""
        checkers = [one for one in designs if one.family.varies_down and one.family.varies_right]
        half_px = math.lcm(*(one.pitch_px for one in checkers or designs))
        extent_px = sum(projector_px) if checkers else max(projector_px)
        return cls(half_px if 2 * half_px < extent_px else math.inf, bool(checkers))

    def shortest(self, step_px: NDArray[np.floating]) -> NDArray[np.floating]:
        """Of steps, (2, …), to all places that look alike those to the nearest."""
        if math.isinf(self.half_px):
            return step_px
        period_px = 2 * self.half_px
        if not self.is_diagonal:
            nearest: NDArray[np.floating] = step_px - period_px * np.round(step_px / period_px)
            return nearest
        down, right = step_px
        along, across = (np.round(one / period_px) for one in (down + right, down - right))
        diagonal: NDArray[np.floating] = step_px - self.half_px * np.stack(
            [along + across, along - across]
        )
        return diagonal


UNIQUE = PlaceLattice()
