"""The simulated projector's light: from raster to emission, over time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from drivers.protocols import Raster

REFRESH_HZ = 60.0


def emission(
    raster: Raster, gamma: float, black_level: float, blur_projector_px: float
) -> NDArray[np.float64]:
    """Light that leaves each projector pixel, fraction of white, same shape as `raster`.

    black + (1 − black)·(raster/255)^gamma, then a Gaussian defocus. Light that the defocus
    carries over the edge is lost to the scene.

    Parameters
    ----------
    raster
        uint8, (height, width) or (height, width, 3).
    gamma
        Exponent of the projector's response.
    black_level
        Light of a black pixel, fraction of white.
    blur_projector_px
        Standard deviation of the defocus in projector pixels.
    """
    levels = black_level + (1 - black_level) * (np.arange(256) / 255) ** gamma
    light = levels[raster]
    if blur_projector_px > 0:
        for axis in (0, 1):
            light = gaussian_filter1d(light, blur_projector_px, axis=axis, mode="constant")
    return light


def flicker_gain(amplitude: float, phase_rad: float, exposure_s: float) -> float:
    """Mean of 1 + amplitude·cos(2π·60 Hz·t + phase) over an exposure from t = 0.

    A whole number of refreshes cancels the flicker.
    """
    turn = 2 * np.pi * REFRESH_HZ * exposure_s
    return float(1 + amplitude * (np.sin(turn + phase_rad) - np.sin(phase_rad)) / turn)
