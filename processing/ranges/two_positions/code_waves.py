"""What a place on the projector's raster adds to the difference of a pattern and its complement.

Unit light that spreads over a variance σ² adds s(t), the square wave of the pattern seen through
that spread, the projector's blur and the camera pixel (`processing.ranges.response.code_wave`),
with t the place along the direction in which the pattern varies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign
from processing.numerics.elementary import exp, normal
from processing.ranges.kernels import compiled
from processing.ranges.response import BINS_PER_PX, Footprint, bin_of, code_wave

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Steps are no sharper than this; edges as far count; beyond so many deviations Φ is 0 or 1.
_SHARPEST_PX = 0.02
_EDGES = 6
_FAR = 7.0


@dataclass(frozen=True, slots=True)
class CodeWaves:
    """s(t) of every pitch and spread, one pitch's bins after the other's.

    Parameters
    ----------
    wave
        float32, (bins, spreads), at t = 0, ¼, ½ … one period, the end included, t counted from
        the upper or left edge of the raster.
    slope
        float32, (bins,), ds/dt of the first spread, taken over a pixel.
    first
        (pitches,), index of each pitch's first bin.
    pitch_px
        (pitches,).
    axis
        int64, (pitches,): 0 for patterns that vary down, 1 to the right.
    """

    wave: Single
    slope: Single
    first: NDArray[np.int64]
    pitch_px: Array
    axis: NDArray[np.int64]

    @classmethod
    def of(
        cls,
        designs: Sequence[PitchDesign],
        spread_px: Sequence[float] | Array,
        blur_px2: float,
        box_px: float = 0.0,
        *,
        half_on: bool = False,
    ) -> CodeWaves:
        """Waves of pairs.

        Parameters
        ----------
        designs, spread_px, blur_px2, box_px
            As for `processing.ranges.response.ResponseTables.of`.
        half_on
            Every pattern stands half of its pitch from where it is said to, as the bits of a Gray
            code stand to those of the binary number.
        """
        footprint = Footprint.of(spread_px, blur_px2, box_px)
        waves = [_wave(design, footprint, half_on=half_on) for design in designs]
        slopes = [_slope(one[:, 0]) for one in waves]
        ends = np.cumsum([len(one) for one in waves])
        return cls(
            np.concatenate(waves).astype(np.float32),
            np.concatenate(slopes).astype(np.float32),
            np.append(0, ends[:-1]).astype(np.int64),
            np.array([design.pitch_px for design in designs], np.float64),
            np.array([int(design.family.varies_right) for design in designs], np.int64),
        )

    def only(self, chosen: NDArray[np.int64]) -> CodeWaves:
        """Some of the pitches."""
        ends = np.append(self.first[1:], len(self.wave))
        parts = [slice(self.first[k], ends[k]) for k in chosen]
        sizes = np.cumsum([part.stop - part.start for part in parts])
        return CodeWaves(
            np.concatenate([self.wave[part] for part in parts]),
            np.concatenate([self.slope[part] for part in parts]),
            np.append(0, sizes[:-1]).astype(np.int64),
            self.pitch_px[chosen],
            self.axis[chosen],
        )


def _wave(design: PitchDesign, footprint: Footprint, *, half_on: bool) -> Array:
    """(bins, spreads) of one pitch, as its first pattern is shifted."""
    pitch_px = design.pitch_px
    places = np.arange(2 * pitch_px * BINS_PER_PX) / BINS_PER_PX
    wave = code_wave(design, places, footprint)
    if design.family.is_binary:
        # A sum of harmonics would need thousands of them for wide stripes.
        for k in np.flatnonzero(footprint.sigma_px < pitch_px / 2):
            wave[:, k] = _edges(places, pitch_px, float(footprint.sigma_px[k]), footprint.box_px)
    shown = design.patterns[0]
    shift_px = shown.shift_x_px if design.family.varies_right else shown.shift_y_px
    shift = shift_px * BINS_PER_PX + half_on * pitch_px * BINS_PER_PX // 2
    wave = np.roll(wave, -shift, axis=0)
    return np.concatenate([wave, wave[:1]])


def _edges(places: Array, pitch_px: int, sigma_px: float, box_px: float) -> Array:
    """The square wave as the sum of its edges, each a step seen through the footprint.

    A step through a Gaussian is 2Φ(t/σ) − 1, whose mean over a box of width w follows from
    ∫Φ(z) dz = zΦ(z) + φ(z).
    """
    sigma_px, box_px = max(sigma_px, _SHARPEST_PX), max(box_px, _SHARPEST_PX)
    wave = np.full(len(places), -1.0)
    for edge in range(-_EDGES, _EDGES + 2):
        at = (places - edge * pitch_px)[np.newaxis] + np.array([[0.5], [-0.5]]) * box_px
        after, before = _antiderivative(at / sigma_px)
        rise = sigma_px / box_px * (after - before)
        # Before the first edge, an even one, it is dark.
        wave += (2 if edge % 2 == 0 else -2) * rise
    return wave


def _antiderivative(deviates: Array) -> Array:
    """∫Φ(z) dz."""
    density = exp(-0.5 * deviates**2) / np.sqrt(2 * np.pi)
    inside = np.clip(deviates, -_FAR, _FAR)
    integral: Array = np.where(
        np.abs(deviates) < _FAR, inside * normal(inside) + density, np.maximum(deviates, 0.0)
    )
    return integral


def _slope(wave: Array) -> Array:
    reach = BINS_PER_PX // 2
    slope = np.roll(wave[:-1], -reach) - np.roll(wave[:-1], reach)
    return np.append(slope, slope[0])


def first_waves(waves: CodeWaves, places_px: Array) -> Single:
    """S of the first spread at n places, float32, (pitches, n)."""
    found = np.empty((len(waves.pitch_px), len(places_px)), np.float32)
    _look_up(waves.wave, waves.first, waves.pitch_px, places_px, found)
    return found


@compiled
def _look_up(wave, first, pitch_px, places, found):  # type: ignore[no-untyped-def]
    for k in range(len(found)):
        for j in range(places.size):
            index, part = bin_of(places[j], 2 * pitch_px[k])
            at = first[k] + index
            found[k, j] = wave[at, 0] * (1 - part) + wave[at + 1, 0] * part
