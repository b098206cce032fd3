"""What a place on the projector's raster adds to the harmonics of a pitch, at every spread.

A camera pixel that sees the place (y, x) through a spread of variance σ² a side sees, instead of
the code of a checker, s(y + d) s(x + r) with the square wave

    s(t) = Σ_{m odd} 4/(πm) sinc(mw/2P) exp(−½ (πmσ/P)²) sin(πm (t + ½)/P),

(+½: the edge of pixel 0 lies at −½; w is the width of the camera pixel on the projector, sinc(x) =
sin(πx)/πx), and for sinusoids one cosine in its place. Over a grid of
shifts the harmonics of `processing.frames.harmonics` are therefore products of two tables,

    Z⁺ = T(y) T(x),   Z⁻ = T(y) T(x)*,   T(t) = Σ_d s(t + d) e^{iπd/P},

which hold all harmonics of the wave, those that few shifts mix up (aliases) included. Where the
shifts are no grid the tables hold the fundamental alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign
from processing.numerics.elementary import arctan2, cos, exp, sin, sinc, turned
from processing.numerics.linear_algebra import product
from processing.patterns import Family
from processing.ranges.kernels import compiled

BINS_PER_PX = 4
_MOST_HARMONICS = 300


@dataclass(frozen=True, slots=True)
class ResponseTables:
    """T(t) of every pitch and spread, one pitch's bins after the other's.

    Parameters
    ----------
    down, right
        complex128, (bins, spreads), at t = 0, ¼, ½ … one period, the end included, t counted
        from the upper or left edge of the raster.
    down_slope, right_slope
        float64, (bins,), d arg T/dt of the first spread, taken over a pixel to both sides.
    first
        (pitches,), index of each pitch's first bin.
    pitch_px
        (pitches,).
    spread_px
        (spreads,), standard deviations; the first, 0, is light that does not travel.
    varies
        float64, (pitches, 2): 1 where the patterns vary down or to the right, else 0.
    blur_error_px2
        Standard error of the variance a side of the blur that everything is seen through.
    box_px
        Width of the uniform part of that blur.
    """

    down: NDArray[np.complex128]
    right: NDArray[np.complex128]
    down_slope: NDArray[np.float64]
    right_slope: NDArray[np.float64]
    first: NDArray[np.int64]
    pitch_px: NDArray[np.float64]
    spread_px: NDArray[np.float64]
    varies: NDArray[np.float64]
    blur_error_px2: float
    box_px: float

    @classmethod
    def of(
        cls,
        designs: Sequence[PitchDesign],
        spread_px: Sequence[float] | NDArray[np.float64],
        blur_px2: float,
        box_px: float = 0.0,
        blur_error_px2: float = 0.0,
    ) -> ResponseTables:
        """Tables for all pitches of a session.

        Parameters
        ----------
        designs
            One for each family and pitch.
        spread_px
            Standard deviations in projector pixels, the first 0.
        blur_px2
            Variance of the blur along either axis, in projector pixels squared, ≥ 0.
        box_px
            Width of the part of the blur that a camera pixel makes: its weight is uniform, not
            Gaussian. Cut to what the variance allows, w²/12.
        blur_error_px2
            `processing.ranges.blur.Blur.error_px2`.
        """
        spreads = np.asarray(spread_px, np.float64)
        footprint = Footprint.of(spreads, blur_px2, box_px)
        box_px = footprint.box_px
        down = [_table(design, footprint, down=True) for design in designs]
        right = [_table(design, footprint, down=False) for design in designs]
        sizes = [len(table) for table in down]
        return cls(
            np.concatenate(down),
            np.concatenate(right),
            np.concatenate([_phase_slope(table[:, 0]) for table in down]),
            np.concatenate([_phase_slope(table[:, 0]) for table in right]),
            np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
            np.array([design.pitch_px for design in designs], np.float64),
            spreads,
            np.array([[d.family.varies_down, d.family.varies_right] for d in designs], np.float64),
            blur_error_px2,
            box_px,
        )

    def mean_response(self) -> NDArray[np.float64]:
        """(pitches, spreads): correlation slope of a spread, averaged over all places.

        The mean of Re⟨Z_σ, Z_0⟩ over that of ⟨Z_0, Z_0⟩; 1 for the first spread.
        """
        ends = np.append(self.first[1:], len(self.down))
        rows = []
        for first, end in zip(self.first, ends, strict=True):
            down, right = self.down[first : end - 1], self.right[first : end - 1]
            both = np.mean(_aligned(down, down[:, :1]), axis=0)
            both = both * np.mean(_aligned(right, right[:, :1]), axis=0)
            rows.append(both / both[0])
        return np.array(rows)


def carrier(design: PitchDesign, *, down: bool) -> complex:
    """κ of T(t) ≈ κ e^{−iπt/P} · positive, 0 along a direction that does not vary."""
    varies = design.family.varies_down if down else design.family.varies_right
    if not varies:
        return 0
    return 1j if design.family.is_binary else complex(turned(0.5 * np.pi / design.pitch_px))


@dataclass(frozen=True, slots=True)
class Footprint:
    """A box, and a Gaussian of standard deviation `sigma_px` for each spread."""

    sigma_px: NDArray[np.float64]
    box_px: float

    @classmethod
    def of(
        cls,
        spread_px: Sequence[float] | NDArray[np.float64],
        blur_px2: float,
        box_px: float,
    ) -> Footprint:
        """Spreads seen through a blur; parameters as for `ResponseTables.of`."""
        box_px = min(box_px, float(np.sqrt(12 * blur_px2)))
        rest_px2 = max(blur_px2 - box_px**2 / 12, 0.0)
        return cls(np.sqrt(np.asarray(spread_px, np.float64) ** 2 + rest_px2), box_px)

    def transform(self, rates: NDArray[np.float64]) -> NDArray[np.float64]:
        """(rates, spreads), rates in radians a pixel."""
        box = sinc(rates * self.box_px / (2 * np.pi))
        reach: NDArray[np.float64] = exp(-0.5 * np.outer(rates, self.sigma_px) ** 2)
        return reach * box[:, np.newaxis]


def _table(design: PitchDesign, footprint: Footprint, *, down: bool) -> NDArray[np.complex128]:
    """(bins, spreads) of one pitch along one axis."""
    pitch_px = design.pitch_px
    places = np.arange(2 * pitch_px * BINS_PER_PX + 1) / BINS_PER_PX
    if not (design.family.varies_down if down else design.family.varies_right):
        return np.ones((len(places), len(footprint.sigma_px)), np.complex128)
    if not design.is_grid:
        both = design.family is Family.CHECKER
        count = len(design.patterns)
        size = np.sqrt(count) / 2 if both else count / 2
        begin = np.pi / 2 if design.family.is_binary else 0.5 * np.pi / pitch_px
        phase = turned(begin - np.pi * places / pitch_px)
        return np.outer(phase, size * _amplitudes(design, footprint, np.ones(1))[0])
    shifts = sorted({p.shift_y_px if down else p.shift_x_px for p in design.patterns})
    wave = code_wave(design, places[:-1], footprint)
    table = np.zeros((len(places), len(footprint.sigma_px)), np.complex128)
    for shift_px in shifts:
        turn = complex(turned(np.pi * shift_px / pitch_px))
        table[:-1] += turn * np.roll(wave, -shift_px * BINS_PER_PX, axis=0)
    table[-1] = table[0]
    return table


def _phase_slope(table: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Slope d arg T/dt at every bin, from the bins half a pixel to either side."""
    reach = BINS_PER_PX // 2
    ahead, behind = np.roll(table[:-1], -reach), np.roll(table[:-1], reach)
    turn = ahead.imag * behind.real - ahead.real * behind.imag
    slope = arctan2(turn, _aligned(ahead, behind))
    return np.append(slope, slope[0])


def _aligned(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Re(a b*), whose two products numpy would fuse on some processors."""
    return first.real * second.real + first.imag * second.imag


def _amplitudes(
    design: PitchDesign, footprint: Footprint, orders: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(orders, spreads) amplitudes of the wave's harmonics."""
    reach = footprint.transform(np.pi * orders / design.pitch_px)
    if design.family.is_binary:
        return reach * (4 / (np.pi * orders))[:, np.newaxis]
    # A projector pixel holds one value: the cosine is averaged over its width.
    return reach * sinc(0.5 / design.pitch_px)


def code_wave(
    design: PitchDesign, places: NDArray[np.float64], footprint: Footprint
) -> NDArray[np.float64]:
    """s(t), (places, spreads), t counted from the edge of the raster."""
    if not design.family.is_binary:
        phase = np.pi * (places - 0.5) / design.pitch_px
        return np.outer(cos(phase), _amplitudes(design, footprint, np.ones(1))[0])
    orders = np.arange(1, min(8 * design.pitch_px, _MOST_HARMONICS), 2).astype(np.float64)
    waves = sin(np.pi * np.outer(places, orders) / design.pitch_px)
    return product(waves, _amplitudes(design, footprint, orders))


@compiled
def bin_of(place, period):  # type: ignore[no-untyped-def]
    """Bin of a place within the period, and the part of the way to the next."""
    at = (place - np.floor(place / period) * period) * BINS_PER_PX
    # A place just below 0 is rounded to the end of the period; one that is not known has none.
    index = min(max(int(at), 0), int(period * BINS_PER_PX) - 1)
    return index, at - index
