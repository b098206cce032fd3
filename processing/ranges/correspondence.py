"""Which place on the projector's raster each camera pixel sees, decoded from the patterns.

The phase of Z⁺ and Z⁻ (`processing.frames.harmonics`) of every pitch P is π/P times y + x and y − x
(or y, x alone for patterns that vary along one direction), plus a constant. One pitch tells the
place modulo 2P; all together are unambiguous over any projector:

1. coarse: the t that maximises Σ_P Re(Z_P e^{−iπt/P}) on a lattice a quarter of the finest
   period wide, then Newton steps on that sum;
2. fine: least squares of the phases against those of `ResponseTables`, which know the
   harmonics that few shifts mix up. Phases are weighted by (π/P)² and amplitude: light that
   travelled bends the phases of wide pitches.

The colours of a mosaic see places half a camera pixel apart: the fine step is repeated for each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign
from processing.numerics.elementary import cos, cosine_after, sin
from processing.ranges.response import ResponseTables, carrier
from processing.ranges.slopes import bin_of

_NEWTON_STEPS = 4
_JOINT_STEPS = 4
_COLOUR_STEPS = 4
_LONGEST_STEP_PX = 1.0
# A step as short leaves the next one, by far shorter, nothing to do.
_ARRIVED_PX = 0.01
# A place is taken from the pixel before where its coherence is as good as there, or nearly.
_SURE, _MOST_FALL = 0.9, 0.02
# Holds a colour to the place of all, relative to its phases: for colours that are nearly black.
_COLOUR_PRIOR = 1e-3


@dataclass(frozen=True, slots=True)
class Correspondence:
    """Places that n camera pixels see.

    Parameters
    ----------
    place_px
        float64, (2, n, colours): y and x, counted from the upper and left edge of the
        projector's raster (the centre of its first pixel is at ½), of each colour; 0 along a
        direction in which no pattern varies.
    coherence
        float64, (n,): share of the harmonics' amplitude that agrees on one place, in [−1, 1].
        A pixel across a depth edge sees two places and stays below about 0.9.
    """

    place_px: NDArray[np.float64]
    coherence: NDArray[np.float64]


def decode(
    harmonics: NDArray[np.complex64],
    designs: Sequence[PitchDesign],
    tables: Sequence[ResponseTables],
    projector_px: tuple[int, int],
) -> Correspondence:
    """Decode n pixels.

    Parameters
    ----------
    harmonics
        complex, (pitches, 2, n, colours): Z⁺ and Z⁻, constant light subtracted.
    designs
        One for each pitch.
    tables
        One for each colour.
    projector_px
        (height, width) of the projector.
    """
    together = harmonics.sum(axis=-1)
    rough, coherence = _coarse(together, designs, projector_px)
    colours = harmonics.shape[-1]
    middle = tables[colours // 2]
    joint = _fine(together, middle, rough, 0.0, _JOINT_STEPS)
    places = np.empty((2, together.shape[-1], colours))
    for colour, table in enumerate(tables):
        one = np.ascontiguousarray(harmonics[..., colour])
        places[..., colour] = joint
        if colours > 1:
            places[..., colour] = _fine(one, table, joint, _COLOUR_PRIOR, _COLOUR_STEPS)
    return Correspondence(places, coherence)


def decode_residual(
    harmonics: NDArray[np.complex64],
    designs: Sequence[PitchDesign],
    tables: Sequence[ResponseTables],
    projector_px: tuple[int, int],
) -> NDArray[np.float64]:
    """Rough places of what is left of the light, (2, n, colours), fine pitches before coarse ones.

    Parameters as for `decode`; of what travelled far only coarse pitches know.
    """
    pitch_px = tables[0].pitch_px
    weights = (pitch_px.min() / pitch_px).astype(np.float32)
    together = harmonics.sum(axis=-1) * weights[:, np.newaxis, np.newaxis]
    rough, _ = _coarse(together, designs, projector_px)
    return np.repeat(rough[..., np.newaxis], harmonics.shape[-1], axis=-1)


def refined(
    harmonics: NDArray[np.complex64],
    tables: Sequence[ResponseTables],
    start: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Fine step alone, from given places, (2, n, colours), the same for all colours."""
    middle = tables[len(tables) // 2]
    place = _fine(harmonics.sum(axis=-1), middle, start.mean(axis=-1), 0.0, _JOINT_STEPS)
    return np.repeat(place[..., np.newaxis], harmonics.shape[-1], axis=-1)


def _coarse(
    harmonics: NDArray[np.complexfloating],
    designs: Sequence[PitchDesign],
    projector_px: tuple[int, int],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(2, n) places to a fraction of a pixel, and their coherence."""
    height, width = projector_px
    both = [
        k for k, one in enumerate(designs) if one.family.varies_down and one.family.varies_right
    ]
    down = [k for k, one in enumerate(designs) if not one.family.varies_right]
    right = [k for k, one in enumerate(designs) if not one.family.varies_down]
    n_pixels = harmonics.shape[-1]
    places = np.zeros((2, n_pixels))
    if both:
        chosen = [designs[k] for k in both]
        turned = np.array([carrier(one, down=True) * carrier(one, down=False) for one in chosen])
        total, first = _search(harmonics[both, 0], turned, chosen, (0, height + width))
        straight = np.ones(len(chosen))
        difference, second = _search(harmonics[both, 1], straight, chosen, (-width, height))
        places[0], places[1] = (total + difference) / 2, (total - difference) / 2
        return places, np.minimum(first, second)
    coherence = np.ones(n_pixels)
    for axis, members, extent in ((0, down, height), (1, right, width)):
        if members:
            chosen = [designs[k] for k in members]
            turned = np.array([carrier(one, down=axis == 0) for one in chosen])
            places[axis], agreed = _search(harmonics[members, 0], turned, chosen, (0, extent))
            coherence = np.minimum(coherence, agreed)
    return places, coherence


def _search(
    harmonics: NDArray[np.complexfloating],
    constants: NDArray[np.complexfloating] | NDArray[np.floating],
    designs: Sequence[PitchDesign],
    span_px: tuple[int, int],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Place along one direction, (n,), and coherence."""
    rates = np.pi / np.array([one.pitch_px for one in designs], np.float64)
    # Beyond the least common period of all patterns everything repeats.
    period_px = 2 * math.lcm(*(one.pitch_px for one in designs))
    end_px = min(span_px[1], span_px[0] + period_px)
    step_px = np.pi / rates.max() / 2
    lattice = np.arange(span_px[0], end_px + step_px, step_px)
    angles = np.outer(rates, lattice)
    phasors = np.conj(harmonics / constants[:, np.newaxis]).astype(np.complex128)
    return _best_places(  # type: ignore[no-any-return]
        np.ascontiguousarray(phasors.T), cos(angles), sin(angles), lattice, rates
    )


def _fine(
    harmonics: NDArray[np.complexfloating],
    tables: ResponseTables,
    start: NDArray[np.float64],
    prior: float,
    steps: int,
) -> NDArray[np.float64]:
    """(2, n) places from the tables; `prior` holds the start, relative to the phases' weight."""
    pixels = np.ascontiguousarray(np.moveaxis(harmonics, -1, 0)).astype(np.complex128)
    return _refine(  # type: ignore[no-any-return]
        pixels,
        np.ascontiguousarray(tables.down[:, 0]),
        np.ascontiguousarray(tables.right[:, 0]),
        tables.down_slope,
        tables.right_slope,
        tables.first,
        tables.pitch_px,
        start,
        prior,
        steps,
    )


@njit(cache=True, nogil=True)
def _best_places(phasors, cosines, sines, lattice, rates):  # type: ignore[no-untyped-def]
    """Where Σ Re(phasor · e^{−i rate t}) is largest, pixel by pixel, and how near it is to Σ |·|.

    Near the pixel before, where that agrees as well as that one did, else over the whole lattice.
    """
    n_pixels, n_rates = phasors.shape
    places, coherence = np.zeros(n_pixels), np.zeros(n_pixels)
    real, imaginary, scores = np.empty(n_rates), np.empty(n_rates), np.empty(len(lattice))
    for i in range(n_pixels):
        curvature, size = 1e-30, 1e-30
        for k in range(n_rates):
            real[k], imaginary[k] = phasors[i, k].real, phasors[i, k].imag
            one = np.sqrt(real[k] ** 2 + imaginary[k] ** 2)
            curvature += rates[k] ** 2 * one
            size += one
        if i > 0:
            place, agreed = _climb(real, imaginary, rates, places[i - 1], curvature)
            places[i], coherence[i] = place, agreed / size
            if coherence[i] >= max(coherence[i - 1] - _MOST_FALL, _SURE):
                continue
        scores[:] = 0
        for k in range(n_rates):
            for j in range(len(lattice)):
                scores[j] += real[k] * cosines[k, j] + imaginary[k] * sines[k, j]
        best = lattice[np.argmax(scores)]
        place, agreed = _climb(real, imaginary, rates, best, curvature)
        places[i], coherence[i] = place, agreed / size
    return places, coherence


@njit(cache=True, nogil=True)
def _climb(real, imaginary, rates, place, curvature):  # type: ignore[no-untyped-def]
    """Newton steps from a place; where they end, and the sum there."""
    for _ in range(_NEWTON_STEPS):
        slope = 0.0
        for k in range(len(rates)):
            angle = rates[k] * place
            cosine, sine = cosine_after(angle, 0), cosine_after(angle, 3)
            slope += rates[k] * (imaginary[k] * cosine - real[k] * sine)
        step = slope / curvature
        place += step
        if abs(step) < _ARRIVED_PX:
            break
    agreed = 0.0
    for k in range(len(rates)):
        angle = rates[k] * place
        agreed += real[k] * cosine_after(angle, 0) + imaginary[k] * cosine_after(angle, 3)
    return place, agreed


@njit(cache=True, nogil=True)
def _refine(  # type: ignore[no-untyped-def]
    harmonics, down, right, down_slope, right_slope, first, pitch_px, start, prior, steps
):
    """Gauss–Newton on weighted phases, with slopes of T taken over a pixel."""
    n_pixels, n_pitches, _ = harmonics.shape
    places = start.copy()
    for i in range(n_pixels):
        for _ in range(steps):
            yy, yx, xx, gy, gx = 1e-30, 0.0, 1e-30, 0.0, 0.0
            for k in range(n_pitches):
                period = 2 * pitch_px[k]
                y, x = places[0, i], places[1, i]
                bin_y, part_y = bin_of(y, period)
                bin_x, part_x = bin_of(x, period)
                bin_y, bin_x = first[k] + bin_y, first[k] + bin_x
                at_y = down[bin_y] * (1 - part_y) + down[bin_y + 1] * part_y
                at_x = right[bin_x] * (1 - part_x) + right[bin_x + 1] * part_x
                slope_y = down_slope[bin_y] * (1 - part_y) + down_slope[bin_y + 1] * part_y
                slope_x = right_slope[bin_x] * (1 - part_x) + right_slope[bin_x + 1] * part_x
                rate2 = (np.pi / pitch_px[k]) ** 2
                for sign in range(2):
                    expected = at_y * (at_x if sign == 0 else np.conj(at_x))
                    along_x = slope_x if sign == 0 else -slope_x
                    product = harmonics[i, k, sign] * np.conj(expected)
                    # Im is amplitude times sine of what is left of the phase, Re its curvature.
                    weight = rate2 * np.abs(product.real)
                    pull = rate2 * product.imag
                    yy += weight * slope_y * slope_y
                    yx += weight * slope_y * along_x
                    xx += weight * along_x * along_x
                    gy += slope_y * pull
                    gx += along_x * pull
            hold = prior * (yy + xx)
            gy += hold * (start[0, i] - places[0, i])
            gx += hold * (start[1, i] - places[1, i])
            yy += hold
            xx += hold
            determinant = yy * xx - yx * yx
            if determinant > 1e-12 * (yy + xx) ** 2:
                step_y = (xx * gy - yx * gx) / determinant
                step_x = (yy * gx - yx * gy) / determinant
            else:
                step_y = gy / yy if yy > 1e-20 else 0.0
                step_x = gx / xx if xx > 1e-20 else 0.0
            places[0, i] += min(max(step_y, -_LONGEST_STEP_PX), _LONGEST_STEP_PX)
            places[1, i] += min(max(step_x, -_LONGEST_STEP_PX), _LONGEST_STEP_PX)
            if max(abs(step_y), abs(step_x)) < _ARRIVED_PX:
                break
    return places
