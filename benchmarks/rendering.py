"""Frames of a scene under any patterns, path-traced (`benchmarks.light_paths`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.light_paths import trace
from benchmarks.solids import Scenery, solid_table
from processing.patterns import Pattern

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Rendered:
    """What the camera sees.

    Parameters
    ----------
    patterns
        m of them.
    contrast
        float32, (height, width, 3, m): the frame of a pattern is ½ (white + contrast).
    truth
        Direct light, subsurface scattering and inter-reflection, (height, width, 3) each.
    """

    patterns: tuple[Pattern, ...]
    contrast: Image
    truth: dict[str, Image] = field(default_factory=dict)

    @property
    def white(self) -> Image:
        """All light, (height, width, 3)."""
        total: Image = np.sum(list(self.truth.values()), axis=0)
        return total

    def frame(self, index: int) -> Image:
        """Frame of one pattern, float32, (height, width, 3)."""
        seen: Image = np.float32(0.5) * (self.white + self.contrast[..., index])
        return seen


def render(
    scenery: Scenery, patterns: Sequence[Pattern], paths: int, blur_px: float = 0.0
) -> Rendered:
    """Trace `paths` (a square number) through every camera pixel.

    Parameters
    ----------
    scenery
        What is seen.
    patterns
        No white and no black among them.
    paths
        Through each pixel.
    blur_px
        Standard deviation of the projector's blur, in projector pixels.
    """
    height, width = scenery.camera.pixels
    down, right = wave_tables(patterns, scenery.projector.pixels, blur_px)
    contrast = np.zeros((height * width, 3, len(patterns)), np.float32)
    truth = np.zeros((3, height * width, 3))
    trace(
        solid_table(scenery.solids), scenery.camera.axes(), scenery.projector.axes(), down,
        right, round(np.sqrt(paths)), scenery.seed, contrast, truth,
    )  # fmt: skip
    names = ("direct", "subsurface", "interreflection")
    parts = {
        name: part.reshape(height, width, 3).astype(np.float32)
        for name, part in zip(names, truth, strict=True)
    }
    return Rendered(tuple(patterns), contrast.reshape(height, width, 3, -1), parts)


def wave_tables(
    patterns: Sequence[Pattern], pixels: tuple[int, int], blur_px: float
) -> tuple[Image, Image]:
    """2·code − 1 = down·right of every pattern, (height, m) and (width, m)."""
    tables = []
    for axis in range(2):
        waves = []
        for pattern in patterns:
            varies = (pattern.family.varies_down, pattern.family.varies_right)
            if not varies[axis]:
                waves.append(np.ones(pixels[axis]))
                continue
            # Beyond the raster there is no light, so blur is that of the unbounded pattern.
            pad = 4 * int(np.ceil(blur_px)) * 2 * pattern.pitch_px
            shift = (pattern.shift_y_px, pattern.shift_x_px)[axis]
            at = np.arange(-pad, pixels[axis] + pad) + shift
            if pattern.family.is_binary:
                wave = np.where(at // pattern.pitch_px % 2 == 0, 1.0, -1.0)
            else:
                wave = np.cos(np.pi * at / pattern.pitch_px)
            if blur_px:
                wave = ndimage.gaussian_filter1d(wave, blur_px, truncate=5)
            waves.append(wave[pad : len(wave) - pad])
        tables.append(np.ascontiguousarray(np.stack(waves, axis=1), np.float32))
    return tables[0], tables[1]
