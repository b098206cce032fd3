"""Frames of one pitch as two complex images, gathered while the frames are streamed.

A frame with shift (d, r) adds f·e^{iπd/P}·e^{±iπr/P} to two complex sums,

    Z⁺ = Σ f e^{iπ(d + r)/P},    Z⁻ = Σ f e^{iπ(d − r)/P}.

They are, for a checker, its strongest harmonics along both diagonals: with the projector
coordinate (y, x) of a camera pixel known, what every frame ought to have added is known too, and
the correlation of all frames with the decoded pattern follows from Z⁺ and Z⁻ alone
(`processing.ranges.response`). For stripes and sinusoids, which vary along one direction, Z⁻ is Z⁺
with d or r absent, and nothing changes.

A set of shifts that is no full grid is handled by least squares: the weights are those of the
fit of 1, cos·cos, cos·sin, sin·cos and sin·sin over the shifts instead of the plain sums.

Of a pattern along one direction and its complement, one pitch on, there is their difference alone,
Z⁺ = Z⁻ = f − f', which is real and tells no phase: it is read as a bit of a binary code
(`processing.ranges.two_positions`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import cos, sin, turned
from processing.patterns import Family, Pattern, balanced

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class PitchDesign:
    """How the frames of one family and pitch are combined.

    Parameters
    ----------
    family, pitch_px
        Of all the patterns.
    patterns
        In no particular order, no two alike.
    weights
        float64, (frames, 4): real and imaginary part of Z⁺, then of Z⁻.
    null
        float64, (frames,), a combination that no light can reach: frames of complementary
        patterns have equal weight, the weights add up to 0 and their squares to 1. None where
        fewer than two complementary pairs exist.
    is_grid
        The shifts are all pairs of some shifts down and some to the right.
    is_balanced
        The mean over the frames is half of white.
    is_pair
        A pattern that varies along one direction, and its complement.
    """

    family: Family
    pitch_px: int
    patterns: tuple[Pattern, ...]
    weights: NDArray[np.float64]
    null: NDArray[np.float64] | None
    is_grid: bool
    is_balanced: bool
    is_pair: bool

    @classmethod
    def of(cls, patterns: Sequence[Pattern]) -> PitchDesign:
        """The design for patterns of one family and pitch."""
        if not patterns:
            raise ValueError("a pitch has no patterns")
        kinds = {(pattern.family, pattern.pitch_px) for pattern in patterns}
        if len(kinds) > 1 or not patterns[0].family.is_separable:
            raise ValueError(f"a pitch has patterns of one family and pitch, not {sorted(kinds)}")
        if len(set(patterns)) < len(patterns):
            raise ValueError(f"{patterns[0].family}:{patterns[0].pitch_px} lists a shift twice")
        family, pitch_px = next(iter(kinds))
        down_px = np.array([pattern.shift_y_px for pattern in patterns])
        right_px = np.array([pattern.shift_x_px for pattern in patterns])
        is_grid = len(set(down_px)) * len(set(right_px)) == len(patterns)
        is_pair = _is_pair(patterns)
        return cls(
            family=family,
            pitch_px=pitch_px,
            patterns=tuple(patterns),
            weights=_weights(family, down_px, right_px, pitch_px, is_grid, is_pair=is_pair),
            null=null_weights(patterns),
            is_grid=is_grid,
            is_balanced=balanced(patterns),
            is_pair=is_pair,
        )

    @property
    def offset(self) -> NDArray[np.float64]:
        """(4,): what a pixel under the constant light 1 adds to Z⁺ and Z⁻."""
        total: NDArray[np.float64] = self.weights.sum(axis=0)
        return total


def _weights(
    family: Family,
    down_px: NDArray[np.int_],
    right_px: NDArray[np.int_],
    pitch_px: int,
    is_grid: bool,
    *,
    is_pair: bool,
) -> NDArray[np.float64]:
    down, right = np.pi * down_px / pitch_px, np.pi * right_px / pitch_px
    products = np.stack(
        [
            np.ones_like(down),
            cos(down) * cos(right),
            cos(down) * sin(right),
            sin(down) * cos(right),
            sin(down) * sin(right),
        ]
    )
    if is_pair:
        return np.array([[1.0, 0.0, 1.0, 0.0], [-1.0, 0.0, -1.0, 0.0]])
    unknowns = np.linalg.matrix_rank(products)
    needed = 5 if family is Family.CHECKER else 3
    if unknowns < needed:
        raise ValueError(
            f"{family}:{pitch_px} has {len(down_px)} shifts that fix {unknowns} of {needed} "
            "unknowns of a pixel; add shifts in the directions in which it varies"
        )
    if is_grid:
        sums = turned(np.stack([down + right, down - right], axis=1))
        split: NDArray[np.float64] = sums.view(np.float64)
        return split
    # Scaled as the sums over a grid are, so that noise weighs alike: n/4 (n/2 in one direction).
    # Their last bits, which are the processor's, go when frames are weighed in single precision.
    _, cc, cs, sc, ss = np.linalg.pinv(products).T * (len(down_px) / (4 if needed == 5 else 2))
    return np.stack([cc - ss, cs + sc, cc + ss, sc - cs], axis=1)


def null_weights(patterns: Sequence[Pattern]) -> NDArray[np.float64] | None:
    """Signs that alternate from one complementary pair to the next, (frames,).

    Frames of complementary patterns have equal weight, the weights add up to 0 and their squares
    to 1: no light can reach the sum. None where there are fewer than two such pairs.
    """
    pairs = complementary_pairs(patterns)
    pairs = pairs[: len(pairs) // 2 * 2]
    if not pairs:
        return None
    null = np.zeros(len(patterns))
    for sign, (first, second) in enumerate(pairs):
        null[[first, second]] = 1.0 if sign % 2 else -1.0
    scaled: NDArray[np.float64] = null / np.sqrt(np.sum(null**2))
    return scaled


def _is_pair(patterns: Sequence[Pattern]) -> bool:
    """Of a checker's product of two waves the sign tells neither's."""
    if len(patterns) != 2 or patterns[0].family is Family.CHECKER:
        return False
    first, second = patterns
    return _form(first, first.pitch_px) == _form(second, 0)


def complementary_pairs(patterns: Sequence[Pattern]) -> list[tuple[int, int]]:
    """Places, first the earlier one, of patterns that are each other's complement."""
    index = {_form(pattern, 0): k for k, pattern in enumerate(patterns)}
    return [
        (k, index[_form(pattern, pattern.pitch_px)])
        for k, pattern in enumerate(patterns)
        if index.get(_form(pattern, pattern.pitch_px), -1) > k
    ]


def _form(pattern: Pattern, advance_px: int) -> tuple[int, int]:
    """Shifts that give one and the same pattern, after an advance that complements it."""
    period_px = 2 * pattern.pitch_px
    down, right = pattern.shift_y_px, pattern.shift_x_px
    if pattern.family.varies_down:
        down += advance_px
    else:
        right += advance_px
    down, right = down % period_px, right % period_px
    if pattern.family is Family.CHECKER and right >= pattern.pitch_px:
        down, right = (down + pattern.pitch_px) % period_px, right - pattern.pitch_px
    return down, right


class PitchHarmonics:
    """Running sums over the frames of one pitch.

    Held are six images of the frames' shape, whatever the number of frames: four of Z⁺ and Z⁻,
    their mean and the null combination.

    Parameters
    ----------
    design
        What is going to be added.
    shape
        (height, width, colours) of the frames.
    out
        float32, (4, height, width, colours), where Z⁺ and Z⁻ are gathered; may be mapped from a
        file.
    """

    def __init__(
        self, design: PitchDesign, shape: tuple[int, int, int], out: Image | None = None
    ) -> None:
        if out is not None and out.shape != (4, *shape):
            raise ValueError(f"out has shape {out.shape}, not {(4, *shape)}")
        self.harmonics = np.empty((4, *shape), np.float32) if out is None else out
        self.total = np.empty(shape, np.float32)
        self.null = np.empty(shape, np.float32)
        self.begin(design)

    def begin(self, design: PitchDesign) -> None:
        """Begin anew: another pitch, in the memory of the one before."""
        for sums in (self.harmonics, self.total, self.null):
            sums.fill(0)
        self.design = design
        null = np.zeros(len(design.patterns)) if design.null is None else design.null
        self._weights = np.column_stack([design.weights, null]).astype(np.float32)
        self._index = {pattern: k for k, pattern in enumerate(design.patterns)}
        self._is_added = np.zeros((len(design.patterns), len(self.total)), np.bool_)

    @classmethod
    def whole(
        cls, design: PitchDesign, harmonics: Image, total: Image, null: Image
    ) -> PitchHarmonics:
        """All frames of a pitch, as another process gathered them."""
        found = cls(design, (len(total), 0, 0))
        found.harmonics, found.total, found.null = harmonics, total, null
        found._is_added[:] = True
        return found

    @property
    def is_complete(self) -> bool:
        """Every pattern of the design was added."""
        return bool(self._is_added.all())

    def add(self, frame: Image, pattern: Pattern) -> None:
        """Take in the frame of one pattern.

        Parameters
        ----------
        frame
            float32, (height, width, colours), linear, black subtracted.
        pattern
            One of the design that was not added before.
        """
        if frame.shape != self.total.shape:
            raise ValueError(f"frame has shape {frame.shape}, the others {self.total.shape}")
        self.add_lines(frame[np.newaxis], [pattern], slice(0, len(frame)))

    def add_lines(self, frames: Image, patterns: Sequence[Pattern], lines: slice) -> None:
        """Take in some lines of several frames.

        Parameters
        ----------
        frames
            float32, (frames, lines, width, colours), linear, black subtracted.
        patterns
            Of each frame: different ones of the design, of which these lines were not added before.
        lines
            Which ones.
        """
        total, null = self.total[lines], self.null[lines]
        if not total.flags.c_contiguous:
            raise ValueError(f"lines that follow one another are added at once, not {lines}")
        if frames.shape != (len(patterns), *total.shape):
            raise ValueError(
                f"frames have shape {frames.shape}, {len(patterns)} patterns and these lines of "
                f"the others {(len(patterns), *total.shape)}"
            )
        places = [self._place(pattern, lines) for pattern in patterns]
        first, second, third, fourth = (part[lines].reshape(-1) for part in self.harmonics)
        _accumulate(
            np.ascontiguousarray(frames, np.float32).reshape(len(frames), -1),
            self._weights[places],
            first,
            second,
            third,
            fourth,
            total.reshape(-1),
            null.reshape(-1),
        )

    def _place(self, pattern: Pattern, lines: slice) -> int:
        """Of a pattern in the design; from now on its lines are there."""
        place = self._index.get(pattern, -1)
        if place < 0 or self._is_added[place, lines].any():
            raise ValueError(f"{pattern} is not among the frames still expected of this pitch")
        self._is_added[place, lines] = True
        return place


# Pieces of this length stay in the first-level cache while all frames go over them.
_PIECE = 512


@numba.njit(nogil=True, cache=True)
def _accumulate(  # type: ignore[no-untyped-def]
    frames, weights, plus_real, plus_imaginary, minus_real, minus_imaginary, total, null
):
    """One read of some frames, (frames, values), feeds all six sums."""
    for start in range(0, total.size, _PIECE):
        stop = min(start + _PIECE, total.size)
        first, second = plus_real[start:stop], plus_imaginary[start:stop]
        third, fourth = minus_real[start:stop], minus_imaginary[start:stop]
        fifth, sixth = total[start:stop], null[start:stop]
        for k in range(len(frames)):
            values = frames[k, start:stop]
            a, b, c, d, e = (
                weights[k, 0], weights[k, 1], weights[k, 2], weights[k, 3], weights[k, 4]
            )  # fmt: skip
            for i in range(values.size):
                value = values[i]
                first[i] += a * value
                second[i] += b * value
                third[i] += c * value
                fourth[i] += d * value
                fifth[i] += value
                sixth[i] += e * value
