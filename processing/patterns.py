"""Patterns as codes: what each projector pixel emits, exactly as encoder and decoder share it.

A pattern's code is the light of a projector pixel as a fraction of white, in [0, 1]. With the
pitch P (side of a check, width of a stripe, half a period of a sinusoid) in projector pixels:

- ``checker``: 1 where floor((x + shift_x)/P) + floor((y + shift_y)/P) is even, else 0;
- ``stripes-columns``: 1 where floor((x + shift_x)/P) is even; ``stripes-rows`` the same in y;
- ``sinusoid-columns``: ½(1 + cos(π (x + shift_x)/P)); ``sinusoid-rows`` the same in y.

Row 0 is the top of what is projected, x counts columns from the left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray


class Family(StrEnum):
    """The kinds of pattern."""

    WHITE = "white"
    BLACK = "black"
    CHECKER = "checker"
    STRIPES_COLUMNS = "stripes-columns"
    STRIPES_ROWS = "stripes-rows"
    SINUSOID_COLUMNS = "sinusoid-columns"
    SINUSOID_ROWS = "sinusoid-rows"

    @property
    def is_reference(self) -> bool:
        """Uniform light: white or black."""
        return self in {Family.WHITE, Family.BLACK}

    @property
    def is_binary(self) -> bool:
        """Every pixel is either fully lit or dark."""
        return self not in {Family.SINUSOID_COLUMNS, Family.SINUSOID_ROWS}

    @property
    def varies_down(self) -> bool:
        """The code depends on the row."""
        return self in {Family.CHECKER, Family.STRIPES_ROWS, Family.SINUSOID_ROWS}

    @property
    def varies_right(self) -> bool:
        """The code depends on the column."""
        return self in {Family.CHECKER, Family.STRIPES_COLUMNS, Family.SINUSOID_COLUMNS}


@dataclass(frozen=True, slots=True)
class Pattern:
    """One pattern: family, pitch and shift, in projector pixels.

    Parameters
    ----------
    family
        What is drawn.
    pitch_px
        Side of a check, width of a stripe or half a period, ≥ 1; 0 for white and black.
    shift_y_px, shift_x_px
        Offset down and right, ≥ 0; 0 along a direction in which the pattern does not vary.
    """

    family: Family
    pitch_px: int = 0
    shift_y_px: int = 0
    shift_x_px: int = 0

    def __post_init__(self) -> None:
        reference = self.family.is_reference
        if reference and (self.pitch_px, self.shift_y_px, self.shift_x_px) != (0, 0, 0):
            raise ValueError(f"{self.family} has neither pitch nor shift")
        if not reference and self.pitch_px < 1:
            raise ValueError(f"{self.family} needs a pitch of at least 1 px, not {self.pitch_px}")
        if self.shift_y_px < 0 or self.shift_x_px < 0:
            raise ValueError(f"shifts count from 0, not {self.shift_y_px}, {self.shift_x_px}")
        if self.shift_y_px and not self.family.varies_down:
            raise ValueError(f"{self.family} does not vary down: shift_y_px must be 0")
        if self.shift_x_px and not self.family.varies_right:
            raise ValueError(f"{self.family} does not vary to the right: shift_x_px must be 0")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``white``, ``checker:8``, ``checker:8:0,2``, ``stripes-rows:16:4`` and the like."""
        name, _, rest = text.strip().partition(":")
        known = ", ".join(family.value for family in Family)
        try:
            family = Family(name)
        except ValueError:
            raise ValueError(f"{name!r} is no pattern; known are {known}") from None
        if not rest:
            return cls(family)
        pitch_text, _, shift_text = rest.partition(":")
        try:
            pitch_px = int(pitch_text)
            shifts_px = [int(part) for part in shift_text.split(",")] if shift_text else []
        except ValueError:
            raise ValueError(f"{text!r}: pitch and shifts are whole projector pixels") from None
        expected = int(family.varies_down) + int(family.varies_right)
        if shifts_px and len(shifts_px) != expected:
            raise ValueError(f"{text!r}: {family} takes {expected} shift(s), not {len(shifts_px)}")
        down = shifts_px[0] if shifts_px and family.varies_down else 0
        right = shifts_px[-1] if shifts_px and family.varies_right else 0
        return cls(family, pitch_px, down, right)

    def __str__(self) -> str:
        if self.family.is_reference:
            return self.family.value
        both = self.family.varies_down and self.family.varies_right
        shift_px = self.shift_y_px if self.family.varies_down else self.shift_x_px
        shift = f"{self.shift_y_px},{self.shift_x_px}" if both else str(shift_px)
        return f"{self.family.value}:{self.pitch_px}:{shift}"

    def code(self, resolution: tuple[int, int]) -> NDArray[np.float64]:
        """Light of every projector pixel, (height, width), a fraction of white in [0, 1]."""
        height, width = resolution
        down = np.arange(height)[:, np.newaxis] + self.shift_y_px
        right = np.arange(width)[np.newaxis, :] + self.shift_x_px
        return np.broadcast_to(self._code_at(down, right), (height, width)).astype(np.float64)

    def _code_at(self, down: NDArray[np.int_], right: NDArray[np.int_]) -> NDArray[np.float64]:
        if self.family.is_reference:
            return np.full((1, 1), float(self.family is Family.WHITE))
        along = np.zeros((1, 1))
        if self.family.is_binary:
            if self.family.varies_down:
                along = along + down // self.pitch_px
            if self.family.varies_right:
                along = along + right // self.pitch_px
            return np.equal(along % 2, 0).astype(np.float64)
        phase = np.pi * (down if self.family.varies_down else right) / self.pitch_px
        wave: NDArray[np.float64] = np.cos(phase)
        return 0.5 * (1 + wave)

    @property
    def phase(self) -> float:
        """Advance of a sinusoid through its shift, π·shift/pitch, in radians (0 for references)."""
        if self.family.is_reference:
            return 0.0
        return float(np.pi * (self.shift_y_px + self.shift_x_px) / self.pitch_px)

    def raster(self, resolution: tuple[int, int], gamma: float = 1.0) -> NDArray[np.uint8]:
        """The uint8 raster, (height, width), that makes a projector emit this code.

        Parameters
        ----------
        resolution
            (height, width) of the projector in pixels.
        gamma
            The projector emits (raster/255)^gamma; its inverse is applied. Binary patterns do
            not depend on it.
        """
        levels = self.code(resolution) ** (1 / gamma)
        return np.rint(255 * levels).astype(np.uint8)


def shift_grid(
    pitch_px: int, counts: tuple[int, int], span_pitches: tuple[int, int] = (2, 1)
) -> tuple[tuple[int, int], ...]:
    """Integer shifts (down, right) that spread evenly over a span of the pattern.

    With 6 × 6 shifts over 2 pitches down and 1 pitch right a checker takes 36 different forms,
    every pixel is both lit and dark, and shift k + 18 is the complement of shift k.

    Parameters
    ----------
    pitch_px
        Pitch in projector pixels, ≥ 1.
    counts
        Number of shifts (down, right), each ≥ 1.
    span_pitches
        Range covered by the shifts, in pitches (down, right), the end excluded.
    """
    return tuple(
        (
            down * span_pitches[0] * pitch_px // counts[0],
            right * span_pitches[1] * pitch_px // counts[1],
        )
        for down in range(counts[0])
        for right in range(counts[1])
    )


def untoggled_fraction(patterns: Sequence[Pattern]) -> float:
    """Fraction of projector pixels that are never lit or never dark among binary patterns.

    Parameters
    ----------
    patterns
        Of one binary family and pitch, at least one. Whole periods are counted, so that the
        answer holds for any resolution.
    """
    lit, weights = _forms(patterns)
    stuck = lit.all(axis=0) | ~lit.any(axis=0)
    return float(weights[stuck].sum())


def balanced(patterns: Sequence[Pattern]) -> bool:
    """Whether every projector pixel is lit half of the time, so that the mean frame is grey.

    Holds for shift sets that contain the complement of each pattern, and for sinusoids whose
    shifts divide the period evenly.

    Parameters
    ----------
    patterns
        Of one family and pitch, at least one.
    """
    if patterns[0].family.is_binary:
        lit, _ = _forms(patterns)
        return bool(np.all(2 * lit.sum(axis=0) == len(patterns)))
    phases = np.array([pattern.phase for pattern in patterns])
    return bool(abs(np.exp(1j * phases).mean()) < 1e-9)


def _forms(patterns: Sequence[Pattern]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """The different histories that a projector pixel can have, and how frequent each is.

    Pixels of one row have the same parity history down and those of one column to the right, so
    the period's (2·pitch)² pixels need not be visited one by one.

    Returns
    -------
    Lit, (patterns, rows, columns), and the frequency of each form, (rows, columns), sum 1.
    """
    if not patterns:
        raise ValueError("no patterns to compare")
    odd_down, share_down = _parities(patterns, down=True)
    odd_right, share_right = _parities(patterns, down=False)
    lit = odd_down[:, :, np.newaxis] == odd_right[:, np.newaxis, :]
    return lit, share_down[:, np.newaxis] * share_right


def _parities(
    patterns: Sequence[Pattern], *, down: bool
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    first = patterns[0]
    varies = first.family.varies_down if down else first.family.varies_right
    place = np.arange(2 * first.pitch_px if varies else 1)
    shifts = np.array([p.shift_y_px if down else p.shift_x_px for p in patterns])
    odd = (place + shifts[:, np.newaxis]) // first.pitch_px % 2 == 1
    forms, counts = np.unique(odd, axis=1, return_counts=True)
    return forms, counts / counts.sum()
