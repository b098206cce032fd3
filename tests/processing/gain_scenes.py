"""Pictures of stripes as a camera takes them that chooses its gain by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from processing.frames.sites import Light, Sites

Array = NDArray[np.float64]
ELECTRONS = 20_000.0
READ_NOISE = 5 / ELECTRONS
SIDE = 96


@dataclass
class Camera:
    """Takes pictures with shot and read noise; `curve` is what it does to light afterwards."""

    rng: np.random.Generator
    noisy: bool = True

    def numbers(self, light: Array) -> NDArray[np.float32]:
        if not self.noisy:
            return light.astype(np.float32)
        deviation = np.sqrt(np.maximum(light, 0) / ELECTRONS + READ_NOISE**2)
        return (light + deviation * self.rng.standard_normal(light.shape)).astype(np.float32)

    def light(self, light: Array) -> Light:
        unsaturated = np.zeros(light.shape[:2], np.bool_)
        return SITES.light(self.numbers(light), unsaturated)


SITES = Sites((SIDE, SIDE))


@dataclass(frozen=True, slots=True)
class Scene:
    """Under white light and that of the room, and with stripes of some pitch and contrast."""

    white: Array
    room: Array
    direct: Array

    @classmethod
    def of(cls, rng: np.random.Generator) -> Scene:
        grey = gaussian_filter(rng.standard_normal((SIDE, SIDE)), 8)
        share = gaussian_filter(rng.standard_normal((SIDE, SIDE)), 10)
        white = 0.1 + 0.7 * np.clip(0.5 + 6 * grey, 0, 1)[..., np.newaxis] * [1.0, 0.8, 0.5]
        direct = np.clip(0.7 + 8 * share, 0.2, 1)[..., np.newaxis]
        return cls(white, 0.005 + 0.02 * white, direct)

    def pair(self, pitch_px: float, contrast: float) -> tuple[Array, Array]:
        """Light of stripes and of their complement, without the room's."""
        wave = np.sign(np.sin(np.pi * (np.arange(SIDE) + 0.3) / pitch_px))
        seen = contrast * gaussian_filter(wave, 0.7)[np.newaxis, :, np.newaxis] * self.direct
        return 0.5 * self.white * (1 + seen), 0.5 * self.white * (1 - seen)
