"""Whether white and black frames show full light and none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.prediction import Array, Samples
from processing.showing import Finding

# White less black, relative to the brighter of both, that a lit scene has at least.
LEAST_LIT = 0.02
# And in parts of the noise of that difference: two dark frames differ by their noise.
LEAST_CERTAIN = 10.0
# Bounds of a later reference's light, in parts of white less black.
WHITE_AT_LEAST = 0.55
BLACK_AT_MOST = 0.2
# Root of the part of the light in which a later white may differ from the first but for its gain.
WHITE_DIFFERS = 0.15
# Light of a pattern that is half lit, in parts of white less black, below which the projector is
# dark, and above which something else lights the scene: no lamp changes by so much.
DARK_AT = 0.1
TOO_BRIGHT_AT = 1.6


def both_show(white: Samples, black: Samples, noise: float) -> bool:
    """Whether the first white is brighter than the first black; if not, one shows the other.

    Parameters
    ----------
    white, black
        float32, (n,).
    noise
        Variance of a sample's noise.
    """
    light, dark = float(white.mean(dtype=np.float64)), float(black.mean(dtype=np.float64))
    brighter = max(light, dark)
    least = LEAST_CERTAIN * float(np.sqrt(2 * noise / white.size))
    return brighter > 0 and light - dark > max(LEAST_LIT * brighter, least)


def later_reference(
    frame: Samples, white: Samples, black: Samples, noise: float, *, is_white: bool
) -> tuple[Finding, float]:
    """What a repeated reference shows, and its light in parts of white less black.

    Parameters
    ----------
    frame, white, black
        float32, (n,): the frame in question and the first of each kind.
    noise
        Variance of a sample's noise.
    is_white
        What the frame should show.
    """
    span = white.astype(np.float64) - black
    light = frame.astype(np.float64) - black
    level = float(light.sum() / span.sum())
    if not is_white:
        return (Finding.OWN if abs(level) < BLACK_AT_MOST else Finding.OTHER), level
    if level < WHITE_AT_LEAST:
        return (Finding.BLANK if level < BLACK_AT_MOST else Finding.OTHER), level
    return (Finding.OWN if _differs(light, span, noise) < WHITE_DIFFERS else Finding.OTHER), level


def at_once(frame: Samples, white: Samples, black: Samples) -> Finding | None:
    """What a pattern frame certainly shows instead, by its light alone; None where it may be right.

    Parameters
    ----------
    frame, white, black
        float32, (n,), of lit places; about half of the pattern is lit.
    """
    span = float(white.mean(dtype=np.float64) - black.mean(dtype=np.float64))
    level = float(frame.mean(dtype=np.float64) - black.mean(dtype=np.float64))
    if level < DARK_AT * span:
        return Finding.BLANK
    return Finding.OTHER if level > TOO_BRIGHT_AT * span else None


def adds_up(white: Samples, black: Samples, mean: Array, noise: float) -> bool:
    """Whether white and black agree with the mean of complementary frames but for its gain."""
    both = white.astype(np.float64) + black
    return _differs(both, 2 * mean, noise) < WHITE_DIFFERS


def _differs(light: NDArray[np.float64], wanted: NDArray[np.float64], noise: float) -> float:
    """Root mean square difference in parts of the light, gain fitted and noise taken off."""
    power = float(wanted @ wanted)
    if power <= 0:
        return float("inf")
    left = light - float(light @ wanted) / power * wanted
    return float(np.sqrt(max(float(left @ left) - 2 * noise * left.size, 0.0) / power))
