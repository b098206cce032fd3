"""Where two frames a pitch are all there is: extrema, or two positions of a pattern."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.methods.components import Components, Image, Told
from acquire.methods.iva import Iva
from acquire.methods.ranges import Ranges, by_range
from acquire.pitches import SeparatedPitches, open_rows
from acquire.result import PitchRecord, PixelClass
from acquire.session.records import Caution
from processing.frames.frame_noise import FrameSample, lattice
from processing.frames.harmonics import PitchHarmonics
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
FROM_CODE = Caution(
    what="Every pitch has two positions, a pattern and its complement: where pixels look was read "
    "from them as a binary code, and ranges were found from one difference a pitch.",
    meaning="Light near a stripe's edge and far from it is told apart by neighbouring pixels, not "
    "by each pixel's own frames. On path-traced scenes direct light was off by one to two and a "
    "half times as much as from 23 pitches of 36 shifts (docs/accuracy.md).",
    remedy="Capture with the shifts of `lumisplit plan --example` where that can be afforded.",
)


class Pairs:
    """Where frames do not tell phases of the patterns.

    Two frames a pitch may be the largest and the smallest value of many shifts, or two positions
    of the pattern. Of the former the one is nowhere darker than the other, and ranges are found
    from them alone; of the latter half of the pixels are brighter in the second. Stripes in two
    positions are a binary code, which tells places; where it does not, or there are checkers,
    independent vector analysis is what is left.

    Parameters
    ----------
    obstacle
        Why there is no code; None where there is one.
    iva
        What is left; None where it was excluded.
    ranges
        Gathers the code where there is one.
    """

    def __init__(self, obstacle: str | None, iva: Iva | None, ranges: Ranges | None) -> None:
        self._obstacle, self._iva, self._ranges = obstacle, iva, ranges

    @property
    def wants_harmonics(self) -> bool:
        """See `Method.wants_harmonics`."""
        return self._ranges is not None

    def white(self, lit: Image) -> None:
        """See `Method.white`."""
        if self._ranges is not None:
            self._ranges.white(lit)

    def pitch(self, gathered: PitchHarmonics) -> None:
        """See `Method.pitch`."""
        if self._ranges is not None:
            self._ranges.pitch(gathered)

    def close(self) -> None:
        """See `Method.close`."""
        if self._ranges is not None:
            self._ranges.close()

    def decompose(self, folder: Path, separated: SeparatedPitches, told: Told) -> Components:
        """By ranges where the frames are extrema or a code, else by independent vector analysis."""
        resolved = tuple(sorted(separated.resolved, key=lambda pitch: pitch.pitch_px))
        distinct = len({pitch.pitch_px for pitch in resolved}) == len(resolved) > 1
        if distinct and all(sample.is_ordered for sample in separated.samples):
            return _from_extrema(folder, resolved, separated)
        obstacle = self._obstacle or ""
        if self._ranges is not None:
            try:
                components = self._ranges.decompose(folder, separated, told)
                return replace(components, cautions=(FROM_CODE, *components.cautions))
            except StackError as error:
                if self._iva is None:
                    raise
                obstacle = str(error).partition(";")[0]
        if self._iva is None:
            raise StackError(f"{obstacle}; `--method iva` takes such sessions.")
        components = self._iva.decompose(folder, separated, told)
        return replace(components, cautions=(_by_iva(obstacle), *components.cautions))


def _from_extrema(
    folder: Path, resolved: tuple[PitchRecord, ...], separated: SeparatedPitches
) -> Components:
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


def _by_iva(obstacle: str) -> Caution:
    return Caution(
        what="Decomposed by independent vector analysis, because the default method cannot be "
        f"used: {obstacle}.",
        meaning="The components have no standard errors, and nothing keeps them from being "
        "negative.",
        remedy="Capture with the shifts of `lumisplit plan --example` for the default method.",
    )


def _raised(sample: FrameSample, white: Image, usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """What noise adds to the two extreme frames of a pitch, see `raised_by_noise`."""
    every = lattice(usable.shape)
    largest, smallest = np.sort(sample.frames, axis=0)[::-1, usable[every]].astype(np.float32)
    return raised_by_noise(largest, smallest, white[every][usable[every]])
