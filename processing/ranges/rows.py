"""How the light of each range shows in the correlation slope of a pitch, at known places.

With Z the harmonics of a pixel and Z_r those that light of spread r from its place would have,
the correlation slope of the frames with the decoded pattern, and the response of each spread, are

    D(P) = 2 Re⟨Z_0, Z⟩ / ⟨Z_0, Z_0⟩,    A_r(P) = Re⟨Z_0, Z_r⟩ / ⟨Z_0, Z_0⟩,

with ⟨·,·⟩ over Z⁺ and Z⁻ (`processing.ranges.slopes`).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from processing.ranges.slopes import bin_of

Single = NDArray[np.float32]

# Numbers that a vector of most processors holds; a multiple of 4.
_VECTOR = 8


def split_table(table: NDArray[np.complex128]) -> Single:
    """Real and imaginary parts, side by side."""
    return np.hstack([filled(part, 1) for part in (table.real, table.imag)])


def filled(values: NDArray[np.floating], axis: int) -> Single:
    """With zeros at the end of an axis, to a multiple of what a vector of the processor holds."""
    missing = [(0, 0)] * values.ndim
    missing[axis] = (0, -values.shape[axis] % _VECTOR)
    return np.pad(values.astype(np.float32), missing)


# Loops run over the last axis, without sums among it, so that they become vectors whose order of
# operations, and bits, are those of every processor.
compiled = njit(cache=True, nogil=True)


@compiled
def _between(table, index, part, value):  # type: ignore[no-untyped-def]
    """Linear between two bins."""
    low, high = table[index], table[index + 1]
    rest, share = np.float32(1 - part), np.float32(part)
    for r in range(value.size):
        value[r] = low[r] * rest + high[r] * share


@compiled
def _respond(down, right, both, apart, response):  # type: ignore[no-untyped-def]
    """Re of T_y (T_x a + T_x* b) for all spreads, of a + b and a − b."""
    n = response.size
    sum_re, sum_im = np.float32(both.real), np.float32(both.imag)
    off_re, off_im = np.float32(apart.real), np.float32(apart.imag)
    for r in range(n):
        re = right[r] * sum_re - right[n + r] * off_im
        im = right[r] * sum_im + right[n + r] * off_re
        response[r] = down[r] * re - down[n + r] * im


@compiled
def fill_row(  # type: ignore[no-untyped-def]
    seen, down, right, first, pitch, y, x, gain, at_y, at_x, response
):  # fmt: skip
    """D, ⟨Z_0, Z_0⟩ of one pitch and the part of Z⁺ in it; fills the responses of all spreads."""
    bin_y, part_y = bin_of(y, 2 * pitch)
    bin_x, part_x = bin_of(x, 2 * pitch)
    _between(down, first + bin_y, part_y, at_y)
    _between(right, first + bin_x, part_x, at_x)
    n = response.size
    one, other = complex(at_y[0], at_y[n]), complex(at_x[0], at_x[n])
    plus, minus = one * other * gain[0], one * np.conj(other) * gain[1]
    rising = plus.real**2 + plus.imag**2
    energy = max(rising + minus.real**2 + minus.imag**2, 1e-12)
    part = 1 / energy
    slope = 2 * part * ((seen[0] * np.conj(plus)).real + (seen[1] * np.conj(minus)).real)
    gained, lessened = np.conj(plus) * (gain[0] * part), np.conj(minus) * (gain[1] * part)
    _respond(at_y, at_x, gained + lessened, gained - lessened, response)
    response[0] = 1.0
    return slope, energy, rising * part


@compiled
def mix(response, mixtures, row):  # type: ignore[no-untyped-def]
    """Responses of the ranges from those of the spreads."""
    row[:] = 0
    for r in range(0, mixtures.shape[0], 4):
        one, two, three, four = mixtures[r], mixtures[r + 1], mixtures[r + 2], mixtures[r + 3]
        w, x, y, z = response[r], response[r + 1], response[r + 2], response[r + 3]
        for a in range(row.size):
            row[a] += (w * one[a] + x * two[a]) + (y * three[a] + z * four[a])


@compiled
def weigh(  # type: ignore[no-untyped-def]
    slope, energy, rising, rate2, white, variance, noise_gain, model, blur_deviations, spread, bends
):  # fmt: skip
    """Variances of a row, and how the blur's errors move it, into columns of both."""
    spread[0] = variance * noise_gain / energy
    spread[1] = (model * white) ** 2 + 1e-30
    lift = slope * rate2 / (spread[0] + spread[1])
    bends[0] = lift * blur_deviations[0]
    # Skew blurs one diagonal as much more as the other less.
    bends[1] = lift * blur_deviations[1] * (2 * rising - 1)
