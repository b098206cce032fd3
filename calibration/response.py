"""A projector's response: the light of every level that it is told to show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import curve_fit, isotonic_regression

from calibration.errors import UnsupportedError

Array = NDArray[np.float64]

LEVELS = 256
_LEAST_LEVELS = 8
_MOST_FALL = 0.01
_FLAT = 0.998


@dataclass(frozen=True, slots=True)
class Response:
    """Response of one colour.

    Parameters
    ----------
    light
        (256,): light of every level over that of level 255, that of level 0 taken off both; from
        0 to 1, not falling.
    deviation
        Standard error of a measured level, fraction of white less black.
    residuals
        (levels measured,): measured less fitted.
    gamma, gamma_deviation
        Exponent of the power that comes nearest, ((level − cut)/(saturation − cut))^gamma.
    cut, saturation
        Levels between which that power rises; 0 and 255 for a plain power.
    power_misfit
        Largest distance of that power from the measured levels: how far a gamma would do.
    saturated_from
        Lowest level that has 99.8 % of the light of 255.
    """

    light: Array
    deviation: float
    residuals: Array
    gamma: float
    gamma_deviation: float
    cut: float
    saturation: float
    power_misfit: float
    saturated_from: int


def fit_response(levels: NDArray[np.int64], light: Array, deviation: float) -> Response:
    """Monotone curve through a ramp of levels.

    The measured levels are made monotone by least squares (pool adjacent violators; Barlow et
    al. 1972, here `scipy.optimize.isotonic_regression`) and joined by monotone cubics (Fritsch
    and Carlson 1980), so that no shape is assumed. A power is fitted beside it for what people
    ask for.

    Parameters
    ----------
    levels
        (n,), rising, from 0 to 255.
    light
        (n,), linear, any unit.
    deviation
        Standard error of `light`, the same unit.

    Raises
    ------
    UnsupportedError
        Too few levels, no light, or a curve that falls by more than 1 % and five times its error.
    """
    if levels.shape != light.shape or np.any(np.diff(levels) <= 0):
        raise ValueError(f"levels {levels.shape} must rise, one for each light {light.shape}")
    if len(levels) < _LEAST_LEVELS or levels[0] != 0 or levels[-1] != LEVELS - 1:
        raise UnsupportedError(
            f"a response needs {_LEAST_LEVELS} levels from 0 to 255, there are {len(levels)}"
        )
    span = light[-1] - light[0]
    if span <= 10 * deviation or span <= 0:
        raise UnsupportedError(
            "white is hardly brighter than black: the projector's light does not reach the scene, "
            "its lamp is off, or the exposure is far too short"
        )
    relative, error = (light - light[0]) / span, deviation / span
    fall = float(np.max(np.maximum.accumulate(relative) - relative))
    if fall > max(_MOST_FALL, 5 * error):
        raise UnsupportedError(
            f"the light falls by {fall:.1%} of white where the level rises: lamp or room light "
            "changed during the ramp, frames saturate, or the projector adapts to the picture; "
            "switch its dynamic contrast and eco modes off"
        )
    monotone = np.clip(isotonic_regression(relative).x, 0, 1)
    monotone[0], monotone[-1] = 0, 1
    curve = PchipInterpolator(levels, monotone)(np.arange(LEVELS))
    curve = np.maximum.accumulate(np.clip(curve, 0, 1))
    power, spread = _fit_power(levels, relative)
    return Response(
        light=curve,
        deviation=float(error),
        residuals=relative - curve[levels],
        gamma=float(power[0]),
        gamma_deviation=spread,
        cut=float(255 * power[1]),
        saturation=float(255 * power[2]),
        power_misfit=float(np.abs(_power(levels / 255, *power) - relative).max()),
        saturated_from=int(np.flatnonzero(curve >= _FLAT)[0]),
    )


def _power(told: Array, gamma: float, cut: float, saturation: float) -> Array:
    inside = np.clip((told - cut) / max(saturation - cut, 1e-3), 0, 1)
    risen: Array = inside**gamma
    return risen


def _fit_power(levels: NDArray[np.int64], relative: Array) -> tuple[Array, float]:
    bounds = ([0.1, -0.2, 0.3], [10, 0.6, 1.2])
    found, covariance = curve_fit(_power, levels / 255, relative, [2.0, 0.0, 1.0], bounds=bounds)
    return found, float(np.sqrt(covariance[0, 0]))
