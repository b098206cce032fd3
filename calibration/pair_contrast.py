"""Modulation against pitch from complementary pairs of any binary pattern on a flat matte board.

A pattern and its complement differ by W·q and add up to W, W the light of white less black and q
the blurred square wave, ±1, or the product of two for a checker. Over all places of a pattern of
pitch P that was blurred by variance s² a side the mean of q² is A(s²/P²)^d,

    A(t) = Σ_{m odd} 8/(π² m²) exp(−π² m² t),

d the number of directions in which the pattern varies. Pixels weigh as their light squared. That
neither asks for certain shifts nor for a camera that keeps its gain from pair to pair.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from calibration.contrast import parts_of

Array: TypeAlias = NDArray[np.float64]
Image: TypeAlias = NDArray[np.float32]

_ORDERS = np.arange(1, 400, 2, dtype=np.float64)
_MOST_BLUR = 4.0


class PairContrast:
    """Squares of what the complementary pairs of one pitch and family differ by.

    Parameters
    ----------
    light
        float32, (height, width, colours): white less black.
    usable
        bool, (height, width).
    n_whites
        Of how many frames white is the mean, which tells the noise of sums from that of white.
    blocks
        The picture is told apart in so many parts down and right.
    """

    def __init__(self, light: Image, usable: NDArray[np.bool_], n_whites: int, blocks: int) -> None:
        self._light, self._usable, self._n_whites = light, usable, n_whites
        self._differences = np.zeros((blocks, blocks, light.shape[2]))
        self._sums = np.zeros_like(self._differences)
        self._largest = np.zeros_like(light)
        self._sizes = np.zeros(light.shape[2])
        self._whole = np.zeros(light.shape[2])
        self.gains: list[float] = []

    def add(self, frame: Image, complement: Image) -> None:
        """A frame and its complement, black taken off both, (height, width, colours)."""
        if frame.shape != self._light.shape or complement.shape != self._light.shape:
            raise ValueError(
                f"frames {frame.shape} and {complement.shape} do not fit the light of white "
                f"{self._light.shape}"
            )
        difference, whole = frame - complement, frame + complement
        weights = self._light[self._usable].sum(axis=0, dtype=np.float64)
        gain = whole[self._usable].sum(axis=0, dtype=np.float64) / np.maximum(weights, 1e-30)
        self.gains.append(float(gain.mean()))
        noise = self._noise(whole - gain.astype(np.float32) * self._light)
        for part, region in parts_of(self._usable.shape, len(self._sums)):
            lit = self._usable[region]
            squares = np.square(difference[region][lit], dtype=np.float64).sum(axis=0)
            self._differences[part] += squares - noise * lit.sum()
            self._sums[part] += np.square(whole[region][lit], dtype=np.float64).sum(axis=0)
        # Each pair in the light of white, so that pairs of other gains compare.
        np.maximum(self._largest, np.abs(difference) / gain.astype(np.float32), out=self._largest)

    def mean_square(self) -> Array:
        """(colours,): mean of q² over the usable pixels, freed from what noise adds."""
        found: Array = self._differences.sum(axis=(0, 1)) / self._sums.sum(axis=(0, 1))
        return found

    def extremes(self) -> Array:
        """(colours,): what max/min over the pairs takes for direct light."""
        gap = self._largest[self._usable].sum(axis=0, dtype=np.float64)
        return np.asarray(gap / self._light[self._usable].sum(axis=0, dtype=np.float64))

    def blocks(self) -> Array:
        """(parts, parts): mean of q² of all colours; NaN where nothing is lit."""
        sums = self._sums.sum(axis=2)
        found: Array = self._differences.sum(axis=2) / np.where(sums > 0, sums, np.nan)
        return found

    def _noise(self, rest: Image) -> Array:
        """(colours,): variance of a pair's difference, from neighbours in what misses white.

        What texture, movement or gain leave there is smooth from pixel to pixel, noise is not.
        """
        both = self._usable[:, 1:] & self._usable[:, :-1]
        steps = (rest[:, 1:] - rest[:, :-1])[both]
        variance = np.square(steps, dtype=np.float64).mean(axis=0) / 2 if len(steps) else 0.0
        return np.asarray(variance / (1 + 1 / self._n_whites))


def checker_modulation(mean_square: Array, n_directions: int) -> Array:
    """Fundamental of a checker of the same pitch and blur over a perfect one's, exp(−π² s²/P²).

    Parameters
    ----------
    mean_square
        Any shape: mean of q² over all places.
    n_directions
        In which the pattern varies: 1 for stripes, 2 for checkers.

    Returns
    -------
    The same shape; of more contrast than there can be the contrast itself.
    """
    if n_directions not in {1, 2}:
        raise ValueError(f"a pattern varies in 1 or 2 directions, not {n_directions}")
    along = np.maximum(np.asarray(mean_square, np.float64), 0) ** (1 / n_directions)
    found = [_of_axis(value) for value in along.ravel()]
    return np.array(found, np.float64).reshape(along.shape)


def _of_axis(mean_square: float) -> float:
    if not mean_square < _square(0.0):
        return mean_square
    if mean_square <= _square(_MOST_BLUR):
        return 0.0
    blur = brentq(lambda t: _square(t) - mean_square, 0.0, _MOST_BLUR, xtol=1e-12)
    return float(np.exp(-(np.pi**2) * blur))


def _square(blur: float) -> float:
    """A(t): mean square of a square wave of amplitude 1 blurred by t = s²/P²."""
    faded = np.exp(-((np.pi * _ORDERS) ** 2) * blur)
    return float(np.sum(8 / (np.pi * _ORDERS) ** 2 * faded))
