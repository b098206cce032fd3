"""Blur and noise of a whole capture, measured on its own frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.frames.gathering import HarmonicsStack
from processing.ranges.blur import BLUR_UNSURE, Blur, adjusted
from processing.ranges.correspondence import decode
from processing.ranges.footprints import footprints
from processing.ranges.place_lattice import UNIQUE, PlaceLattice
from processing.ranges.response import ResponseTables
from processing.ranges.slopes import slopes
from processing.remarks import Remark

Image = NDArray[np.float32]
Array = NDArray[np.float64]

_BLUR_ROUNDS = 3
# First guess: a sharp picture.
_SHARP_PX2 = 0.3
# Darker pixels, relative to the brightest, say nothing about blur.
_BRIGHT_FRACTION = 0.05
# A sharp picture's blur is all camera pixel, wider where surfaces are seen askew.
BOX_MARGIN = 1.15

NOISE_UNKNOWN = Remark(
    what="No pitch holds complementary pairs of frames, so the noise is unknown.",
    meaning="The standard errors hold the misfit of the model alone and are too small.",
    remedy="Capture with the shifts of `lumisplit plan --example`, of which each has its "
    "complement, or give a noise profile (`lumisplit calibrate noise`).",
)


@dataclass(frozen=True, slots=True)
class Sample:
    """Some pixels that stand for the picture.

    Parameters
    ----------
    harmonics
        complex64, (pitches, 2, n, colours), constant light subtracted.
    white
        float32, (n, colours).
    usable
        bool, (rows, columns): which pixels of a lattice over the picture they are.
    stride_px
        Of the lattice.
    """

    harmonics: NDArray[np.complex64]
    white: Image
    usable: NDArray[np.bool_]
    stride_px: int

    def footprints(self, places_px: Array, alike: PlaceLattice = UNIQUE) -> Array:
        """(3, n), see `processing.ranges.footprints`, from (2, n) places."""
        spread = np.full((2, *self.usable.shape), np.nan)
        spread[:, self.usable] = places_px
        found: Array = footprints(spread, self.usable, self.stride_px, alike)[:, self.usable]
        return found


def measured_blur(
    stack: HarmonicsStack, sample: Sample
) -> tuple[tuple[Blur, ...], tuple[Remark, ...]]:
    """Blur of each colour, and a warning where it cannot be trusted.

    Places are decoded and slopes corrected with the blur found so far, three times over.
    """
    blur = [Blur(_SHARP_PX2) for _ in range(sample.white.shape[1])]
    bright = sample.white > _BRIGHT_FRACTION * np.percentile(sample.white, 99.5)
    alike = PlaceLattice.of(stack.designs, stack.projector_px)
    unsure = False
    for _ in range(_BLUR_ROUNDS):
        tables = tables_for(stack, blur, np.zeros(1))
        places = decode(sample.harmonics, stack.designs, tables, stack.projector_px)
        shapes = sample.footprints(places.place_px.mean(axis=-1), alike)
        typical_px2 = float(np.median(shapes[:2]))
        unsure = False
        for colour, (one, table) in enumerate(zip(blur, tables, strict=True)):
            lit = bright[:, colour]
            seen = places.place_px[:, lit, colour]
            located = replace(
                one, footprint_px2=typical_px2, box_px=BOX_MARGIN * float(np.sqrt(typical_px2))
            )
            gains = located.gains(table.pitch_px, table.varies, shapes[:, lit])
            measured = slopes(sample.harmonics[:, :, lit, colour], seen, table, gains)
            white = sample.white[lit, colour].astype(np.float64)
            blur[colour], confirmed = adjusted(
                located, measured, table.pitch_px, white, shapes[:, lit]
            )
            unsure |= not confirmed
    return tuple(blur), (BLUR_UNSURE,) if unsure else ()


def projector_px_per_px(
    places_px: NDArray[np.floating], mask: NDArray[np.bool_], alike: PlaceLattice = UNIQUE
) -> float:
    """Typical distance on the projector between neighbouring pixels.

    Parameters
    ----------
    places_px
        (2, height, width), y and x.
    mask
        bool, (height, width), where they are known.
    alike
        Places that look alike.
    """
    both = mask[:-1, :-1] & mask[1:, :-1] & mask[:-1, 1:]
    if not both.any():
        return 1.0
    down = alike.shortest(np.diff(places_px, axis=1)[:, :, :-1][:, both])
    right = alike.shortest(np.diff(places_px, axis=2)[:, :-1][:, both])
    return max(float(np.median(np.sqrt(np.sum(down**2 + right**2, axis=0) / 2))), 0.1)


def tables_for(
    stack: HarmonicsStack, blur: Sequence[Blur], spread_px: Array
) -> tuple[ResponseTables, ...]:
    """Tables of all spreads, one for each colour."""
    return tuple(
        ResponseTables.of(stack.designs, spread_px, one.side_px2, one.box_px, one.error_px2)
        for one in blur
    )
