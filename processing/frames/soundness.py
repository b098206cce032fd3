"""Whether the frames of a pitch agree with white light, and whether the optics resolve it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

PEAK_PERCENTILE = 95
RESOLVED_AT_LEAST = 0.9


def additivity_error(
    mean_frame: NDArray[np.float32], white: NDArray[np.float32], mask: NDArray[np.bool_]
) -> float:
    """Relative excess of the frames of a pitch over white light.

    A pattern and its complement add up to white (the light transport is linear), so the mean of
    a balanced set of shifts is half of it. Nothing in the scene can change that: what differs is
    lamp, gain, exposure, saturation or a curve that was not undone.

    Parameters
    ----------
    mean_frame
        (height, width, colours), mean over the shifts, black subtracted.
    white
        (height, width, colours), black subtracted.
    mask
        bool, (height, width), True where a pixel counts.

    Returns
    -------
    Median over pixels of 2·mean/white − 1, colours summed; NaN without a usable pixel.
    """
    both, whole = _summed(mean_frame, white, mask)
    return float(np.median(2 * both / whole - 1)) if whole.size else float("nan")


def direct_peak(
    direct_light: NDArray[np.float32], white: NDArray[np.float32], mask: NDArray[np.bool_]
) -> float:
    """Direct fraction of the most direct pixels at a pitch: the 95th percentile.

    Parameters
    ----------
    direct_light, white
        (height, width, colours), linear, in one unit.
    mask
        bool, (height, width), True where a pixel counts.
    """
    direct, whole = _summed(direct_light, white, mask)
    return float(np.percentile(direct / whole, PEAK_PERCENTILE)) if whole.size else float("nan")


def resolved_pitches(peaks: Sequence[float]) -> tuple[bool, ...]:
    """Which pitches camera and projector resolve, judged from the scene itself.

    Blur lowers the contrast of a fine pattern at every pixel, scattering only where something
    scatters. At a resolved pitch the most direct pixels are therefore as direct as at any other;
    a pitch is taken as unresolved when its `direct_peak` falls below 0.9 of the largest. A scene
    that scatters everywhere looks the same; only a reference board tells these apart.

    Parameters
    ----------
    peaks
        `direct_peak` of each pitch.
    """
    largest = np.nanmax(peaks) if len(peaks) and not np.all(np.isnan(peaks)) else 0.0
    return tuple(not peak < RESOLVED_AT_LEAST * largest for peak in peaks)


def _summed(
    image: NDArray[np.float32], white: NDArray[np.float32], mask: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    if image.shape != white.shape or white.shape[:2] != mask.shape:
        raise ValueError(
            f"image {image.shape} and white {white.shape} must agree, and mask {mask.shape} be "
            "their (height, width)"
        )
    whole = white[mask].sum(axis=-1, dtype=np.float64)
    lit = whole > 0
    return image[mask].sum(axis=-1, dtype=np.float64)[lit], whole[lit]
