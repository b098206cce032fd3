"""The exposure time that uses the sensor's range, and how much the lamp flickers in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import UnsupportedError

Array = NDArray[np.float64]

_LEAST_SIGNAL = 0.005
BRIGHT_PERCENTILE = 99.5


@dataclass(frozen=True, slots=True)
class Exposure:
    """Advice on the exposure.

    Parameters
    ----------
    exposure_s
        A whole number of refreshes, the brightest colour at the wished fraction or just below.
    refreshes
        That number.
    colours_s
        (colours,): the time that would bring each colour there by itself.
    rate_per_s
        (colours,): signal of the brightest lit pixels per second of exposure.
    flicker
        Relative standard deviation of repeated frames' light at `exposure_s`.
    expected_signal
        (colours,): of the brightest pixels at `exposure_s`.
    """

    exposure_s: float
    refreshes: int
    colours_s: Array
    rate_per_s: Array
    flicker: float
    expected_signal: Array


def signal_rate(bright: Array, dark: Array, exposure_s: float) -> Array:
    """Signal per second of the brightest pixels, (colours,).

    Parameters
    ----------
    bright, dark
        (colours,): high percentile of the white frame, unsaturated, and of the black one.
    exposure_s
        Of both.

    Raises
    ------
    UnsupportedError
        Where no colour rises above black.
    """
    rise = bright - dark
    if np.max(rise) < _LEAST_SIGNAL:
        raise UnsupportedError(
            f"white is at most {100 * np.max(rise):.2f} % of the sensor's range brighter than "
            f"black at {exposure_s:g} s: no light of the projector reaches the sensor. Take the "
            "cap off, check the lamp, open the lens or raise the ISO"
        )
    return np.asarray(np.maximum(rise, 1e-9) / exposure_s, np.float64)


def advise(
    rate_per_s: Array, dark: Array, fraction: float, refresh_hz: float, flicker: float
) -> Exposure:
    """The largest whole number of refreshes that keeps every colour at or below `fraction`.

    Parameters
    ----------
    rate_per_s
        (colours,), from `signal_rate`.
    dark
        (colours,): signal of black, added on top.
    fraction
        Of saturation, in (0, 1).
    refresh_hz
        Of the projector.
    flicker
        Relative scatter of repeated frames.
    """
    if not 0 < fraction < 1 or refresh_hz <= 0:
        raise ValueError(f"fraction in (0, 1) and refresh above 0, not {fraction}, {refresh_hz}")
    colours_s = (fraction - np.maximum(dark, 0)) / rate_per_s
    wanted_s = float(colours_s.min())
    refreshes = int(np.floor(wanted_s * refresh_hz + 1e-6))
    if refreshes < 1:
        raise UnsupportedError(
            f"the scene reaches {fraction:.0%} of saturation in {1000 * wanted_s:.2f} ms, before "
            f"one refresh of the projector ({1000 / refresh_hz:.1f} ms) is over: stop the lens "
            "down or lower the ISO, or colours and grey levels will come out uneven"
        )
    exposure_s = refreshes / refresh_hz
    return Exposure(
        exposure_s=exposure_s,
        refreshes=refreshes,
        colours_s=colours_s,
        rate_per_s=rate_per_s,
        flicker=flicker,
        expected_signal=np.maximum(dark, 0) + rate_per_s * exposure_s,
    )
