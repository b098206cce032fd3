"""What the frames of a session say of their own noise.

A pattern and its complement add up to white. In a sum of all frames of which complementary ones
have equal weight, and all weights add up to 0, no light is left: its square is the variance of
the noise of a frame (of all noise that differs between frames, a lamp's flicker included). Noise is
a property of the whole capture: it is gathered on a lattice of pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import complementary_pairs
from processing.frames.noise_lines import noise_lines
from processing.patterns import Pattern

Image: TypeAlias = NDArray[np.float32]
Array: TypeAlias = NDArray[np.float64]

_LATTICE_PIXELS = 9000
# Of what two ordered frames differ by, part that may have the other sign.
_REVERSED = 0.01


@dataclass(frozen=True, slots=True)
class FrameNoise:
    """Variance of the noise of a frame against its light: read noise and shot noise.

    Parameters
    ----------
    constant
        float64, (colours,), ≥ 0, variance in the dark, in the unit of the frames squared.
    slope
        float64, (colours,), ≥ 0, its rise with light, in the unit of the frames.
    """

    constant: Array
    slope: Array

    def deviation(self, light: Image | Array) -> Array:
        """Standard deviation at some light, (…, colours)."""
        found: Array = np.sqrt(self.constant + self.slope * np.maximum(light, 0))
        return found


class FrameSample:
    """The frames of one pitch on a lattice of some thousand pixels.

    Parameters
    ----------
    patterns
        All that are going to be added, of one family and pitch.
    """

    def __init__(self, patterns: Sequence[Pattern]) -> None:
        self.patterns = tuple(patterns)
        self._frames: dict[Pattern, Image] = {}

    @classmethod
    def whole(cls, patterns: Sequence[Pattern], frames: Image) -> FrameSample:
        """From the `frames` that another process sampled."""
        found = cls(patterns)
        found._frames = dict(zip(patterns, frames, strict=True))
        return found

    def add(self, frame: Image, pattern: Pattern) -> None:
        """Take in one frame, float32, (height, width, colours), black subtracted."""
        self.add_pixels(frame[lattice(frame.shape[:2])].copy(), pattern)

    def add_pixels(self, pixels: Image, pattern: Pattern) -> None:
        """Take in one frame of which only the pixels of the `lattice` are given; they are kept."""
        self._frames[pattern] = pixels

    @property
    def frames(self) -> Array:
        """(frames, rows, columns, colours), in the order of the patterns."""
        return np.stack([self._frames[one] for one in self.patterns]).astype(np.float64)

    @property
    def is_ordered(self) -> bool:
        """Whether there are two frames of which one is nowhere darker than the other.

        Of two positions of a pattern half of the pixels are brighter in either; noise alone, as
        where nothing is lit, weighs by its size.
        """
        return len(self.patterns) == 2 and ordered(*self.frames)

    @property
    def noise_variance(self) -> Array | None:
        """(rows, columns, colours), from differences of successive pairs of complementary frames.

        None where there are fewer than two pairs. A pair adds up to white; the lamp's slow drift
        changes sums that follow one another but little (von Neumann et al., Annals of
        Mathematical Statistics 12, 1941).
        """
        pairs = complementary_pairs(self.patterns)
        if len(pairs) < 2:
            return None
        frames = self.frames
        sums = np.stack([frames[one] + frames[other] for one, other in pairs])
        squares: Array = np.sum(np.diff(sums, axis=0) ** 2, axis=0)
        return squares / (4 * (len(pairs) - 1))


def ordered(first: Image | Array, second: Image | Array) -> bool:
    """Whether one of two frames, pixel by pixel, is nowhere darker than the other."""
    difference = first - second
    reversed_part = min(np.maximum(sign * difference, 0).sum() for sign in (1, -1))
    return bool(reversed_part < _REVERSED * np.abs(difference).sum())


def lattice(shape: tuple[int, ...], pixels: int = _LATTICE_PIXELS) -> tuple[slice, slice]:
    """Some 10 000 pixels, or about so many, evenly spread over a picture."""
    every = slice(None, None, lattice_step(shape, pixels))
    return every, every


def lattice_step(shape: tuple[int, ...], pixels: int = _LATTICE_PIXELS) -> int:
    """Distance of the lattice's pixels."""
    return max(1, int(np.sqrt(shape[0] * shape[1] / pixels)))


def noise_of(variances: Sequence[Array], white: Image, usable: NDArray[np.bool_]) -> FrameNoise:
    """Noise of a frame, from the complementary frames of all pitches.

    Parameters
    ----------
    variances
        `FrameSample.noise_variance` of each pitch, at least one.
    white
        float32, (height, width, colours), the scene under full light.
    usable
        bool, (height, width), True where a pixel counts; at least one of the lattice.
    """
    at = lattice(usable.shape)
    mean = np.mean(variances, axis=0).astype(np.float32)
    lines = noise_lines(mean, white[at], usable[at])
    # The mean frame is half of white: what rises with white rises twice as fast with its light.
    return FrameNoise(lines[:, 0], 2 * lines[:, 1])
