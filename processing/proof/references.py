"""Whether white and black frames show full light and none."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from processing.proof.finding import Finding
from processing.proof.parts import Parts
from processing.proof.prediction import Array, Samples
from processing.proof.sample_noise import FEWEST_PAIRS, SampleNoise

# White less black, relative to the brighter of both, that a lit scene has at least.
LEAST_LIT = 0.02
# And in parts of the noise of that difference: two dark frames differ by their noise.
LEAST_CERTAIN = 10.0
# Bounds of a later reference's light, in parts of white less black.
WHITE_AT_LEAST = 0.55
BLACK_AT_MOST = 0.2
# Root of the part of the light in which a later white may differ from the first but for its gain.
WHITE_DIFFERS = 0.15
# Light that a part of a reference may have more or less than the others have, relative to white
# less black, and standard deviations of the noise beyond that.
PART_DIFFERS = 0.15
# Mean square by which patterns are darker than black or brighter than white, relative to white
# less black, where these are wrong.
BEYOND = 0.04
CERTAIN = 7.0
FEWEST_PLACES = 8
# Light of a pattern that is half lit, in parts of white less black, below which the projector is
# dark, and above which something else lights the scene: no lamp changes by so much.
DARK_AT = 0.1
TOO_BRIGHT_AT = 1.6


class Reference(StrEnum):
    """The two references."""

    WHITE = "white"
    BLACK = "black"


def both_show(white: Samples, black: Samples, noise: SampleNoise) -> bool:
    """Whether the first white is brighter than the first black; if not, one shows the other.

    Parameters
    ----------
    white, black
        float32, (n,).
    noise
        Of a sample.
    """
    light, dark = float(white.mean(dtype=np.float64)), float(black.mean(dtype=np.float64))
    brighter = max(light, dark)
    variance = float(noise.at(np.array(brighter)))
    least = LEAST_CERTAIN * float(np.sqrt(2 * variance / white.size))
    return brighter > 0 and light - dark > max(LEAST_LIT * brighter, least)


def later_reference(
    frame: Samples,
    white: Samples,
    black: Samples,
    noise: SampleNoise,
    partitions: Sequence[Parts],
    *,
    is_white: bool,
) -> tuple[Finding, float]:
    """What a repeated reference shows, and its light in parts of white less black.

    Parameters
    ----------
    frame, white, black
        float32, (n,): the frame in question and the first of each kind.
    noise
        Of a sample.
    partitions
        Ways to cut the picture. Light of the room falls everywhere alike and the lamp changes
        everywhere by the same part; a strip of another picture does neither.
    is_white
        What the frame should show.
    """
    span = white.astype(np.float64) - black
    light = frame.astype(np.float64) - black
    level = float(light.sum() / span.sum())
    if not is_white:
        even = abs(level) < BLACK_AT_MOST and _is_even(light, span, noise.at(black), partitions)
        return (Finding.OWN if even else Finding.OTHER), level
    if level < WHITE_AT_LEAST:
        return (Finding.BLANK if level < BLACK_AT_MOST else Finding.OTHER), level
    variance = noise.at(white)
    even = _is_even(light - level * span, span, variance, partitions)
    alike = _differs(light, span, float(variance.mean())) < WHITE_DIFFERS
    return (Finding.OWN if even and alike else Finding.OTHER), level


def is_darker(frame: Samples, white: Samples, black: Samples) -> bool:
    """Whether a later black is so much darker than the first that this cannot have been black.

    Parameters
    ----------
    frame, white, black
        float32, (n,): the later black and the first of each kind. No mishap takes light from black.
    """
    span = float(white.mean(dtype=np.float64) - black.mean(dtype=np.float64))
    level = float(frame.mean(dtype=np.float64) - black.mean(dtype=np.float64))
    return level < -BLACK_AT_MOST * span


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
        # A black frame that shows a pattern has as much light as the patterns, elsewhere.
        away = np.abs(frame.astype(np.float64) - black).mean()
        return Finding.BLANK if away < 2 * DARK_AT * span else None
    return Finding.OTHER if level > TOO_BRIGHT_AT * span else None


def contradicted(
    frames: Samples,
    white: Samples,
    black: Samples,
    pairs: Sequence[tuple[int, int]],
    noise: SampleNoise,
    partitions: Sequence[Parts],
) -> set[Reference]:
    """Which of white and black cannot be right by what the frames of a pitch show.

    No pattern is darker than black or brighter than white, and complements add up to both.

    Parameters
    ----------
    frames
        float32, (frames, n), a minority of them wrong.
    white, black
        float32, (n,).
    pairs
        Complementary frames.
    noise
        Of a sample.
    partitions
        Ways to cut the picture.
    """
    if len(frames) < 2:
        return set()
    found = set()
    dark, bright = np.quantile(frames, [0.25, 0.75], axis=0, method="closest_observation")
    light = np.maximum(np.maximum(white, bright) - np.minimum(black, dark), 0).astype(np.float64)
    # The gain of the lamp, from places that white and the frames both light.
    gain = max(float(np.quantile(bright / np.maximum(white, 1e-9), 0.25)), 1.0)
    below = np.maximum(black.astype(np.float64) - dark, 0) ** 2
    above = np.maximum(bright.astype(np.float64) - gain * white, 0) ** 2
    for parts in partitions:
        power = BEYOND * parts.means(light**2)
        usable = (parts.sizes >= FEWEST_PLACES) & (power > 0.01 * power.mean())
        for one, excess, near in (
            (Reference.BLACK, below, dark),
            (Reference.WHITE, above, bright),
        ):
            certain = 1 + CERTAIN / np.sqrt(parts.sizes)
            if np.any(
                usable & (parts.means(excess) > power + certain * 2 * parts.means(noise.at(near)))
            ):
                found.add(one)
    if found or len(pairs) < FEWEST_PAIRS:
        return found
    sums = np.stack([frames[i].astype(np.float64) + frames[j] for i, j in pairs])
    typical = np.median(sums, axis=0)
    variance = float(2 * noise.at(typical / 2).mean())
    # Pairs that agree with each other cannot all be wrong. Where white is the brighter one, though,
    # it is the scene that lost light: no mishap makes white brighter than it is.
    agree = sum(_differs(one, typical, variance) < WHITE_DIFFERS for one in sums)
    both = np.minimum(white.astype(np.float64) + black, gain * typical)
    if agree >= FEWEST_PAIRS and _differs(both, typical, variance) > WHITE_DIFFERS:
        found = {Reference.WHITE, Reference.BLACK}
    return found


def _is_even(light: Array, span: Array, variance: Array, partitions: Sequence[Parts]) -> bool:
    """Whether no part has much more or less light than the others."""
    scale = float(span.mean())
    for parts in partitions:
        means = parts.means(light)
        usual = float(np.median(means))
        bound = PART_DIFFERS * np.minimum(parts.means(span), scale)
        bound = bound + CERTAIN * np.sqrt(2 * parts.means(variance) / parts.sizes)
        if np.any((parts.sizes >= FEWEST_PLACES) & (np.abs(means - usual) > bound)):
            return False
    return True


def _differs(light: NDArray[np.float64], wanted: NDArray[np.float64], noise: float) -> float:
    """Root mean square difference in parts of the light, gain fitted and noise taken off."""
    power = float(wanted @ wanted)
    if power <= 0:
        return float("inf")
    left = light - float(light @ wanted) / power * wanted
    return float(np.sqrt(max(float(left @ left) - 2 * noise * left.size, 0.0) / power))
