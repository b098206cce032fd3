"""Pixels whose light is known: frames made from the codes themselves, spread by spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.patterns import Family, Pattern, shift_grid

PROJECTOR_PX = (192, 256)
PITCHES_PX = (8, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96)


@dataclass(frozen=True, slots=True)
class Scene:
    """A picture of n places on the projector.

    Parameters
    ----------
    places_px
        (2, height, width): y and x that each pixel sees, pixel centres at whole numbers.
    parts
        For each spread in projector pixels (infinite: all of the raster alike), (height, width,
        colours) of light.
    blur_px
        Standard deviation of the projector's blur.
    """

    places_px: NDArray[np.float64]
    parts: dict[float, NDArray[np.float64]]
    blur_px: float = 0.8

    @property
    def white(self) -> NDArray[np.float64]:
        total: NDArray[np.float64] = np.sum(list(self.parts.values()), axis=0)
        return total

    def frame(self, pattern: Pattern) -> NDArray[np.float32]:
        """What the camera sees; beyond the raster's edge the pattern goes on."""
        total = np.zeros(self.white.shape)
        for spread_px, light in self.parts.items():
            sigma = np.hypot(spread_px, self.blur_px)
            seen = 0.5 * (1 + self._contrast(pattern, sigma)) if pattern.pitch_px else 1.0
            total += np.broadcast_to(seen, self.places_px.shape[1:])[..., np.newaxis] * light
        return total.astype(np.float32)

    def _contrast(self, pattern: Pattern, sigma: float) -> NDArray[np.float64]:
        """2·code − 1 at the places, smoothed: a product of what varies down and to the right."""
        if np.isinf(sigma):
            return np.zeros(self.places_px.shape[1:])
        # Whole periods, so that smoothing may wrap around.
        side = 2 * pattern.pitch_px * (1 + max(PROJECTOR_PX) // (2 * pattern.pitch_px))
        down = 2 * pattern.code((side, 1))[:, 0] - 1
        right = 2 * pattern.code((1, side))[0] - 1
        strips = [down, right * (right[0] if pattern.family.varies_down else 1)]
        varies = pattern.family.varies_down, pattern.family.varies_right
        product = np.ones(self.places_px.shape[1:])
        for strip, at, used in zip(strips, self.places_px, varies, strict=True):
            if used:
                smooth = ndimage.gaussian_filter1d(strip, sigma, mode="wrap", truncate=5)
                product *= np.interp(at % side, np.arange(side + 1), np.append(smooth, smooth[0]))
        return product


def slanted(shape: tuple[int, int], scale: float = 2.7) -> NDArray[np.float64]:
    """Places on a plane that the projector meets a little askew."""
    down, right = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    return np.stack([20 + scale * down + 0.1 * right, 30 - 0.15 * down + 0.9 * scale * right])


def checkers(pitches_px: Sequence[int] = PITCHES_PX) -> list[Pattern]:
    return [
        Pattern(Family.CHECKER, pitch_px, *shift)
        for pitch_px in pitches_px
        for shift in shift_grid(pitch_px, (6, 6))
    ]


def waves(family: Family, count: int, pitches_px: Sequence[int] = PITCHES_PX) -> list[Pattern]:
    """Stripes or sinusoids in evenly spread shifts over a period."""
    down = family.varies_down
    return [
        Pattern(family, pitch_px, *((shift_px, 0) if down else (0, shift_px)))
        for pitch_px in pitches_px
        for shift_px in [2 * pitch_px * k // count for k in range(count)]
    ]
