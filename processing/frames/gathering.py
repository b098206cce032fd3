"""All frames of a session as the harmonics of its pitches, in one pass."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign, PitchHarmonics
from processing.patterns import Family, Pattern

Image = NDArray[np.float32]


class Parked(Protocol):
    """Harmonics of a pitch, (4, height, width, colours), that are read in parts."""

    def __getitem__(self, part: tuple[slice, slice, slice], /) -> Image:
        """Some lines and columns; the first slice is the whole one."""
        ...


class HarmonicsStack:
    """Takes in frames one at a time, in any order, and keeps a few images a pitch.

    `is_paired` tells that every pitch has two frames, a pattern and its complement.

    Held are 4 images of the frames' shape a pitch, which may lie in files (4.4 GB for 23
    pitches of 4 megapixels in three colours; see `out` and `join`); 2 more for each pitch of which
    some but not all frames came; and 3 for all together.

    Parameters
    ----------
    patterns
        Everything that will be shown, in no particular order; white and black are left out.
    shape
        (height, width, colours) of the frames.
    projector_px
        (height, width) of the projector.
    out
        float32, (pitches, 4, height, width, colours), where the harmonics are gathered.
    """

    def __init__(
        self,
        patterns: Iterable[Pattern],
        shape: tuple[int, int, int],
        projector_px: tuple[int, int],
        out: Image | None = None,
    ) -> None:
        members: dict[tuple[Family, int], dict[Pattern, None]] = {}
        for pattern in patterns:
            if pattern.family.is_separable:
                members.setdefault((pattern.family, pattern.pitch_px), {})[pattern] = None
        if not members:
            raise ValueError("there is no pattern but white and black: nothing to gather")
        ordered = sorted(members, key=lambda key: (key[1], key[0]))
        self.designs = tuple(PitchDesign.of(tuple(members[key])) for key in ordered)
        paired = [design for design in self.designs if design.is_pair]
        if paired and len(paired) < len(self.designs):
            raise ValueError(
                f"{paired[0].family}:{paired[0].pitch_px} has two positions, other pitches have "
                "more; leave out the ones or the others"
            )
        self.is_paired = bool(paired)
        self._last_total: Image | None = None
        self.projector_px = projector_px
        wanted = (len(self.designs), 4, *shape)
        if out is not None and out.shape != wanted:
            raise ValueError(f"out has shape {out.shape}, the harmonics {wanted}")
        self._out = [None if out is None else out[k] for k in range(len(self.designs))]
        self._harmonics: dict[int, Image | Parked] = {}
        self._index = {key: k for k, key in enumerate(ordered)}
        self._open: dict[int, PitchHarmonics] = {}
        self._waiting = set(range(len(ordered)))
        self._doubled = np.zeros(shape, np.float32)
        self._n_doubled = 0
        self._lit = np.zeros(shape, np.float32)
        self._n_lit = 0
        self._power = np.zeros(shape, np.float32)
        self._n_power = 0

    def add(self, frame: Image, pattern: Pattern) -> None:
        """Take in one frame.

        Parameters
        ----------
        frame
            float32, (height, width, colours), linear, black subtracted.
        pattern
            What was shown; any of those announced, or white, or black, which is passed over.
        """
        if frame.shape != self._lit.shape:
            raise ValueError(f"frame has shape {frame.shape}, the others {self._lit.shape}")
        if pattern.family is Family.BLACK:
            return
        if pattern.family is Family.WHITE:
            self._lit += frame
            self._n_lit += 1
            return
        k = self._index.get((pattern.family, pattern.pitch_px), -1)
        if k not in self._waiting:
            raise ValueError(f"{pattern} was not announced, or all of its pitch are there already")
        if k not in self._open:
            shape = (frame.shape[0], frame.shape[1], frame.shape[2])
            self._open[k] = PitchHarmonics(self.designs[k], shape, self._out[k])
        self._open[k].add(frame, pattern)
        if self._open[k].is_complete:
            self._close(k)

    def join(self, gathered: PitchHarmonics, parked: Parked | None = None) -> None:
        """Take in a pitch whose frames were gathered elsewhere, all of them.

        Its harmonics are kept as they are, or as they are `parked`; the rest of it is no longer
        needed then.
        """
        design = gathered.design
        k = self._index.get((design.family, design.pitch_px), -1)
        if k not in self._waiting or k in self._open or not gathered.is_complete:
            raise ValueError(f"{design.family}:{design.pitch_px} is not waited for as a whole")
        self._open[k] = gathered
        self._close(k, parked)

    def _close(self, k: int, parked: Parked | None = None) -> None:
        gathered, design = self._open.pop(k), self.designs[k]
        self._harmonics[k] = gathered.harmonics if parked is None else parked
        # A line at a time: what is made on the way stays in the processor's cache.
        if design.is_balanced:
            for y, total in enumerate(gathered.total):
                self._doubled[y] += 2 * total
            self._n_doubled += len(design.patterns)
        if design.null is not None:
            for y, null in enumerate(gathered.null):
                self._power[y] += null**2
            self._n_power += 1
        if design.is_pair:
            self._compare_sums(gathered.total)
        self._waiting.discard(k)

    def _compare_sums(self, total: Image) -> None:
        """Sums of pairs are the same light: two of them differ by the noise of four frames."""
        if self._last_total is None:
            self._last_total = total.copy()
            return
        for y, one in enumerate(total):
            self._power[y] += (0.5 * (one - self._last_total[y])) ** 2
            self._last_total[y] = one
        self._n_power += 1

    def differences(self, lines: slice) -> Image:
        """First less second frame of every pair, of some lines.

        Parameters
        ----------
        lines
            Which lines.

        Returns
        -------
        float32, (pitches, lines, columns, colours).
        """
        self._check_complete()
        every = slice(None)
        return np.concatenate(
            [self._harmonics[k][:1, lines, every] for k in range(len(self.designs))]
        )

    def white(self) -> Image:
        """The scene under full light, float32, (height, width, colours).

        Twice the mean of all frames of balanced pitches, or the white frames where there is no
        balanced pitch.
        """
        self._check_complete()
        if self._n_doubled:
            return self._doubled / np.float32(self._n_doubled)
        if self._n_lit:
            return self._lit / np.float32(self._n_lit)
        raise ValueError("these patterns are not balanced: a white frame is needed beside them")

    def _check_complete(self) -> None:
        if self._waiting:
            missing = [self.designs[k] for k in sorted(self._waiting)]
            raise ValueError(
                "frames are missing of "
                + ", ".join(f"{design.family}:{design.pitch_px}" for design in missing)
            )

    @property
    def white_gain(self) -> float:
        """Variance of `white` where the frames have unit variance, black left aside."""
        if self._n_doubled:
            return 4 / self._n_doubled
        return 1 / max(self._n_lit, 1)

    def noise_variance(self) -> Image | None:
        """Variance of the noise of a frame in each pixel, mean over the pitches."""
        return self._power / np.float32(self._n_power) if self._n_power else None

    def harmonics(self, white: Image, lines: slice) -> NDArray[np.complex64]:
        """Z⁺ and Z⁻ of some lines, constant light subtracted.

        Parameters
        ----------
        white
            As `white` returns it.
        lines
            Which lines; with a step, columns are taken at the same step.

        Returns
        -------
        (pitches, 2, lines, columns, colours), of which each colour lies together in memory.
        """
        self._check_complete()
        columns = slice(None, None, lines.step)
        half = 0.5 * white[lines, columns]
        height, width, colours = half.shape
        pairs = np.empty((colours, len(self.designs), 2, height, width), np.complex64)
        for k, design in enumerate(self.designs):
            part = np.ascontiguousarray(self._harmonics[k][:, lines, columns])
            _pair(part, half, design.offset.astype(np.float32), k, pairs)
        return np.moveaxis(pairs, 0, -1)


@numba.njit(nogil=True, cache=True)
def _pair(part, half, offset, k, pairs):  # type: ignore[no-untyped-def]
    """Z⁺ and Z⁻ of pitch k without constant light, (colours, pitches, 2, lines, columns)."""
    for sign in range(2):
        real, imaginary = part[2 * sign], part[2 * sign + 1]
        real_offset, imaginary_offset = offset[2 * sign], offset[2 * sign + 1]
        for y in range(half.shape[0]):
            for colour in range(half.shape[2]):
                line = pairs[colour, k, sign, y]
                for x in range(half.shape[1]):
                    light = half[y, x, colour]
                    line[x] = complex(
                        real[y, x, colour] - real_offset * light,
                        imaginary[y, x, colour] - imaginary_offset * light,
                    )


def pixels_of(harmonics: NDArray[np.complex64], chosen: NDArray[np.bool_]) -> NDArray[np.complex64]:
    """Those (pitches, 2, n, colours) of `HarmonicsStack.harmonics` that are chosen.

    Parameters
    ----------
    harmonics
        (pitches, 2, lines, columns, colours).
    chosen
        bool, (lines, columns).
    """
    by_colour = np.moveaxis(harmonics, -1, 0)
    if chosen.all():
        return np.moveaxis(by_colour.reshape(*by_colour.shape[:3], -1), 0, -1)
    return np.moveaxis(by_colour[:, :, :, chosen], 0, -1)
