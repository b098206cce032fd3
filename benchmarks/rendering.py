"""Frames of a scene under any patterns, path-traced (`benchmarks.light_paths`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.light_paths import RANGE_EDGES_PX, trace
from benchmarks.solids import Scenery, solid_table
from processing.frames.harmonics import PitchDesign
from processing.patterns import Pattern

Image = NDArray[np.float32]

KINDS = ("direct", "subsurface", "interreflection")


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
    contrast = np.zeros((height * width, 1, 3, len(patterns)), np.float32)
    truth = np.zeros((3, height * width, 3))
    trace(
        solid_table(scenery.solids), scenery.camera.axes(), scenery.projector.axes(), down,
        right, round(np.sqrt(paths)), scenery.seed, contrast, truth,
        np.zeros((height * width, 2, 3, 0)), np.zeros((height * width, 6)),
    )  # fmt: skip
    parts = {
        name: part.reshape(height, width, 3).astype(np.float32)
        for name, part in zip(KINDS, truth, strict=True)
    }
    return Rendered(tuple(patterns), contrast.reshape(height, width, 3, -1), parts)


@dataclass(frozen=True, slots=True)
class RenderedParts:
    """What every kind of light adds to the harmonics of each pitch, which no camera could tell.

    Parameters
    ----------
    harmonics
        complex64, (3, pitches, 2, height, width, 3): Z⁺ and Z⁻ of each kind (`KINDS`), constant
        light subtracted, see `processing.frames.harmonics`.
    truth
        float32, (3, height, width, 3).
    ranges
        float32, (2, height, width, 3, bins): light below the surface and the rest by the distance
        on the projector between where it arrives and what its pixel sees
        (`benchmarks.light_paths.RANGE_EDGES_PX`).
    lit_px, seen_px
        float64, (2, height, width): mean y and x of where direct light arrives, and of what the
        pixel sees, shadows or not, in the unit of `processing.ranges.correspondence`; NaN for
        nowhere.
    """

    harmonics: NDArray[np.complex64]
    truth: Image
    ranges: Image
    lit_px: NDArray[np.float64]
    seen_px: NDArray[np.float64]

    def unit_response(self, kind: int, mask: NDArray[np.bool_]) -> NDArray[np.complex128]:
        """What unit light of a kind adds in each pixel, (pitches, 2, n, colours); 0 without any."""
        light = self.truth[kind][mask].astype(np.float64)
        added = self.harmonics[kind][:, :, mask].astype(np.complex128)
        response: NDArray[np.complex128] = added / np.where(light > 0, light, np.inf)
        return response

    def defocused(self, lens_px: float) -> RenderedParts:
        """Through a lens that spreads light over its neighbours, standard deviation in pixels."""

        def seen(images: NDArray[np.floating], first: int) -> NDArray[np.floating]:
            axes = first, first + 1
            blurred: NDArray[np.floating] = ndimage.gaussian_filter(
                images, lens_px, axes=axes, mode="nearest"
            )
            return blurred

        light = self.truth[0].sum(axis=-1).astype(np.float64)
        arrives = seen(light, 0)
        lit_px = seen(np.nan_to_num(self.lit_px) * light, 1) / np.where(
            arrives > 0, arrives, np.nan
        )
        harmonics = seen(self.harmonics.real, 3) + 1j * seen(self.harmonics.imag, 3)
        return RenderedParts(
            harmonics.astype(np.complex64), seen(self.truth, 1).astype(np.float32),
            seen(self.ranges, 1).astype(np.float32), lit_px, self.seen_px,
        )  # fmt: skip

    def scaled(self, gain: float) -> RenderedParts:
        """All light times a gain."""
        factor = np.float32(gain)
        return RenderedParts(
            self.harmonics * factor, self.truth * factor, self.ranges * factor, self.lit_px,
            self.seen_px,
        )  # fmt: skip


def render_parts(
    scenery: Scenery, designs: Sequence[PitchDesign], paths: int, blur_px: float = 0.0
) -> RenderedParts:
    """Trace the very paths of `render`, kinds of light apart.

    What the frames of a pitch, a grid of shifts, add up to is separable, (y's part)·(x's part):
    the light is weighted with that instead of with every frame's code.
    """
    height, width = scenery.camera.pixels
    down, right = [], []
    for design in designs:
        waves = wave_tables(design.patterns, scenery.projector.pixels, blur_px)
        shifts_px = np.array([(one.shift_y_px, one.shift_x_px) for one in design.patterns]).T
        # Each shift along one axis comes with every shift along the other.
        turned = [
            wave @ np.exp(1j * np.pi * one / design.pitch_px) * (len(set(one)) / len(one))
            for wave, one in zip(waves, shifts_px, strict=True)
        ]
        for y in (turned[0].real, turned[0].imag):
            for x in (turned[1].real, turned[1].imag):
                down.append(y)
                right.append(x)
    contrast = np.zeros((height * width, 3, 3, len(down)), np.float32)
    truth = np.zeros((3, height * width, 3))
    ranges = np.zeros((height * width, 2, 3, len(RANGE_EDGES_PX) + 1))
    places = np.zeros((height * width, 6))
    rows, columns = (
        np.ascontiguousarray(np.stack(one, axis=1), np.float32) for one in (down, right)
    )
    trace(
        solid_table(scenery.solids), scenery.camera.axes(), scenery.projector.axes(), rows, columns,
        round(np.sqrt(paths)), scenery.seed, contrast, truth, ranges, places,
    )  # fmt: skip
    sums = contrast.reshape(height, width, 3, 3, len(designs), 2, 2).astype(np.float64)
    rr, ri, ir, ii = sums[..., 0, 0], sums[..., 0, 1], sums[..., 1, 0], sums[..., 1, 1]
    # A frame is half of white and half of its code's light.
    pair = 0.5 * np.stack([rr - ii + 1j * (ri + ir), rr + ii + 1j * (ir - ri)], axis=-1)
    picture = (height, width)
    return RenderedParts(
        np.moveaxis(pair, (2, 4, 5), (0, 1, 2)).astype(np.complex64),
        truth.reshape(3, *picture, 3).astype(np.float32),
        np.moveaxis(ranges.reshape(*picture, *ranges.shape[1:]), 2, 0).astype(np.float32),
        _mean_place(places[:, :3]).reshape(2, *picture),
        _mean_place(places[:, 3:]).reshape(2, *picture),
    )


def _mean_place(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2, pixels) of (pixels, 3) rows, columns and weights; centres of pixels are at ½."""
    weight = np.where(sums[:, 2] > 0, sums[:, 2], np.nan)
    mean: NDArray[np.float64] = sums[:, :2].T / weight + 0.5
    return mean


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
