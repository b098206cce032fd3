"""How late the light of a new pattern is, from exposures that begin as it is shown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import UnsupportedError

Array = NDArray[np.float64]

_LEAST_CONTRAST = 0.02
_CERTAIN = 0.02


@dataclass(frozen=True, slots=True)
class Latency:
    """Time from the start of an exposure until the new light is on the scene.

    Parameters
    ----------
    delay_s, deviation_s
        Mean over the changes and its standard error, seconds.
    delays_s
        (changes,): of every change.
    rising_s, falling_s
        Means of dark to light and of light to dark; they differ where one rises slower.
    longest_s
        The longest one measured.
    """

    delay_s: float
    deviation_s: float
    delays_s: Array
    rising_s: float
    falling_s: float
    longest_s: float


def fit_latency(
    changing: Array, rising: NDArray[np.bool_], black: float, white: float, exposure_s: float
) -> Latency:
    """Delay from the share of the old light in an exposure of known length.

    An exposure of length E that begins as the new pattern is commanded holds the old light for a
    time d and the new light for E − d: for dark to light

        s = black + (white − black)(E − d)/E,   d = E (white − s)/(white − black),

    and the other way round for light to dark.

    Parameters
    ----------
    changing
        (changes,): mean signal of the exposures right after a change.
    rising
        (changes,): whether it was from black to white.
    black, white
        Mean signal of the same exposure long after a change.
    exposure_s
        E, seconds.

    Raises
    ------
    UnsupportedError
        No contrast, no change to be seen (a delay below 0 or beyond the exposure).
    """
    if changing.shape != rising.shape or not len(changing):
        raise ValueError(f"signals {changing.shape} and directions {rising.shape} do not match")
    span = white - black
    if span < _LEAST_CONTRAST:
        raise UnsupportedError(
            f"white is only {100 * span:.1f} % of the sensor's range brighter than black: lengthen "
            "the exposure, open the lens or raise the ISO"
        )
    old = np.where(rising, white - changing, changing - black) / span
    if np.any(old > 1 - _CERTAIN):
        raise UnsupportedError(
            f"the old light fills the whole exposure of {exposure_s:g} s: the delay is as long or "
            "longer; give a longer --exposure"
        )
    if np.any(old < -_CERTAIN):
        raise UnsupportedError(
            "a changing exposure lies outside black and white: lamp or room light changed, or the "
            "frames were taken out of order"
        )
    delays = exposure_s * old
    both = [delays[rising], delays[~rising]]
    means = [float(part.mean()) if len(part) else float("nan") for part in both]
    return Latency(
        delay_s=float(delays.mean()),
        deviation_s=float(delays.std(ddof=1) / np.sqrt(len(delays))) if len(delays) > 1 else 0.0,
        delays_s=delays,
        rising_s=means[0],
        falling_s=means[1],
        longest_s=float(delays.max()),
    )
