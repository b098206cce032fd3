"""Depth edges in patterns and their complements: pixels whose differences two places explain.

One place explains badly what a pixel across a depth edge sees. Its second place is tried where
pixels two away see theirs, led on to the pixel by the next ones; a pixel may as well see the
surfaces on both sides of it and nothing of its own. Direct light of both places and light of some
ranges are fitted to the pixel's own differences, and the pair that explains most is believed where
it explains far more than one place does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.ranges.account_fit import held_weight
from processing.ranges.kernels import compiled
from processing.ranges.spectrum import solve_spectrum
from processing.ranges.two_positions.code_waves import CodeWaves
from processing.ranges.two_positions.fit import weigh_pitch

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Ranges beside direct light, in finest pitches of the accounts.
RANGES = (1.0, 4.0, 16.0)
# χ² a difference from which a second place is looked for; what two places must leave of it; from
# where one place is no account at all.
SUSPECT, _MOST_LEFT, _HOPELESS = 3.0, 0.4, 6.0
_AWAY_PX = 2
_AROUND = ((-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1))
# A step on the projector as long is a jump, in typical ones.
_JUMP = 3.0


@dataclass(frozen=True, slots=True)
class EdgePixels:
    """n pixels and all that is known of them.

    Parameters
    ----------
    relative
        float32, (pitches, n, colours): differences over white.
    gains
        float32, (pitches, n, colours), see `processing.ranges.two_positions.fit.PairFit`.
    variance
        float32, (n, colours), of the noise of a difference.
    pairs_px
        float32, (2, candidates, 2, n): y and x of both places; first comes the own place, twice.
    """

    relative: Single
    gains: Single
    variance: Single
    pairs_px: Single


@dataclass(frozen=True, slots=True)
class EdgesFitted:
    """Of n pixels.

    Parameters
    ----------
    direct
        float64, (n, colours): direct light of both places, in parts of white.
    believed
        bool, (n,): where two places explain far more than one.
    hopeless
        bool, (n,): where neither does.
    """

    direct: Array
    believed: NDArray[np.bool_]
    hopeless: NDArray[np.bool_]


def fit_edges(waves: CodeWaves, pixels: EdgePixels) -> EdgesFitted:
    """Try all pairs of places.

    Parameters
    ----------
    waves
        Of direct light and of light of some ranges.
    pixels
        What they see.
    """
    n_pitches, n_pixels, n_colours = pixels.relative.shape
    direct = np.zeros((n_pixels, n_colours))
    chi2 = np.zeros((2, n_pixels))
    _try_pairs(
        pixels.relative, pixels.gains, pixels.variance, pixels.pairs_px, waves.wave, waves.slope,
        waves.first, waves.pitch_px, waves.axis, direct, chi2,
    )  # fmt: skip
    alone, together = chi2
    believed = together < _MOST_LEFT * alone
    degrees = n_pitches * n_colours
    left = np.where(believed, together, alone)
    return EdgesFitted(direct, believed, left > _HOPELESS * degrees)


def candidate_pairs(places_px: Single, pixels: NDArray[np.int64], scale_px: float) -> Single:
    """Pairs of places that pixels may see, (2, candidates, 2, n).

    Parameters
    ----------
    places_px
        float32, (2, height, width), y and x; NaN where there is none.
    pixels
        (2, n): rows and columns.
    scale_px
        Usual distance on the projector between neighbouring pixels.
    """
    own = places_px[:, pixels[0], pixels[1]]
    around = [_led_on(places_px, pixels, own, away, scale_px) for away in _AROUND]
    pairs = [(own, own), *((own, one) for one in around)]
    pairs += [(around[k], around[k + 4]) for k in range(4)]
    stacked: Single = np.stack([np.stack(pair) for pair in pairs], axis=1)
    return np.ascontiguousarray(stacked)


def _led_on(
    places_px: Single,
    pixels: NDArray[np.int64],
    own: Single,
    away: tuple[int, int],
    scale_px: float,
) -> Single:
    """The place of the surface on one side, as it would continue to the pixel; own if unknown."""
    near, next_one = (_at(places_px, pixels, away, _AWAY_PX + k) for k in range(2))
    step = near - next_one
    even = np.abs(step).max(axis=0) < _JUMP * scale_px
    led = near + np.where(even, _AWAY_PX * step, 0)
    found: Single = np.where(np.isfinite(near).all(axis=0), led, own).astype(np.float32)
    return found


def _at(places_px: Single, pixels: NDArray[np.int64], away: tuple[int, int], steps: int) -> Single:
    height, width = places_px.shape[1:]
    row = np.clip(pixels[0] + steps * away[0], 0, height - 1)
    column = np.clip(pixels[1] + steps * away[1], 0, width - 1)
    return places_px[:, row, column]


@compiled
def _fill(  # type: ignore[no-untyped-def]
    relative, gain, variance, own, other, waves, slope, first, pitch_px, axis, rows, beside,
    weights, room,
):  # fmt: skip
    """Rows of one pixel and colour at its first place, and direct light's at the second."""
    column, weight, seen, value, usable = room
    usable[0] = True
    for k in range(pitch_px.size):
        value[0] = relative[k]
        for second in range(2):
            place = other[axis[k]] if second else own[axis[k]]
            weigh_pitch(
                value, np.full(1, place), np.full(1, gain[k]), usable, np.full(1, variance),
                waves, slope, first[k], pitch_px[k], column, weight, seen,
            )  # fmt: skip
            if second:
                beside[k] = column[0, 0]
            else:
                for a in range(len(column) - 1):
                    rows[k, a] = column[a, 0]
                weights[k] = weight[0]


@compiled
def _solve(rows, weights, seen, work):  # type: ignore[no-untyped-def]
    """Amounts ≥ 0 that add up to 1, and the χ² that they leave."""
    gram, moment, factor, members, passive, amounts, moved = work
    n_pitches, n = rows.shape
    held = held_weight(1.0)
    gram[:] = held
    moment[:] = held
    passive[:] = False
    for k in range(n_pitches):
        for a in range(n):
            lift = weights[k] * rows[k, a]
            moment[a] += lift * seen[k]
            for b in range(n):
                gram[a, b] += lift * rows[k, b]
    solve_spectrum(gram, moment, passive, amounts, factor, members, moved)
    chi2 = 0.0
    for k in range(n_pitches):
        off = seen[k]
        for a in range(n):
            off -= amounts[a] * rows[k, a]
        chi2 += weights[k] * off * off
    return chi2


@compiled
def _try_pairs(  # type: ignore[no-untyped-def]
    relative, gains, variance, pairs, waves, slope, first, pitch_px, axis, direct, chi2
):  # fmt: skip
    n_pitches, n_pixels, n_colours = relative.shape
    n_ranges = waves.shape[1]
    # Ranges of the first place, infinity, direct light of the second place.
    n = n_ranges + 2
    rows, beside, weights = np.zeros((n_pitches, n)), np.zeros(n_pitches), np.zeros(n_pitches)
    amounts = np.zeros(n)
    work = (
        np.zeros((n, n)), np.zeros(n), np.zeros((n, n)), np.zeros(n, np.int64),
        np.zeros(n, np.bool_), amounts, np.zeros(n),
    )  # fmt: skip
    room = (
        np.zeros((n_ranges + 1, 1), np.float32), np.zeros(1), np.zeros((4, 1)),
        np.zeros(1, np.float32), np.ones(1, np.bool_),
    )  # fmt: skip
    tried = np.zeros(n_colours)
    for i in range(n_pixels):
        for c in range(pairs.shape[1]):
            total = 0.0
            for colour in range(n_colours):
                seen = relative[:, i, colour]
                _fill(
                    seen, gains[:, i, colour], variance[i, colour], pairs[0, c, :, i],
                    pairs[1, c, :, i], waves, slope, first, pitch_px, axis, rows, beside, weights,
                    room,
                )  # fmt: skip
                # The first pair is one place.
                rows[:, n - 1] = beside * (c > 0)
                total += _solve(rows, weights, seen, work)
                tried[colour] = amounts[0] + amounts[n - 1] * (c > 0)
            if c == 0:
                chi2[0, i] = total
            elif c == 1 or total < chi2[1, i]:
                chi2[1, i] = total
                direct[i] = np.minimum(tried, 1.0)
