"""What a camera reports without light: black level, read noise, hot pixels.

After EMVA 1288 (release 4.0, sections 6 and 8): the mean of many dark frames is the offset of
every pixel, their scatter over time the read noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import UnsupportedError

Image = NDArray[np.float32]
Array = NDArray[np.float64]

MIN_FRAMES = 4
# Standard deviation of a normal distribution over its median absolute deviation.
_MAD_TO_DEVIATION = 1.4826
_HOT_DEVIATIONS = 6.0
_NOISY_FACTOR = 5.0
# Three counts of 14 bits: below it, rounding and not the pixel decides.
_LEAST_HOT_OFFSET = 2e-4
_MOST_LEVEL = 0.02
_MOST_HOT_FRACTION = 0.05


@dataclass(frozen=True, slots=True)
class Dark:
    """Result of `DarkFrames.fit`; everything in fractions of the sensor's range.

    Parameters
    ----------
    level, level_deviation
        (colours,): median over pixels of the mean frame, and its standard error from the change
        of the frames' levels.
    read_noise, read_noise_deviation
        (colours,): standard deviation of one frame's value, and its standard error.
    offset
        float32, (height, width, colours): mean frame less `level`.
    hot
        bool, (height, width): some colour is off by more than 6 robust standard deviations of
        all pixels or five times as noisy as they are.
    levels
        (frames, colours): mean level of every frame, the residual over time.
    n_frames
        Number of frames.
    """

    level: Array
    level_deviation: Array
    read_noise: Array
    read_noise_deviation: Array
    offset: Image
    hot: NDArray[np.bool_]
    levels: Array
    n_frames: int


class DarkFrames:
    """Running mean and variance of dark frames (Welford 1962): two images are held."""

    def __init__(self) -> None:
        self._mean: Image | None = None
        self._squares: Image | None = None
        self._levels: list[Array] = []

    def add(self, values: Image) -> None:
        """One frame, float32, (height, width, colours), fraction of the sensor's range."""
        if self._mean is None or self._squares is None:
            self._mean, self._squares = np.zeros_like(values), np.zeros_like(values)
        if values.shape != self._mean.shape:
            raise ValueError(f"a frame {values.shape} among frames {self._mean.shape}")
        self._levels.append(np.median(values, axis=(0, 1)).astype(np.float64))
        step = values - self._mean
        self._mean += step / np.float32(len(self._levels))
        self._squares += step * (values - self._mean)

    def fit(self) -> Dark:
        """Black level, read noise and hot pixels; `UnsupportedError` where they cannot be had."""
        count = len(self._levels)
        if count < MIN_FRAMES or self._mean is None or self._squares is None:
            raise UnsupportedError(
                f"{count} dark frames are too few for a variance: take at least {MIN_FRAMES}"
            )
        variance = self._squares / np.float32(count - 1)
        level = np.median(self._mean, axis=(0, 1)).astype(np.float64)
        if np.any(np.abs(level) > _MOST_LEVEL):
            raise UnsupportedError(
                f"the dark frames read {100 * np.abs(level).max():.1f} % of the sensor's range "
                "after the black level that the camera states: light falls on the sensor, or that "
                "black level is wrong; put the cap on the lens and darken the room"
            )
        offset = self._mean - level.astype(np.float32)
        hot = _hot(offset, variance)
        if hot.mean() > _MOST_HOT_FRACTION:
            raise UnsupportedError(
                f"{hot.mean():.0%} of the pixels stand out from the rest: that is a picture, not "
                "hot pixels; put the cap on the lens and darken the room"
            )
        kept = variance[~hot].astype(np.float64)
        read_noise = np.sqrt(kept.mean(axis=0))
        # Each of n pixels has count − 1 degrees of freedom: σ of s is s/√(2 n (count − 1)).
        degrees = 2 * len(kept) * (count - 1)
        levels = np.array(self._levels)
        return Dark(
            level=level,
            level_deviation=levels.std(axis=0, ddof=1) / np.sqrt(count),
            read_noise=read_noise,
            read_noise_deviation=read_noise / np.sqrt(degrees),
            offset=offset,
            hot=hot,
            levels=levels,
            n_frames=count,
        )


def _hot(offset: Image, variance: Image) -> NDArray[np.bool_]:
    spread = _MAD_TO_DEVIATION * np.median(np.abs(offset), axis=(0, 1))
    limit = np.maximum(_HOT_DEVIATIONS * spread, _LEAST_HOT_OFFSET)
    typical = np.median(variance, axis=(0, 1))
    noisy = variance > np.maximum(_NOISY_FACTOR**2 * typical, _LEAST_HOT_OFFSET**2)
    hot: NDArray[np.bool_] = np.any((np.abs(offset) > limit) | noisy, axis=-1)
    return hot
