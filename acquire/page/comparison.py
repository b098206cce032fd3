"""A frame beside what it should show, for a screen: the prediction and the difference."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from acquire.page.darkroom import CLIPPED, Negative, png, srgb_codes
from acquire.proof.expectation import Expected, Small, reduced

# Difference that takes the full colour, as a fraction of the light of white.
SPAN = 0.2
# Dark where both are equal, blue where the frame is darker than it should be, red where brighter;
# told apart by the colour-blind (F. Crameri, Scientific colour maps, "berlin").
COLOURS = "berlin"
NOT_COMPARED = (60, 60, 60)


@dataclass(frozen=True, slots=True)
class Comparison:
    """What one viewer gets to compare a frame with.

    Parameters
    ----------
    how, holds
        As of `acquire.proof.expectation.Expected`.
    size
        (width, height) of the files.
    prediction
        PNG, sRGB, on the scale of the frame's own picture; empty where nothing predicts it.
    difference
        PNG of frame less prediction, mean of the colours: full colour at `SPAN` of white, grey
        where something is saturated or not known.
    rms, mean
        Of the difference where it is known, fractions of white.
    """

    how: str
    holds: float | None
    size: tuple[int, int]
    prediction: bytes = b""
    difference: bytes = b""
    rms: float | None = None
    mean: float | None = None


def small(picture: Negative) -> Small:
    """A picture of the size at which frames are compared."""
    return reduced(picture.values, picture.marks == CLIPPED)


def compared(frame: Small, expected: Expected) -> Comparison:
    """Print what a frame should show and by how much it misses it."""
    height, width = frame.usable.shape
    if expected.prediction is None:
        return Comparison(expected.how, None, (width, height))
    prediction = expected.prediction
    usable = frame.usable & prediction.usable
    lit = np.clip(prediction.values, 0, 1)
    codes = srgb_codes()[(lit * 65535 + 0.5).astype(np.uint16)]
    codes[~prediction.usable] = NOT_COMPARED
    white = expected.white or float(np.percentile(prediction.values, 99)) or 1.0
    difference = (frame.values - prediction.values).mean(axis=2, dtype=np.float64) / white
    places = np.rint((np.clip(difference / SPAN, -1, 1) + 1) / 2 * 255).astype(np.uint8)
    colours = _colours()[places]
    colours[~usable] = NOT_COMPARED
    known = difference[usable]
    return Comparison(
        expected.how,
        expected.holds,
        (width, height),
        png(codes[..., ::-1]),
        png(colours[..., ::-1]),
        float(np.sqrt(np.mean(known**2))) if known.size else None,
        float(known.mean()) if known.size else None,
    )


@cache
def _colours() -> NDArray[np.uint8]:
    """(256, 3), red first."""
    from matplotlib import colormaps  # noqa: PLC0415 - slow, and not needed for aiming

    table = colormaps[COLOURS](np.linspace(0, 1, 256), bytes=True)
    return np.asarray(table, np.uint8)[:, :3]
