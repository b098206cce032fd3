"""What projector, lens and pixels leave of a pattern's contrast, known from a flat board.

A board neither scatters nor reflects to itself: what it loses of direct light, optics lost. Blur of
variance s² a side makes of a square wave of half-period P

    q(x) = Σ_k (−1)^k [Φ((x − kP)/s) − Φ((x − (k + 1)P)/s)],

of a checker the product of two, and of a sinusoid exp(−π² s²/(2P²)) of itself. Max/min over the
shifts of a pitch reads the range of that, which depends on where in the pattern a pixel lies; its
mean over all places is the share α that is left of direct light. Where the measured modulation
departs from that of the Gaussian, α is scaled by the ratio of both. How the range differs from
place to place is a part of the error of what is divided by α.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import exp, hypot, normal
from processing.numerics.linear_algebra import product
from processing.patterns import Pattern, balanced

Array: TypeAlias = NDArray[np.float64]

# Share of direct light below which what is left is mostly noise.
USABLE = 0.3
# Modulation below which its ratio to another is noise.
_LEAST_MODULATION = 0.15
_PLACES = 24
_PERIODS = 6
_SHARP_PX = 1e-6


@dataclass(frozen=True, slots=True)
class OpticalContrast:
    """Contrast of one optical set-up.

    Parameters
    ----------
    side_px2, deviation_px2
        float64, (colours,): variance of the blur along a side, projector pixels squared, and its
        standard error.
    pitch_px, modulation
        float64, (m,) rising, and (m, colours): measured modulation of a checker's fundamental.
    """

    side_px2: Array
    deviation_px2: Array
    pitch_px: Array
    modulation: Array

    def left(self, patterns: Sequence[Pattern], *, with_white: bool) -> Array:
        """(colours,): α of the patterns of one family and pitch.

        Parameters
        ----------
        patterns
            Those that were captured.
        with_white
            White stands in for the complements that are not among them.
        """
        first = patterns[0]
        # A sinusoid and stripes vary along one side only: half the blur in the exponent.
        both = first.family.varies_down and first.family.varies_right
        departure = self._departure(first.pitch_px)
        shares = self._ranges(patterns, with_white=with_white).mean(axis=1)
        found: Array = np.minimum(shares * (departure if both else np.sqrt(departure)), 1.0)
        return found

    def relative_error(self, patterns: Sequence[Pattern], *, with_white: bool) -> Array:
        """(colours,): standard error of α over α, of the blur and of a pixel's place."""
        ranges = self._ranges(patterns, with_white=with_white)
        place = ranges.std(axis=1) / ranges.mean(axis=1)
        blur = (np.pi / patterns[0].pitch_px) ** 2 * self.deviation_px2
        found: Array = hypot(place, blur)
        return found

    def _ranges(self, patterns: Sequence[Pattern], *, with_white: bool) -> Array:
        """(colours, places): what max/min, or the amplitude, reads of direct light 1."""
        first = patterns[0]
        if not first.family.is_binary:
            faded = exp(-((np.pi / first.pitch_px) ** 2) * self.side_px2 / 2)
            return np.asarray(faded[:, np.newaxis], np.float64)
        complemented = with_white and not balanced(patterns)
        blurs = np.sqrt(self.side_px2)
        return np.stack([_ranges_of(patterns, blur, complemented) for blur in blurs])

    def _departure(self, pitch_px: int) -> Array:
        """Measured over Gaussian modulation at a pitch, (colours,)."""
        fitted = exp(-((np.pi / self.pitch_px[:, np.newaxis]) ** 2) * self.side_px2)
        sure = (fitted > _LEAST_MODULATION) & (self.modulation > _LEAST_MODULATION)
        ratio = np.where(sure, self.modulation / np.where(sure, fitted, 1.0), 1.0)
        return np.array([np.interp(pitch_px, self.pitch_px, column) for column in ratio.T])


def _ranges_of(patterns: Sequence[Pattern], blur_px: float, complemented: bool) -> Array:
    """(places,): largest less smallest light of binary patterns."""
    period = 2 * patterns[0].pitch_px
    places = (np.arange(_PLACES) + 0.5) / _PLACES * period
    down = np.stack([_wave(places + p.shift_y_px, p.pitch_px, blur_px) for p in patterns])
    right = np.stack([_wave(places + p.shift_x_px, p.pitch_px, blur_px) for p in patterns])
    family = patterns[0].family
    rows = down if family.varies_down else np.ones_like(down)
    columns = right if family.varies_right else np.ones_like(right)
    light = (1 + rows[:, :, np.newaxis] * columns[:, np.newaxis]) / 2
    if complemented:
        light = np.concatenate([light, 1 - light])
    found: Array = np.ptp(light, axis=0).ravel()
    return found


def _wave(place_px: Array, pitch_px: int, blur_px: float) -> Array:
    """A square wave of half-period `pitch_px` and amplitude 1, blurred."""
    centred = place_px % (2 * pitch_px)
    edges = np.arange(-2 * _PERIODS, 2 * _PERIODS + 2) * pitch_px
    steps = normal((centred[:, np.newaxis] - edges) / max(blur_px, _SHARP_PX))
    signs = np.where(np.arange(len(edges) - 1) % 2, -1.0, 1.0)
    found: Array = product(steps[:, :-1] - steps[:, 1:], signs)
    return found
