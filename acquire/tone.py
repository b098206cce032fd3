"""Linear light for a screen: exposure and tone curve, the same in a file and on the page."""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

WHITE_PERCENTILE = 99.5
SAMPLED_PIXELS = 1 << 20
SOFT_WHITE = 4.0


class Tone(StrEnum):
    """How linear light, 1 being full brightness, is fitted to a screen.

    ``srgb``: as it is, clipped at 1. ``soft``: x (1 + x/16)/(1 + x), eq. 4 of Reinhard, Stark,
    Shirley and Ferwerda, *Photographic tone reproduction for digital images* (2002), for each
    colour by itself: 4 becomes 1, highlights keep their form. Both end in the sRGB curve.
    """

    SRGB = "srgb"
    SOFT = "soft"


def encode(linear: NDArray[np.float64], tone: Tone = Tone.SRGB) -> NDArray[np.uint8]:
    """Linear light to 8-bit sRGB by a tone curve and the transfer curve of IEC 61966-2-1.

    Parameters
    ----------
    linear
        Any shape; 1 is full brightness, negative values are black.
    tone
        See `Tone`.
    """
    light = np.maximum(linear, 0)
    if tone is Tone.SOFT:
        light = light * (1 + light / SOFT_WHITE**2) / (1 + light)
    clipped = np.minimum(light, 1)
    curve = 1.055 * clipped ** (1 / 2.4) - 0.055
    encoded: NDArray[np.float64] = np.where(clipped <= 0.0031308, 12.92 * clipped, curve)
    return np.rint(255 * encoded).astype(np.uint8)


def exposure_of(image: NDArray[np.float32]) -> float:
    """Gain that brings the 99.5th percentile of an image to full brightness.

    Parameters
    ----------
    image
        Linear light, (height, width, 3); NaN where it could not be measured. Of images of more
        than a megapixel, pixels at even steps are looked at.

    Returns
    -------
    Gain > 0; 1 where there is no light to go by.
    """
    step = math.ceil(math.sqrt(image.shape[0] * image.shape[1] / SAMPLED_PIXELS))
    sample = image[::step, ::step]
    measured = sample[np.isfinite(sample)]
    level = float(np.percentile(measured, WHITE_PERCENTILE)) if measured.size else 0.0
    return 1 / level if level > 0 else 1.0
