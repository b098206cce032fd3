"""Where two frames a pitch are all there is: extrema by range, two positions by independence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.methods.components import Components, Image, OfPitches, Told
from acquire.methods.iva import Iva
from acquire.methods.ranges import by_range
from acquire.pitches import SeparatedPitches, open_rows
from acquire.result import PixelClass
from acquire.session.records import Caution
from processing.frames.frame_noise import FrameSample, lattice
from processing.patterns import Family
from processing.ranges.extrema import decompose_extrema, raised_by_noise

FROM_EXTREMA = Caution(
    what="Every pitch has two frames, of which one is nowhere darker than the other: they were "
    "taken for the largest and smallest value over many shifts, and ranges were found from them "
    "alone.",
    meaning="No places in the patterns are known: what noise adds to extreme frames is only "
    "taken off by how much they add up to more than white, shifts that miss the middle of a check "
    "enter in full, and translucent objects are recognised less well. "
    "What the import says of two shifts does not hold for extrema.",
    remedy="Capture or import all frames of every pitch where they exist.",
)


class Pairs(OfPitches):
    """Where frames do not tell the places of pixels in the patterns.

    Two frames a pitch may be the largest and the smallest value of many shifts, or two positions
    of the pattern. Of the former the one is nowhere darker than the other, and ranges are found
    from them alone; of the latter half of the pixels are brighter in the second, and independent
    vector analysis is what is left.
    """

    def __init__(self, obstacle: str, iva: Iva | None) -> None:
        self._obstacle, self._iva = obstacle, iva

    def decompose(self, folder: Path, separated: SeparatedPitches, told: Told) -> Components:
        """By ranges where the frames are extrema, else by independent vector analysis."""
        resolved = tuple(sorted(separated.resolved, key=lambda pitch: pitch.pitch_px))
        distinct = len({pitch.pitch_px for pitch in resolved}) == len(resolved) > 1
        if not (distinct and all(sample.is_ordered for sample in separated.samples)):
            if self._iva is None:
                raise StackError(f"{self._obstacle}; `--method iva` takes such sessions.")
            components = self._iva.decompose(folder, separated, told)
            return replace(components, cautions=(self._by_iva, *components.cautions))
        usable = separated.mask == PixelClass.MEASURED
        samples = dict(zip(separated.pitches, separated.samples, strict=True))
        raised = [_raised(samples[pitch], separated.white, usable) for pitch in resolved]
        found = decompose_extrema(
            open_rows(folder, resolved),
            [float(pitch.pitch_px) for pitch in resolved],
            [Family(pitch.family) for pitch in resolved],
            separated.white,
            usable,
            np.stack(raised),
        )
        components = by_range(found, [(pitch.family, pitch.pitch_px) for pitch in resolved])
        return replace(components, cautions=(FROM_EXTREMA, *components.cautions))

    @property
    def _by_iva(self) -> Caution:
        return Caution(
            what="Decomposed by independent vector analysis, because the default method cannot be "
            f"used: {self._obstacle}.",
            meaning="The components have no standard errors, and nothing keeps them from being "
            "negative.",
            remedy="Capture with the shifts of `lumisplit plan --example` for the default method.",
        )


def _raised(sample: FrameSample, white: Image, usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """What noise adds to the two extreme frames of a pitch, see `raised_by_noise`."""
    every = lattice(usable.shape)
    largest, smallest = np.sort(sample.frames, axis=0)[::-1, usable[every]].astype(np.float32)
    return raised_by_noise(largest, smallest, white[every][usable[every]])
