"""Patterns as codes: what each projector pixel emits, exactly as encoder and decoder share it.

A pattern's code is the light of a projector pixel as a fraction of white, in [0, 1]. With the
pitch P (side of a check, width of a stripe, half a period of a sinusoid) in projector pixels:

- ``checker``: 1 where floor((x + shift_x)/P) + floor((y + shift_y)/P) is even, else 0;
- ``stripes-columns``: 1 where floor((x + shift_x)/P) is even; ``stripes-rows`` the same in y;
- ``sinusoid-columns``: ½(1 + cos(π (x + shift_x)/P)); ``sinusoid-rows`` the same in y.

For calibration, and of no use to a separation:

- ``uniform``: one level of 0 to 255, or one each for red, green and blue, everywhere; it is what
  the projector is told, whatever light that makes;
- ``focus``: squares of 8 P, fine checks of pitch P in turn with white, fine checks and black.

Bits of a Gray code are stripes: see `gray_code`.

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
    UNIFORM = "uniform"
    FOCUS = "focus"

    @property
    def is_separable(self) -> bool:
        """Has a pitch and shifts over which direct and global light come apart."""
        return self not in {Family.WHITE, Family.BLACK, Family.UNIFORM, Family.FOCUS}

    @property
    def is_uniform(self) -> bool:
        """The same light everywhere, and so neither pitch nor shift."""
        return self in {Family.WHITE, Family.BLACK, Family.UNIFORM}

    @property
    def is_reference(self) -> bool:
        """Uniform light: white or black."""
        return self in {Family.WHITE, Family.BLACK}

    @property
    def is_binary(self) -> bool:
        """Every pixel is either fully lit or dark."""
        return self not in {Family.SINUSOID_COLUMNS, Family.SINUSOID_ROWS, Family.UNIFORM}

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
        Side of a check, width of a stripe or half a period, ≥ 1; 0 for uniform light.
    shift_y_px, shift_x_px
        Offset down and right, ≥ 0; 0 along a direction in which the pattern does not vary.
    levels
        Of ``uniform`` alone: one for all colours or red, green and blue, each 0 to 255.
    """

    family: Family
    pitch_px: int = 0
    shift_y_px: int = 0
    shift_x_px: int = 0
    levels: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        uniform = self.family.is_uniform
        if uniform and (self.pitch_px, self.shift_y_px, self.shift_x_px) != (0, 0, 0):
            raise ValueError(f"{self.family} has neither pitch nor shift")
        self._check_levels()
        if not uniform and self.pitch_px < 1:
            raise ValueError(f"{self.family} needs a pitch of at least 1 px, not {self.pitch_px}")
        if self.shift_y_px < 0 or self.shift_x_px < 0:
            raise ValueError(f"shifts count from 0, not {self.shift_y_px}, {self.shift_x_px}")
        if self.shift_y_px and not self.family.varies_down:
            raise ValueError(f"{self.family} does not vary down: shift_y_px must be 0")
        if self.shift_x_px and not self.family.varies_right:
            raise ValueError(f"{self.family} does not vary to the right: shift_x_px must be 0")

    def _check_levels(self) -> None:
        if self.family is not Family.UNIFORM:
            if self.levels:
                raise ValueError(f"{self.family} has no levels")
            return
        if len(self.levels) not in {1, 3} or not all(0 <= level <= 255 for level in self.levels):
            raise ValueError(
                f"uniform takes one level of 0 to 255, or red,green,blue, not {self.levels}"
            )

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``white``, ``checker:8:0,2``, ``stripes-rows:16:4``, ``uniform:255,0,0``, etc."""
        name, _, rest = text.strip().partition(":")
        known = ", ".join(family.value for family in Family)
        try:
            family = Family(name)
        except ValueError:
            raise ValueError(f"{name!r} is no pattern; known are {known}") from None
        if not rest:
            return cls(family)
        if family is Family.UNIFORM:
            return cls(family, levels=_levels(rest))
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
        if self.family is Family.UNIFORM:
            return f"{self.family.value}:{','.join(map(str, self.levels))}"
        if self.family is Family.FOCUS:
            return f"{self.family.value}:{self.pitch_px}"
        both = self.family.varies_down and self.family.varies_right
        shift_px = self.shift_y_px if self.family.varies_down else self.shift_x_px
        shift = f"{self.shift_y_px},{self.shift_x_px}" if both else str(shift_px)
        return f"{self.family.value}:{self.pitch_px}:{shift}"

    def code(self, resolution: tuple[int, int]) -> NDArray[np.float64]:
        """Light of every projector pixel, a fraction of white in [0, 1].

        (height, width); (height, width, 3) for a ``uniform`` of three levels, whose code is what
        the projector is told, level/255.
        """
        height, width = resolution
        if self.family is Family.UNIFORM:
            told = np.array(self.levels) / 255
            return np.full((height, width) if len(told) == 1 else (height, width, 3), told)
        if self.family is Family.FOCUS:
            return self._chart(height, width)
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

    def _chart(self, height: int, width: int) -> NDArray[np.float64]:
        down, right = np.mgrid[:height, :width] // self.pitch_px
        fine = (down + right) % 2 == 0
        square_down, square_right = down // 8, right // 8
        solid = np.where(square_down % 2 == 0, 1.0, 0.0)
        return np.where((square_down + square_right) % 2 == 0, fine, solid)

    @property
    def phase(self) -> float:
        """Advance of a sinusoid through its shift, π·shift/pitch, in radians (0 for references)."""
        if self.family.is_uniform:
            return 0.0
        return float(np.pi * (self.shift_y_px + self.shift_x_px) / self.pitch_px)

    def raster(
        self,
        resolution: tuple[int, int],
        gamma: float = 1.0,
        light: NDArray[np.float64] | None = None,
    ) -> NDArray[np.uint8]:
        """The uint8 raster that makes a projector emit this code.

        Parameters
        ----------
        resolution
            (height, width) of the projector in pixels.
        gamma
            The projector emits (raster/255)^gamma; its inverse is applied.
        light
            (colours, 256), 1 or 3 colours, not falling: light of every level as a fraction of
            white less black; it takes the place of `gamma`.

        Returns
        -------
        (height, width), or (height, width, 3) where the colours differ. Black, white, binary
        and uniform patterns depend neither on `gamma` nor on `light`.
        """
        code = self.code(resolution)
        if self.family is Family.UNIFORM or self.family.is_binary:
            return np.rint(255 * code).astype(np.uint8)
        if light is None:
            return np.rint(255 * code ** (1 / gamma)).astype(np.uint8)
        if light.ndim != 2 or light.shape[0] not in {1, 3} or light.shape[1] != 256:
            raise ValueError(f"light of the levels is (1 or 3, 256), not {light.shape}")
        told = [np.interp(code, colour, np.arange(256)) for colour in light]
        levels = told[0] if len(told) == 1 else np.stack(told, axis=-1)
        return np.rint(levels).astype(np.uint8)


def gray_code(bit: int, n_bits: int, *, rows: bool, complement: bool = False) -> Pattern:
    """One bit of the Gray code of a projector pixel's row or column, as stripes.

    Bit k of x ⊕ ⌊x/2⌋ is 1 where floor((x + 2^k)/2^(k+1)) is odd: stripes of 2^(k+1) pixels,
    moved by half their width. Of the highest bit only two halves are left.

    Parameters
    ----------
    bit
        0, the finest, to `n_bits` − 1.
    n_bits
        Bits that number all rows or columns.
    rows
        Of the row, else of the column.
    complement
        Lit where the bit is 0.
    """
    if not 0 <= bit < n_bits:
        raise ValueError(f"bit {bit} is not one of {n_bits}")
    highest = bit == n_bits - 1
    width_px = 2**bit if highest else 2 ** (bit + 1)
    shift_px = 0 if highest else 2**bit
    if not complement:
        shift_px += width_px
    if rows:
        return Pattern(Family.STRIPES_ROWS, width_px, shift_px, 0)
    return Pattern(Family.STRIPES_COLUMNS, width_px, 0, shift_px)


def _levels(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise ValueError(f"uniform:{text}: levels are whole numbers of 0 to 255") from None


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
