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
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign
from processing.numerics.elementary import cos, sin, turn_each
from processing.ranges.kernels import compiled
from processing.ranges.response import ResponseTables, bin_of, carrier

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
    return _best_places(  # type: ignore[no-any-return]
        np.ascontiguousarray(harmonics), 1 / constants.astype(np.complex128), cos(angles),
        sin(angles), lattice, rates,
    )  # fmt: skip


def _fine(
    harmonics: NDArray[np.complexfloating],
    tables: ResponseTables,
    start: NDArray[np.float64],
    prior: float,
    steps: int,
) -> NDArray[np.float64]:
    """(2, n) places from the tables; `prior` holds the start, relative to the phases' weight."""
    down, right = (
        np.stack([table[:, 0].real, table[:, 0].imag, slope], axis=1).astype(np.float32)
        for table, slope in ((tables.down, tables.down_slope), (tables.right, tables.right_slope))
    )
    return _refine(  # type: ignore[no-any-return]
        np.ascontiguousarray(harmonics), down, right, tables.first, tables.pitch_px, start, prior,
        steps,
    )  # fmt: skip


@compiled
def _best_places(  # type: ignore[no-untyped-def]
    harmonics, factors, cosines, sines, lattice, rates
):  # fmt: skip
    """Where Σ Re(Z · factor · e^{i rate t})  is largest, pixel by pixel, and how near to Σ |Z|.

    Near the pixel before, where that agrees as well as that one did, else over the whole lattice.
    """
    n_rates, n_pixels = harmonics.shape
    places, coherence = np.zeros(n_pixels), np.zeros(n_pixels)
    real, imaginary, room = np.empty(n_rates), np.empty(n_rates), np.zeros((4, n_rates))
    scores = np.empty(len(lattice))
    for i in range(n_pixels):
        for k in range(n_rates):
            one, factor = harmonics[k, i], factors[k]
            real[k] = one.real * factor.real - one.imag * factor.imag
            imaginary[k] = -(one.real * factor.imag + one.imag * factor.real)
        for k in range(n_rates):
            size = np.sqrt(real[k] * real[k] + imaginary[k] * imaginary[k])
            room[0, k], room[1, k] = size, rates[k] * rates[k] * size
        size, curvature = _total(room[0]) + 1e-30, _total(room[1]) + 1e-30
        if i > 0:
            place, agreed = _climb(real, imaginary, rates, places[i - 1], curvature, room)
            places[i], coherence[i] = place, agreed / size
            if coherence[i] >= max(coherence[i - 1] - _MOST_FALL, _SURE):
                continue
        scores[:] = 0
        for k in range(n_rates):
            one, other = real[k], imaginary[k]
            for j in range(len(lattice)):
                scores[j] += one * cosines[k, j] + other * sines[k, j]
        best = lattice[np.argmax(scores)]
        place, agreed = _climb(real, imaginary, rates, best, curvature, room)
        places[i], coherence[i] = place, agreed / size
    return places, coherence


@compiled
def _climb(real, imaginary, rates, place, curvature, room):  # type: ignore[no-untyped-def]
    """Newton steps from a place; where they end, and the sum there."""
    angles, cosines, sines, terms = room[0], room[1], room[2], room[3]
    for steps in range(_NEWTON_STEPS + 1):
        for k in range(len(rates)):
            angles[k] = rates[k] * place
        turn_each(angles, cosines, sines)
        if steps == _NEWTON_STEPS:
            break
        for k in range(len(rates)):
            terms[k] = rates[k] * (imaginary[k] * cosines[k] - real[k] * sines[k])
        step = _total(terms) / curvature
        place += step
        if abs(step) < _ARRIVED_PX:
            # The sum is flat there: half a step's change of it is none.
            break
    for k in range(len(rates)):
        terms[k] = real[k] * cosines[k] + imaginary[k] * sines[k]
    return place, _total(terms)


@compiled
def _total(terms):  # type: ignore[no-untyped-def]
    """Their sum, in an order that does not wait for one addition to begin the next."""
    one, two, three, four = 0.0, 0.0, 0.0, 0.0
    whole = terms.size - terms.size % 4
    for k in range(0, whole, 4):
        one += terms[k]
        two += terms[k + 1]
        three += terms[k + 2]
        four += terms[k + 3]
    for k in range(whole, terms.size):
        one += terms[k]
    return (one + two) + (three + four)


@compiled
def _refine(  # type: ignore[no-untyped-def]
    harmonics, down, right, first, pitch_px, start, prior, steps
):  # fmt: skip
    """Gauss–Newton on weighted phases, with slopes of T taken over a pixel."""
    n_pitches, _, n_pixels = harmonics.shape
    places, seen = start.copy(), np.empty((4, n_pitches))
    tables, room = np.empty((6, n_pitches)), np.empty((5, n_pitches))
    rates2 = (np.pi / pitch_px) ** 2
    for i in range(n_pixels):
        for k in range(n_pitches):
            plus, minus = harmonics[k, 0, i], harmonics[k, 1, i]
            seen[0, k], seen[1, k] = plus.real, plus.imag
            seen[2, k], seen[3, k] = minus.real, minus.imag
        begin_y, begin_x = start[0, i], start[1, i]
        y, x = begin_y, begin_x
        for _ in range(steps):
            _look_up(down, first, pitch_px, y, tables[:3])
            _look_up(right, first, pitch_px, x, tables[3:])
            _pull(seen, tables, rates2, room)
            yy, yx, xx = _total(room[0]) + 1e-30, _total(room[1]), _total(room[2]) + 1e-30
            gy, gx = _total(room[3]), _total(room[4])
            hold = prior * (yy + xx)
            gy += hold * (begin_y - y)
            gx += hold * (begin_x - x)
            yy += hold
            xx += hold
            determinant = yy * xx - yx * yx
            if determinant > 1e-12 * (yy + xx) ** 2:
                step_y = (xx * gy - yx * gx) / determinant
                step_x = (yy * gx - yx * gy) / determinant
            else:
                step_y = gy / yy if yy > 1e-20 else 0.0
                step_x = gx / xx if xx > 1e-20 else 0.0
            y += min(max(step_y, -_LONGEST_STEP_PX), _LONGEST_STEP_PX)
            x += min(max(step_x, -_LONGEST_STEP_PX), _LONGEST_STEP_PX)
            if max(abs(step_y), abs(step_x)) < _ARRIVED_PX:
                break
        places[0, i], places[1, i] = y, x
    return places


@compiled
def _look_up(table, first, pitch_px, place, found):  # type: ignore[no-untyped-def]
    """Real and imaginary part of T and its slope at a place, (3, pitches), linear between bins."""
    for k in range(pitch_px.size):
        index, share = bin_of(place, 2 * pitch_px[k])
        low, high, rest = table[first[k] + index], table[first[k] + index + 1], 1 - share
        found[0, k] = low[0] * rest + high[0] * share
        found[1, k] = low[1] * rest + high[1] * share
        found[2, k] = low[2] * rest + high[2] * share


@compiled
def _pull(seen, tables, rates2, room):  # type: ignore[no-untyped-def]
    """What each pitch adds to the normal equations of a step: yy, yx, xx, and right sides."""
    for k in range(rates2.size):
        y_re, y_im, along_y = tables[0, k], tables[1, k], tables[2, k]
        x_re, x_im, along_x = tables[3, k], tables[4, k], tables[5, k]
        # Im is amplitude times sine of what is left of the phase, Re its curvature.
        re, im = y_re * x_re - y_im * x_im, y_re * x_im + y_im * x_re
        weight = rates2[k] * abs(seen[0, k] * re + seen[1, k] * im)
        pull = rates2[k] * (seen[1, k] * re - seen[0, k] * im)
        re, im = y_re * x_re + y_im * x_im, y_im * x_re - y_re * x_im
        weight_2 = rates2[k] * abs(seen[2, k] * re + seen[3, k] * im)
        pull_2 = rates2[k] * (seen[3, k] * re - seen[2, k] * im)
        room[0, k] = (weight + weight_2) * along_y * along_y
        room[1, k] = (weight - weight_2) * along_y * along_x
        room[2, k] = (weight + weight_2) * along_x * along_x
        room[3, k] = along_y * (pull + pull_2)
        room[4, k] = along_x * (pull - pull_2)
