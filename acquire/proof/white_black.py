"""White and black, and what they say about the places of a picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.proof.samples import FrameSamples
from processing.frames.noise import noise_deviation
from processing.proof.parts import Parts
from processing.proof.sample_noise import SampleNoise, noise_through

# Parts of the bright level (99th percentile): what is darker is not lit, or not looked at.
UNLIT = 0.01
LOOKED_AT = 0.03
# Part of white's light below which a place is dark, and standard deviations of noise that light
# has at least for that to be told.
DARK_AT = 0.2
CERTAIN = 6.0
BLOCKS = 4, 4
STRIPS = 16, 1


@dataclass(frozen=True, slots=True)
class WhiteBlack:
    """The first white and the first black, exposed alike, and the noise of a sample."""

    white: FrameSamples
    black: FrameSamples
    noise: SampleNoise

    @classmethod
    def of(cls, white: FrameSamples, black: FrameSamples) -> WhiteBlack:
        """With the noise of a sample, from how dark and how bright windows scatter."""
        points = [(float(one.window.mean()), window_noise(one)) for one in (black, white)]
        return cls(white, black, noise_through(points[0], points[1]))

    def lit(self, part: float) -> NDArray[np.bool_]:
        """bool, (rows, columns): places that white lights, by so much of the bright level."""
        light = self.white.grid - self.black.grid
        lit: NDArray[np.bool_] = light > part * float(np.percentile(light, 99))
        return lit

    @property
    def usable(self) -> NDArray[np.bool_]:
        """bool, (rows, columns): places that are looked at and not saturated in white."""
        return self.lit(LOOKED_AT) & ~self.white.saturated

    @property
    def unlit(self) -> float:
        """Part of the places that white does not light."""
        return 1 - float(self.lit(UNLIT).mean())

    def shaded(self, light: NDArray[np.float32]) -> float:
        """Part of the places that white lights clearly that are dark in another picture.

        Parameters
        ----------
        light
            float32, (rows, columns), of a picture in which the projector lit every place.
        """
        due = (self.white.grid - self.black.grid).astype(np.float64)
        certain = CERTAIN * np.sqrt(2 * self.noise.at(self.white.grid))
        looked_at = self.lit(LOOKED_AT) & (due > certain)
        dark = looked_at & (light - self.black.grid < DARK_AT * due)
        return float(dark.sum() / max(int(looked_at.sum()), 1))


def spread_evenly(chosen: NDArray[np.bool_], most: int) -> NDArray[np.int64]:
    """Indices of so many chosen places, over the whole picture."""
    every = np.flatnonzero(chosen)
    return every[:: max(-(-len(every) // most), 1)]


def window_noise(samples: FrameSamples) -> float:
    """Variance of a pixel's noise, mean over the window."""
    window = samples.window
    if min(window.shape) < 3:
        return 0.0
    usable = np.ones(window.shape, bool)
    return noise_deviation(window[..., np.newaxis], usable) ** 2


def partitions_of(lit: NDArray[np.bool_]) -> tuple[Parts, ...]:
    """The whole of the lit places, blocks, and strips across the picture."""
    down, right = np.nonzero(lit)
    return tuple(
        Parts.grid((down, right), lit.shape, counts) for counts in ((1, 1), BLOCKS, STRIPS)
    )
