"""What decoding yields, and how: an image whose values are proportional to light."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray


class Demosaic(StrEnum):
    """How the colours of a mosaic become pixels.

    ``superpixel``: one pixel for each 2 × 2 quad, measured values only. ``bilinear``: one for each
    photosite, two thirds of the values interpolated.
    """

    SUPERPIXEL = "superpixel"
    BILINEAR = "bilinear"


@dataclass(frozen=True, slots=True)
class LinearImage:
    """Linear light as a fraction of the sensor's usable range.

    Parameters
    ----------
    values
        float32, (height, width, 3), red green blue in the camera's own primaries; 0 is the
        black level, 1 the white level. Noise around black stays signed.
    saturated
        bool, (height, width): at least one colour of the pixel reached the white level, so its
        value is a lower bound.
    """

    values: NDArray[np.float32]
    saturated: NDArray[np.bool_]
