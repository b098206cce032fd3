"""The frames of a session, pitch by pitch, in one read of each.

A few frames are decoded at a time, the next ones while these are worked through: some lines of all
of them, then the next ones, so that what is subtracted from a frame and what it is added to stay in
the processor's cache while they go over it. Threads decode and nothing else; one goes over the
frames in their order, which a number of threads cannot change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.frames import Batch
from acquire.references import FrameLevels, Levels
from acquire.stack import PitchGroup, Stack
from processing.frames.frame_noise import FrameSample, lattice
from processing.frames.harmonics import PitchDesign, PitchHarmonics
from processing.frames.separation import ExtremaSeparation, Separation, SinusoidSeparation
from processing.patterns import Pattern

# Values of the lines of a frame that are worked on at a time: with four frames and what they are
# added to, as in `processing.numerics.rows`, two to three megabytes.
_BLOCK_VALUES = 1 << 16
Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class GatheredPitch:
    """What the frames of one pitch come down to, until the next one is asked for.

    Parameters
    ----------
    total
        float32, (height, width, 3), the sum of the frames.
    separation
        Direct and global light.
    sample
        Some pixels of all frames.
    harmonics
        Where they are wanted.
    """

    total: Image
    separation: Separation
    sample: FrameSample
    harmonics: PitchHarmonics | None


class Gatherer(Protocol):
    """Goes through the frames of all pitches, here or elsewhere."""

    def gather(self, stack: Stack, levels: Levels) -> Iterator[GatheredPitch]:
        """Each group of the stack, in its order; the stack learns what is saturated."""
        ...


@dataclass(frozen=True, slots=True)
class LocalGatherer:
    """Decodes and separates in this process.

    Parameters
    ----------
    leak
        b of the projector.
    with_harmonics
        Whether they are wanted.
    frame_done
        Called after each frame.
    """

    leak: float
    with_harmonics: bool
    frame_done: Callable[[], None]

    def gather(self, stack: Stack, levels: Levels) -> Iterator[GatheredPitch]:
        """See `Gatherer.gather`."""
        return self.gather_groups(stack, stack.groups, levels)

    def gather_groups(
        self, stack: Stack, groups: Sequence[PitchGroup], levels: Levels
    ) -> Iterator[GatheredPitch]:
        """Some of the groups."""
        memory: _Memory | None = None
        sums: _Sums | None = None
        with closing(stack.batches([group.frames for group in groups])) as batches:
            for batch in batches:
                height, width, colours = batch.images[0].values.shape
                memory = memory or _Memory((height, width, colours))
                if sums is None:
                    sums = _Sums(groups[batch.group], memory, with_harmonics=self.with_harmonics)
                sums.add(batch, [levels.of(stack.order(one), width) for one in batch.frames])
                for _ in batch.frames:
                    self.frame_done()
                if batch.is_last:
                    yield sums.gathered(levels.lit, self.leak)
                    sums = None


class _Memory:
    """Images that one pitch after the other is gathered in.

    Taking new memory for each would cost as much time as the arithmetic.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.shape = shape
        self.room = Separation(np.empty(shape, np.float32), np.empty(shape, np.float32))
        self._separations: dict[bool, ExtremaSeparation | SinusoidSeparation] = {}
        self._harmonics: PitchHarmonics | None = None
        self._total: Image | None = None

    def separation(self, *, is_binary: bool) -> ExtremaSeparation | SinusoidSeparation:
        if is_binary not in self._separations:
            kind = ExtremaSeparation if is_binary else SinusoidSeparation
            self._separations[is_binary] = kind(self.shape)
        self._separations[is_binary].clear()
        return self._separations[is_binary]

    def harmonics(self, design: PitchDesign) -> PitchHarmonics:
        if self._harmonics is None:
            self._harmonics = PitchHarmonics(design, self.shape)
        else:
            self._harmonics.begin(design)
        return self._harmonics

    def total(self) -> Image:
        if self._total is None:
            self._total = np.empty(self.shape, np.float32)
        self._total.fill(0)
        return self._total


class _Sums:
    """What the frames of one pitch were added to so far."""

    def __init__(self, group: PitchGroup, memory: _Memory, *, with_harmonics: bool) -> None:
        self._group, self._memory = group, memory
        self._sample = FrameSample(group.patterns)
        self._separation = memory.separation(is_binary=group.family.is_binary)
        self._harmonics = memory.harmonics(_design(group)) if with_harmonics else None
        self._total = self._harmonics.total if self._harmonics else memory.total()

    def add(self, batch: Batch, levels: Sequence[FrameLevels]) -> None:
        """Go over some frames, from each of which something is taken off."""
        height, width, colours = self._memory.shape
        patterns = [frame.pattern for frame in batch.frames]
        self._sample_frames(batch, levels)
        step = max(1, _BLOCK_VALUES // (width * colours))
        room = np.empty((len(batch.frames), step, width, colours), np.float32)
        for start in range(0, height, step):
            lines = slice(start, min(start + step, height))
            block = room[:, : lines.stop - start]
            for out, image, level in zip(block, batch.images, levels, strict=True):
                level.even(image.values[lines], (lines, slice(None)), out)
            self._add_lines(block, patterns, lines)

    def _add_lines(self, block: Image, patterns: Sequence[Pattern], lines: slice) -> None:
        if isinstance(self._separation, ExtremaSeparation):
            self._separation.add_lines(block, lines)
        else:
            self._separation.add_lines(block, [pattern.phase for pattern in patterns], lines)
        if self._harmonics is not None:
            self._harmonics.add_lines(block, patterns, lines)
        else:
            total = self._total[lines]
            for frame in block:
                total += frame

    def _sample_frames(self, batch: Batch, levels: Sequence[FrameLevels]) -> None:
        at = lattice(self._memory.shape[:2])
        for frame, image, level in zip(batch.frames, batch.images, levels, strict=True):
            pixels = image.values[at].copy()
            level.even(pixels, at, pixels)
            self._sample.add_pixels(pixels, frame.pattern)

    def gathered(self, lit: Image | None, leak: float) -> GatheredPitch:
        """What they come down to, held against white less black."""
        group = self._group
        # A balanced set holds the complement of each pattern: white could add nothing but its noise
        # and any change of lamp or gain since. Extrema are nobody's complement.
        is_complete = group.is_balanced and not self._sample.is_ordered
        complement = lit if group.family.is_binary and not is_complete else None
        try:
            found = self._separation.separate(complement, leak, self._memory.room)
        except ValueError as error:
            raise StackError(
                f"{group.family} at pitch {group.pitch_px} cannot be separated: {error}."
            ) from error
        if lit is not None and not leak:
            np.subtract(lit, found.direct_light, out=found.global_light)
        return GatheredPitch(self._total, found, self._sample, self._harmonics)


def _design(group: PitchGroup) -> PitchDesign:
    try:
        return PitchDesign.of(group.patterns)
    except ValueError as error:
        raise StackError(f"{error}; `--method iva` takes such sessions.") from error
