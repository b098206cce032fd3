"""What a projector does to the light it is told to emit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Leak:
    """Light that a dark projector pixel still gives, as a fraction b of a lit one's.

    Parameters
    ----------
    fraction
        Median over pixels and colours, in [0, 1).
    spread
        Half the distance between its 16th and 84th percentile. Leak is the same fraction
        everywhere; a large spread says that other light (room, screen) is in the black frame.
    """

    fraction: float
    spread: float


def measure_leak(
    white: NDArray[np.float32], black: NDArray[np.float32], usable: NDArray[np.bool_]
) -> Leak:
    """Leak b from a white and a black frame (Nayar et al. 2006, section 4).

    Light of the room is in both frames and counts as leak: the fraction is an upper bound.

    Parameters
    ----------
    white, black
        Linear light, (height, width, colours), before any subtraction.
    usable
        (height, width): lit and not saturated; at least one pixel.
    """
    if white.shape != black.shape or usable.shape != white.shape[:2]:
        raise ValueError(
            f"white {white.shape} and black {black.shape} must agree, and usable {usable.shape} "
            "be their (height, width)"
        )
    if not usable.any():
        raise ValueError("no usable pixel to measure the leak on")
    lit = white[usable].astype(np.float64)
    ratio = black[usable][lit > 0] / lit[lit > 0]
    low, middle, high = np.percentile(ratio, [15.9, 50, 84.1])
    return Leak(float(np.clip(middle, 0, np.nextafter(1, 0))), float(high - low) / 2)


def leak_map(
    white: NDArray[np.float32], black: NDArray[np.float32], usable: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Leak of every pixel, float32 (height, width), its colours weighted by their light.

    NaN where a pixel is not usable. Parameters as in `measure_leak`.
    """
    if white.shape != black.shape or usable.shape != white.shape[:2]:
        raise ValueError(
            f"white {white.shape} and black {black.shape} must agree, and usable {usable.shape} "
            "be their (height, width)"
        )
    ratio = np.full(usable.shape, np.nan, np.float32)
    lit = usable & (white.sum(axis=-1) > 0)
    ratio[lit] = black[lit].sum(axis=-1) / white[lit].sum(axis=-1)
    return ratio


def white_excess(white: NDArray[np.float64], primaries: NDArray[np.float64]) -> float:
    """Light of white over that of its primaries one by one, less 1.

    0 where the projector adds colours; above it where a colour wheel has a white segment, which
    shines for white alone.

    Parameters
    ----------
    white
        (channels,): light of white less black.
    primaries
        (primaries, channels): light of each primary alone at its brightest, less black.
    """
    if white.ndim != 1 or primaries.shape[1:] != white.shape:
        raise ValueError(f"white {white.shape} does not fit the primaries {primaries.shape}")
    return float(white.sum() / primaries.sum() - 1)
