"""How the light of each range shows in the correlation slope of a pitch, at known places.

With Z the harmonics of a pixel and Z_r those that light of spread r from its place would have,
the correlation slope of the frames with the decoded pattern, and the response of each spread, are

    D(P) = 2 Re⟨Z_0, Z⟩ / ⟨Z_0, Z_0⟩,    A_r(P) = Re⟨Z_0, Z_r⟩ / ⟨Z_0, Z_0⟩,

with ⟨·,·⟩ over Z⁺ and Z⁻ (`processing.ranges.slopes`). Rows are made of one pitch and many pixels
at a time, which lie side by side: the processor works on several of them at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.ranges.kernels import compiled
from processing.ranges.response import bin_of

Single = NDArray[np.float32]

# Spreads that are mixed at a time; their number is filled up to a multiple.
_MIXED = 6


def split_table(table: NDArray[np.complex128]) -> Single:
    """Real and imaginary parts, side by side, the spreads filled up to whole mixtures."""
    return np.hstack([filled(part, 1) for part in (table.real, table.imag)])


def filled(values: NDArray[np.floating], axis: int) -> Single:
    """With zeros at the end of an axis, to a multiple of what `mix` takes at a time."""
    missing = [(0, 0)] * values.ndim
    missing[axis] = (0, -values.shape[axis] % _MIXED)
    return np.pad(values.astype(np.float32), missing)


@compiled
def row_room(n_spreads, together):  # type: ignore[no-untyped-def]
    """What rows of some pixels are made in: bins and parts of the way, tables, responses."""
    return (
        np.empty(together, np.int64), np.empty(together, np.float32),
        np.empty((together, 2 * n_spreads), np.float32),
        np.empty((2 * n_spreads, together), np.float32),
        np.empty((2 * n_spreads, together), np.float32),
        np.empty((4, together), np.float32), np.empty((n_spreads, together), np.float32),
    )  # fmt: skip


@compiled
def _look_up(table, first, period, places, bins, shares, values, turned):  # type: ignore[no-untyped-def]
    """T of all spreads at some places, (2 · spreads, pixels), linear between bins."""
    for j in range(places.size):
        index, share = bin_of(places[j], period)
        bins[j], shares[j] = first + index, np.float32(share)
    for j in range(places.size):
        low, high, value = table[bins[j]], table[bins[j] + 1], values[j]
        share = shares[j]
        rest = np.float32(1) - share
        for r in range(value.size):
            value[r] = low[r] * rest + high[r] * share
    for j in range(places.size):
        for r in range(len(turned)):
            turned[r, j] = values[j, r]


@compiled
def respond(  # type: ignore[no-untyped-def]
    plus, minus, down, right, first, pitch, y, x, rise, fall, room, measured
):  # fmt: skip
    """Responses of all spreads at one pitch, (spreads, pixels).

    Parameters
    ----------
    plus, minus
        (pixels,), Z.
    y, x
        (pixels,), where they are seen.
    rise, fall
        (pixels,), gains of both.
    room
        A `row_room`.
    measured
        float64, (3, pixels), receives D, ⟨Z_0, Z_0⟩ and the part of Z⁺ in it.
    """
    bins, shares, values, at_y, at_x, turns, responses = room
    _look_up(down, first, 2 * pitch, y, bins, shares, values, at_y)
    _look_up(right, first, 2 * pitch, x, bins, shares, values, at_x)
    n = len(responses)
    for j in range(measured.shape[1]):
        y_re, y_im, x_re, x_im = at_y[0, j], at_y[n, j], at_x[0, j], at_x[n, j]
        up, low = np.float32(rise[j]), np.float32(fall[j])
        plus_re, plus_im = (y_re * x_re - y_im * x_im) * up, (y_re * x_im + y_im * x_re) * up
        minus_re, minus_im = (y_re * x_re + y_im * x_im) * low, (y_im * x_re - y_re * x_im) * low
        rising = plus_re * plus_re + plus_im * plus_im
        energy = max(rising + minus_re * minus_re + minus_im * minus_im, np.float32(1e-12))
        part = np.float32(1) / energy
        seen = (
            plus[j].real * plus_re + plus[j].imag * plus_im
            + minus[j].real * minus_re + minus[j].imag * minus_im
        )  # fmt: skip
        measured[0, j], measured[1, j], measured[2, j] = 2 * part * seen, energy, rising * part
        up, low = up * part, low * part
        turns[0, j] = plus_re * up + minus_re * low
        turns[1, j] = -plus_im * up - minus_im * low
        turns[2, j] = plus_re * up - minus_re * low
        turns[3, j] = minus_im * low - plus_im * up
    # Re of T_y (T_x a + T_x* b), of a + b and a − b.
    for r in range(n):
        for j in range(measured.shape[1]):
            re = at_x[r, j] * turns[0, j] - at_x[n + r, j] * turns[3, j]
            im = at_x[r, j] * turns[1, j] + at_x[n + r, j] * turns[2, j]
            responses[r, j] = at_y[r, j] * re - at_y[n + r, j] * im
    responses[0] = 1.0


@compiled
def mix(responses, mixtures, k, rows):  # type: ignore[no-untyped-def]
    """Responses of the ranges, rows[:, k], from those of the spreads."""
    rows[:, k] = 0
    for a in range(mixtures.shape[1]):
        row = rows[a, k]
        for r in range(0, len(mixtures), _MIXED):
            p, q, s = mixtures[r, a], mixtures[r + 1, a], mixtures[r + 2, a]
            t, u, v = mixtures[r + 3, a], mixtures[r + 4, a], mixtures[r + 5, a]
            if not (p or q or s or t or u or v):
                continue
            one, two, three = responses[r], responses[r + 1], responses[r + 2]
            four, five, six = responses[r + 3], responses[r + 4], responses[r + 5]
            for j in range(row.size):
                row[j] += (
                    (p * one[j] + q * two[j])
                    + (s * three[j] + t * four[j])
                    + (u * five[j] + v * six[j])
                )


@compiled
def weigh(  # type: ignore[no-untyped-def]
    measured, rate2, white, variance, noise_gain, model, blur_deviations, k, weights, seen
):  # fmt: skip
    """W of one pitch and some pixels, and what `solve_account` wants to know of their rows.

    Parameters
    ----------
    measured
        (3, pixels), see `respond`.
    white, variance
        (pixels,) and (pixels, 2), of the noise of a frame first.
    blur_deviations
        (pixels, 2).
    weights, seen
        (pitches, pixels) and (4, pitches, pixels); written at k.
    """
    for j in range(measured.shape[1]):
        slope, energy, rising = measured[0, j], measured[1, j], measured[2, j]
        noise, left_out = variance[j, 0] * noise_gain / energy, (model * white[j]) ** 2 + 1e-30
        weight = 1 / (noise + left_out)
        lift = slope * rate2 * weight
        weights[k, j] = weight
        seen[0, k, j], seen[1, k, j] = noise * weight * weight, left_out * weight * weight
        seen[2, k, j] = lift * blur_deviations[j, 0]
        # Skew blurs one diagonal as much more as the other less.
        seen[3, k, j] = lift * blur_deviations[j, 1] * (2 * rising - 1)


@compiled
def multiply(rows, weights, weighted, gram):  # type: ignore[no-untyped-def]
    """AᵀWA of some pixels, (ranges, ranges, pixels), where the first index is not the larger.

    Parameters
    ----------
    rows, weights
        (ranges, pitches, pixels) and (pitches, pixels); 0 in pitches beyond the last, of which
        there are a multiple of four.
    weighted
        (pitches, pixels), to work on.
    """
    n_ranges, n_pitches, together = rows.shape
    for a in range(n_ranges):
        for k in range(n_pitches):
            for j in range(together):
                weighted[k, j] = weights[k, j] * rows[a, k, j]
        for b in range(a, n_ranges):
            total = gram[a, b]
            total[:] = 0
            for k in range(0, n_pitches, 4):
                w, x, y, z = weighted[k], weighted[k + 1], weighted[k + 2], weighted[k + 3]
                one, two = rows[b, k], rows[b, k + 1]
                three, four = rows[b, k + 2], rows[b, k + 3]
                for j in range(together):
                    total[j] += (w[j] * one[j] + x[j] * two[j]) + (y[j] * three[j] + z[j] * four[j])
