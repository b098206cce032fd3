"""Direct and global light at every pitch, in files, and how sound they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.gathering import GatheredPitch, Gatherer
from acquire.references import References
from acquire.result import MaskRecord, PitchRecord, PixelClass, write_tiff
from acquire.session.folder import storage
from acquire.stack import PitchGroup, Stack
from processing.frames.frame_noise import FrameSample, lattice
from processing.frames.harmonics import PitchHarmonics
from processing.frames.optical_contrast import USABLE, OpticalContrast
from processing.frames.separation import Separation
from processing.frames.soundness import additivity_error, direct_peak, resolved_pitches

UNLIT_FRACTION = 0.01
BRIGHT_PERCENTILE = 99.5
# About so many pixels, evenly spread, tell how sound a pitch is.
JUDGED_PIXELS = 1 << 18
Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class SeparatedPitches:
    """What the frames say before any decomposition.

    Parameters
    ----------
    pitches
        Families and pitches in order, with the files of their direct and global images.
    white
        float32, (height, width, 3): white less black light.
    mask
        uint8, (height, width), `PixelClass`.
    references
        The uniform frames and what follows from them.
    samples
        Some pixels of all frames of each pitch.
    """

    pitches: tuple[PitchRecord, ...]
    white: Image
    mask: NDArray[np.uint8]
    references: References
    samples: tuple[FrameSample, ...]

    @property
    def resolved(self) -> tuple[PitchRecord, ...]:
        """The pitches that camera and projector resolve."""
        return tuple(pitch for pitch in self.pitches if pitch.resolved)

    def mask_record(self) -> MaskRecord:
        """The mask, counted."""
        return MaskRecord(
            pixels=self.mask.size,
            saturated=int(np.sum(self.mask == PixelClass.SATURATED)),
            unlit=int(np.sum(self.mask == PixelClass.UNLIT)),
        )


def separate_pitches(
    stack: Stack,
    references: References,
    folder: Path,
    leak: float,
    gatherer: Gatherer,
    hear: Callable[[PitchHarmonics], None],
    contrast: OpticalContrast | None = None,
) -> SeparatedPitches:
    """Write ``pitches/*.tiff`` into `folder`; holds one pitch's running extrema at a time.

    Parameters
    ----------
    stack
        The session's frames.
    references
        Those among them that show no pattern.
    folder
        The result folder; it exists.
    leak
        b, the fraction of its light that a dark projector pixel still emits, when no black
        frame was captured that could be subtracted.
    gatherer
        Goes through the frames of the pitches.
    hear
        Called with the harmonics of each pitch, where the gatherer brings them.
    contrast
        What the optics leave of patterns: direct light is divided by it. Pitches of which less
        than `processing.frames.optical_contrast.USABLE` is left are not resolved; without it, the
        scene itself tells.
    """
    lit = references.levels.lit
    with storage(folder):
        (folder / "pitches").mkdir(exist_ok=True)
    names = _names(stack.groups)
    pitches: list[PitchRecord] = []
    samples: list[FrameSample] = []
    whole = lit
    gathered = gatherer.gather(stack, references.levels)
    for group, name, found in zip(stack.groups, names, gathered, strict=True):
        left = None if contrast is None else _left(contrast, group, lit)
        samples.append(found.sample)
        if found.harmonics is not None:
            hear(found.harmonics)
        pitches.append(_write(folder, group, name, _freed(found.separation, left), left))
        if lit is None:
            mean = found.total / np.float32(len(group.frames))
            share = 2 / (1 + leak) * mean / np.float32(len(stack.groups))
            whole = share if whole is None else whole + share
        else:
            pitches[-1] = _judged(pitches[-1], group, found, lit, stack.saturated)
    if whole is None:
        raise StackError("There is no pitch to separate.")
    mask = _mask(whole, stack.saturated)
    return SeparatedPitches(_resolved(pitches), whole, mask, references, tuple(samples))


def open_rows(folder: Path, pitches: tuple[PitchRecord, ...]) -> list[Image]:
    """The direct images as they lie on the disk, one (height, width, 3) map a pitch."""
    return [tifffile.memmap(folder / pitch.direct, mode="r") for pitch in pitches]


def _left(contrast: OpticalContrast, group: PitchGroup, lit: Image | None) -> NDArray[np.float32]:
    """What the optics leave of a pitch's direct light, (3,)."""
    patterns = [frame.pattern for frame in group.frames]
    return contrast.left(patterns, with_white=lit is not None).astype(np.float32)


def _freed(separation: Separation, left: NDArray[np.float32] | None) -> Separation:
    """Direct light as it would be without blur; global light is the rest of both."""
    if left is None or left.min() < USABLE:
        return separation
    direct = separation.direct_light / left
    return Separation(direct, separation.direct_light + separation.global_light - direct)


def _names(groups: tuple[PitchGroup, ...]) -> list[str]:
    """``0008``, or ``stripes-rows-0008`` where several families were captured."""
    alone = len({group.family for group in groups}) == 1
    return [
        f"{group.pitch_px:04d}" if alone else f"{group.family}-{group.pitch_px:04d}"
        for group in groups
    ]


def _write(
    folder: Path,
    group: PitchGroup,
    name: str,
    separation: Separation,
    left: NDArray[np.float32] | None,
) -> PitchRecord:
    direct, global_ = f"pitches/direct-{name}.tiff", f"pitches/global-{name}.tiff"
    write_tiff(folder / direct, separation.direct_light)
    write_tiff(folder / global_, separation.global_light)
    return PitchRecord(
        family=group.family,
        pitch_px=group.pitch_px,
        shifts=len(group.frames),
        direct=direct,
        global_=global_,
        contrast=None if left is None else tuple(left.tolist()),
    )


def _judged(
    pitch: PitchRecord,
    group: PitchGroup,
    found: GatheredPitch,
    lit: Image,
    saturated: NDArray[np.bool_] | None,
) -> PitchRecord:
    at = lattice(lit.shape, JUDGED_PIXELS)
    white, direct = lit[at], found.separation.direct_light[at]
    usable = _mask(white, None if saturated is None else saturated[at]) == PixelClass.MEASURED
    if not usable.any():
        return pitch
    mean = found.total[at] / np.float32(len(group.frames))
    adds_up = group.is_balanced and not found.sample.is_ordered
    additivity = additivity_error(mean, white, usable) if adds_up else None
    peak = direct_peak(direct, white, usable)
    return pitch.model_copy(update={"additivity_error": additivity, "direct_peak": peak})


def _resolved(pitches: list[PitchRecord]) -> tuple[PitchRecord, ...]:
    """By a board where there is one, else by the scene."""
    by_board = [None if p.contrast is None else min(p.contrast) >= USABLE for p in pitches]
    peaks = [np.nan if pitch.direct_peak is None else pitch.direct_peak for pitch in pitches]
    return tuple(
        pitch.model_copy(update={"resolved": seen if told is None else told})
        for pitch, seen, told in zip(pitches, resolved_pitches(peaks), by_board, strict=True)
    )


def _mask(whole: Image, saturated: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Unlit: in no colour as bright as 1 % of the scene's bright parts."""
    mask = np.full(whole.shape[:2], PixelClass.MEASURED, np.uint8)
    brightness = whole.max(axis=-1)
    usable = brightness if saturated is None else brightness[~saturated]
    bright = float(np.percentile(usable, BRIGHT_PERCENTILE)) if usable.size else 0.0
    mask[brightness <= max(UNLIT_FRACTION * bright, 0.0)] = PixelClass.UNLIT
    if saturated is not None:
        mask[saturated] = PixelClass.SATURATED
    return mask
