"""Fit of the ranges of light to many pixels at once: correlation with the pattern, then spectrum.

With Z the harmonics of a pixel and Z_r those that light of spread r from its place would have,
the correlation slope of the frames with the decoded pattern, and the response of each spread, are

    D(P) = 2 Re⟨Z_0, Z⟩ / ⟨Z_0, Z_0⟩,    A_r(P) = Re⟨Z_0, Z_r⟩ / ⟨Z_0, Z_0⟩,

with ⟨·,·⟩ over Z⁺ and Z⁻ (`processing.slopes`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from processing.accounts import Account
from processing.response import ResponseTables
from processing.slopes import bin_of, model_errors
from processing.spectrum import solve_passive, solve_spectrum

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# The total is held to white this many times tighter than a row, then scaled to it exactly.
TOTAL_WEIGHT = 300.0
# Numbers that a vector of most processors holds; a multiple of 4.
_VECTOR = 8
# Pixels whose rows are made pitch by pitch: their tables, and the rows, fit the processor's caches.
_TOGETHER = 32


@dataclass(frozen=True, slots=True)
class AccountFit:
    """One account fitted to n pixels of one colour.

    Parameters
    ----------
    amounts
        float64, (n, ranges + 1), ≥ 0, adding up to white; the last has infinite range.
    direct_light, subsurface
        float64, (n,).
    noise_errors
        float64, (n, 3): standard errors of direct light, subsurface scattering and the rest that
        the noise of the frames makes, what it does to the measured blur among it.
    misfits
        float64, (n, 3): those that `model_errors` of the slopes would make, were they independent,
        larger where the fit is worse than they and the noise allow.
    chi2
        float64, (n,), of the rows.
    """

    amounts: Array
    direct_light: Array
    subsurface: Array
    noise_errors: Array
    misfits: Array
    chi2: Array


@dataclass(frozen=True, slots=True)
class PlaceFit:
    """Fit of two accounts to pixels of one colour whose places are known.

    Parameters
    ----------
    down, right
        float32, (bins, 2 · spreads): real parts, then imaginary parts, of those of
        `ResponseTables`, each filled up with 0 to whole vectors of the processor.
    first, pitch_px
        Of `ResponseTables`.
    mixtures
        float32, (spreads, ranges): all ranges of both accounts, infinity, which is 0, among them,
        filled up likewise.
    members
        Which of them are an account's, direct light first and infinity last.
    subsurface
        (2, 2): first and end of those of each account that are subsurface scattering.
    noise_gains, model
        (pitches,): `slope_noise_gain` and `model_errors`.
    """

    down: Single
    right: Single
    first: NDArray[np.int64]
    pitch_px: Array
    mixtures: Single
    members: tuple[NDArray[np.int64], NDArray[np.int64]]
    subsurface: NDArray[np.int64]
    noise_gains: Array
    model: Array

    @classmethod
    def of(
        cls, tables: ResponseTables, accounts: tuple[Account, Account], noise_gains: Array
    ) -> PlaceFit:
        """What is the same for all pixels of a colour."""
        columns, members = _united(accounts)
        return cls(
            _split(tables.down),
            _split(tables.right),
            tables.first,
            tables.pitch_px,
            _filled(_filled(columns, 0), 1),
            members,
            np.array([one.subsurface for one in accounts], np.int64),
            noise_gains,
            model_errors(tables.pitch_px, tables.blur_px2),
        )

    def fitted(
        self,
        harmonics: NDArray[np.complex64],
        places: Array,
        gains: Array,
        white: Array,
        variance: Array,
        blur_deviations: Array,
    ) -> tuple[AccountFit, AccountFit]:
        """Fit both accounts.

        Parameters
        ----------
        harmonics, places, gains
            As for `slopes`.
        white
            (n,).
        variance
            (n, 2), of the noise of a frame, and of white.
        blur_deviations
            (n, 2), `processing.blur.Blur.deviations`.
        """
        n_pixels = len(white)
        amounts = [np.zeros((n_pixels, len(one))) for one in self.members]
        parts, chi2 = np.zeros((2, n_pixels, 8)), np.zeros((2, n_pixels))
        # Every layout of the arguments would be compiled anew.
        _fit_places(
            np.ascontiguousarray(np.moveaxis(harmonics, -1, 0)), np.ascontiguousarray(places),
            self.down, self.right, self.first, self.pitch_px, np.ascontiguousarray(gains),
            self.mixtures, self.members[0], self.members[1], self.subsurface,
            np.ascontiguousarray(white), np.ascontiguousarray(variance), self.noise_gains,
            self.model, np.ascontiguousarray(blur_deviations), amounts[0], amounts[1], parts, chi2,
        )  # fmt: skip
        one, other = (_result(*fit) for fit in zip(amounts, parts, chi2, strict=True))
        return one, other


def _united(
    accounts: tuple[Account, Account],
) -> tuple[Array, tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """The ranges of both accounts without repetition, infinity last, and which are whose."""
    columns: list[Array] = []
    members = []
    for account in accounts:
        mine = []
        for column in account.mixtures.T:
            same = [k for k, known in enumerate(columns) if np.array_equal(known, column)]
            mine.append(same[0] if same else len(columns))
            columns += [] if same else [column]
        members.append(mine)
    columns.append(np.zeros_like(columns[0]))
    one, other = (np.array([*mine, len(columns) - 1], np.int64) for mine in members)
    return np.stack(columns, axis=1), (one, other)


def _split(table: NDArray[np.complex128]) -> Single:
    """Real and imaginary parts, side by side."""
    return np.hstack([_filled(part, 1) for part in (table.real, table.imag)])


def _filled(values: NDArray[np.floating], axis: int) -> Single:
    """With zeros at the end of an axis, to a multiple of what a vector of the processor holds."""
    missing = [(0, 0)] * values.ndim
    missing[axis] = (0, -values.shape[axis] % _VECTOR)
    return np.pad(values.astype(np.float32), missing)


def fit_rows(
    rows: Array,
    pitch_px: Array,
    responses: Array,
    account: Account,
    white: Array,
    variance: Array,
) -> AccountFit:
    """Fit an account to rows of direct light that were found without places.

    Parameters
    ----------
    rows
        (n, pitches), D.
    pitch_px
        (pitches,).
    responses
        (pitches, spreads), the same for every pixel.
    account
        The ranges.
    white
        (n,).
    variance
        (pitches,), of the noise of D; white is taken to have none.
    """
    n_ranges = account.mixtures.shape[1] + 1
    amounts, parts = np.zeros((len(rows), n_ranges)), np.zeros((len(rows), 8))
    chi2 = np.zeros(len(rows))
    design = np.column_stack([responses @ account.mixtures, np.zeros(len(pitch_px))])
    _fit_rows(
        np.ascontiguousarray(rows), design, np.array(account.subsurface, np.int64),
        np.ascontiguousarray(white), variance, model_errors(pitch_px), amounts, parts, chi2,
    )  # fmt: skip
    return _result(amounts, parts, chi2)


def _result(amounts: Array, parts: Array, chi2: Array) -> AccountFit:
    return AccountFit(amounts, parts[:, 0], parts[:, 1], parts[:, 2:5], parts[:, 5:], chi2)


# Loops run over the last axis, without sums among it, so that they become vectors whose order of
# operations, and bits, are those of every processor.
_compiled = njit(cache=True, nogil=True)


@_compiled
def _between(table, index, part, value):  # type: ignore[no-untyped-def]
    """Linear between two bins."""
    low, high = table[index], table[index + 1]
    rest, share = np.float32(1 - part), np.float32(part)
    for r in range(value.size):
        value[r] = low[r] * rest + high[r] * share


@_compiled
def _respond(down, right, both, apart, response):  # type: ignore[no-untyped-def]
    """Re of T_y (T_x a + T_x* b) for all spreads, of a + b and a − b."""
    n = response.size
    sum_re, sum_im = np.float32(both.real), np.float32(both.imag)
    off_re, off_im = np.float32(apart.real), np.float32(apart.imag)
    for r in range(n):
        re = right[r] * sum_re - right[n + r] * off_im
        im = right[r] * sum_im + right[n + r] * off_re
        response[r] = down[r] * re - down[n + r] * im


@_compiled
def _row(  # type: ignore[no-untyped-def]
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


@_compiled
def _mix(response, mixtures, row):  # type: ignore[no-untyped-def]
    """Responses of the ranges from those of the spreads."""
    row[:] = 0
    for r in range(0, mixtures.shape[0], 4):
        one, two, three, four = mixtures[r], mixtures[r + 1], mixtures[r + 2], mixtures[r + 3]
        w, x, y, z = response[r], response[r + 1], response[r + 2], response[r + 3]
        for a in range(row.size):
            row[a] += (w * one[a] + x * two[a]) + (y * three[a] + z * four[a])


@_compiled
def _add_row(gram, moment, row, value, weight):  # type: ignore[no-untyped-def]
    """Add a row to AᵀWA and AᵀWb."""
    for a in range(row.size):
        weighted = row[a] * weight
        moment[a] += weighted * value
        for b in range(row.size):
            gram[a, b] += weighted * row[b]


@_compiled
def _solve(  # type: ignore[no-untyped-def]
    account, rows, values, spread, bends, white, white_variance, subsurface, amounts, parts
):  # fmt: skip
    """Hold the total to white, solve, share out; χ² of the rows.

    `account` is a `_workspace` with AᵀWA and AᵀWb of the first of `rows`, (ranges, pitches);
    `spread` holds the variances of noise and model, (2, pitches), and `bends`, (2, pitches), how
    the blur's errors move W b.
    """
    gram, moment, passive, factor, members, chosen, moved, along = account
    n = len(moment)
    held = (TOTAL_WEIGHT / max(white, 1e-12)) ** 2
    for a in range(n):
        moment[a] += held * white
        for b in range(n):
            gram[a, b] += held
    count = solve_spectrum(gram, moment, passive, amounts, factor, members)
    chi2, inflation = _misfit(rows, values, spread, amounts, along)
    total = 0.0
    for a in range(n):
        total += amounts[a]
    scale = white / total if total > 0 else 0.0
    first, end = subsurface
    parts[1] = 0.0
    for a in range(n):
        amounts[a] *= scale
        if first <= a < end:
            parts[1] += amounts[a]
    parts[0] = amounts[0]
    for c in range(3):
        one, other = (0, 1) if c == 0 else ((first, end) if c == 1 else (end, n))
        chosen[:] = 0
        chosen[one:other] = 1
        # How the component moves with AᵀWb.
        solve_passive(factor, members, count, chosen, moved)
        if c == 0 and not passive[0]:
            # Held at 0, it has no variance of its own; that of direct light alone stands in.
            moved[0] = 1 / max(gram[0, 0], 1e-300)
        noise, model = _moved(rows, spread, bends, moved, along)
        total = 0.0
        for a in range(n):
            total += moved[a]
        parts[2 + c] = np.sqrt(noise + (held * total) ** 2 * white_variance)
        parts[5 + c] = np.sqrt(inflation * model)
    return chi2


@_compiled
def _misfit(rows, values, spread, amounts, left):  # type: ignore[no-untyped-def]
    """χ² of the rows, and how many times more than the degrees of freedom, at least once."""
    n_pitches = len(values)
    left[:] = values
    for a in range(len(amounts)):
        if amounts[a] != 0:
            for k in range(n_pitches):
                left[k] -= amounts[a] * rows[a, k]
    chi2 = 0.0
    for k in range(n_pitches):
        chi2 += left[k] ** 2 / (spread[0, k] + spread[1, k])
    return chi2, max(chi2 / max(n_pitches - 4, 1), 1.0)


@_compiled
def _moved(rows, spread, bends, moved, along):  # type: ignore[no-untyped-def]
    """Variance that noise (with the blur's) and model give to what moves so with AᵀWb."""
    n_pitches = len(along)
    along[:] = 0
    for a in range(len(moved)):
        if moved[a] != 0:
            for k in range(n_pitches):
                along[k] += moved[a] * rows[a, k]
    noise, model, side, skew = 0.0, 0.0, 0.0, 0.0
    for k in range(n_pitches):
        share = (along[k] / (spread[0, k] + spread[1, k])) ** 2
        noise += spread[0, k] * share
        model += spread[1, k] * share
        side += bends[0, k] * along[k]
        skew += bends[1, k] * along[k]
    return noise + side**2 + skew**2, model


@_compiled
def _workspace(n_ranges, n_pitches):  # type: ignore[no-untyped-def]
    """What the fit of an account works on: AᵀWA, AᵀWb, which are positive, and scratch."""
    return (
        np.empty((n_ranges, n_ranges)), np.empty(n_ranges), np.zeros(n_ranges, np.bool_),
        np.empty((n_ranges, n_ranges)), np.empty(n_ranges, np.int64), np.empty(n_ranges),
        np.empty(n_ranges), np.empty(n_pitches),
    )  # fmt: skip


@_compiled
def _take(gram, moment, rows, members, account, mine):  # type: ignore[no-untyped-def]
    """The part of the normal equations that belongs to an account, and of their rows."""
    for a in range(len(members)):
        account[1][a] = moment[members[a]]
        for b in range(len(members)):
            account[0][a, b] = gram[members[a], members[b]]
        for k in range(len(rows)):
            mine[a, k] = rows[k, members[a]]


@_compiled
def _weigh(  # type: ignore[no-untyped-def]
    slope, energy, rising, rate2, white, variance, noise_gain, model, blur_deviations, spread, bends
):  # fmt: skip
    """Variances of a row, and how the blur's errors move it, into columns of both."""
    spread[0] = variance * noise_gain / energy
    spread[1] = (model * white) ** 2 + 1e-30
    lift = slope * rate2 / (spread[0] + spread[1])
    bends[0] = lift * blur_deviations[0]
    # Skew blurs one diagonal as much more as the other less.
    bends[1] = lift * blur_deviations[1] * (2 * rising - 1)


@_compiled
def _fit_places(  # type: ignore[no-untyped-def]
    harmonics, places, down, right, first, pitch_px, gain, mixtures, members, others, subsurface,
    white, variance, noise_gains, model, blur_deviations, amounts, other_amounts, parts, chi2,
):  # fmt: skip
    n_pixels, n_pitches, _ = harmonics.shape
    width = mixtures.shape[1]
    at_y, at_x = np.empty(down.shape[1], np.float32), np.empty(down.shape[1], np.float32)
    response, row = np.empty(len(mixtures), np.float32), np.empty(width, np.float32)
    rows, values = np.empty((_TOGETHER, n_pitches, width)), np.empty((_TOGETHER, n_pitches))
    spread, bends = np.empty((_TOGETHER, 2, n_pitches)), np.empty((_TOGETHER, 2, n_pitches))
    gram, moment, mine = np.empty((width, width)), np.empty(width), np.empty((width, n_pitches))
    # First guesses are what the pixel before came to.
    one, other = _workspace(len(members), n_pitches), _workspace(len(others), n_pitches)
    for start in range(0, n_pixels, _TOGETHER):
        end = min(start + _TOGETHER, n_pixels)
        for k in range(n_pitches):
            for i in range(start, end):
                j = i - start
                slope, energy, rising = _row(
                    harmonics[i, k], down, right, first[k], pitch_px[k], places[0, i],
                    places[1, i], gain[i, k], at_y, at_x, response,
                )  # fmt: skip
                _mix(response, mixtures, row)
                rows[j, k] = row
                values[j, k] = slope
                _weigh(
                    slope, energy, rising, (np.pi / pitch_px[k]) ** 2, white[i], variance[i, 0],
                    noise_gains[k], model[k], blur_deviations[i], spread[j, :, k], bends[j, :, k],
                )  # fmt: skip
        for i in range(start, end):
            j = i - start
            gram[:] = 0
            moment[:] = 0
            for k in range(n_pitches):
                weight = 1 / (spread[j, 0, k] + spread[j, 1, k])
                _add_row(gram, moment, rows[j, k], values[j, k], weight)
            _take(gram, moment, rows[j], members, one, mine)
            chi2[0, i] = _solve(
                one, mine, values[j], spread[j], bends[j], white[i], variance[i, 1],
                subsurface[0], amounts[i], parts[0, i],
            )  # fmt: skip
            _take(gram, moment, rows[j], others, other, mine)
            chi2[1, i] = _solve(
                other, mine, values[j], spread[j], bends[j], white[i], variance[i, 1],
                subsurface[1], other_amounts[i], parts[1, i],
            )  # fmt: skip


@_compiled
def _fit_rows(  # type: ignore[no-untyped-def]
    values, design, subsurface, white, variance, model, amounts, parts, chi2
):  # fmt: skip
    n_pixels, n_pitches = values.shape
    n_ranges = design.shape[1]
    rows = design.T.copy()
    spread, bends = np.empty((2, n_pitches)), np.zeros((2, n_pitches))
    account = _workspace(n_ranges, n_pitches)
    gram, moment = account[0], account[1]
    for i in range(n_pixels):
        gram[:] = 0
        moment[:] = 0
        for k in range(n_pitches):
            spread[0, k] = variance[k]
            spread[1, k] = (model[k] * white[i]) ** 2 + 1e-30
            _add_row(gram, moment, design[k], values[i, k], 1 / (spread[0, k] + spread[1, k]))
        chi2[i] = _solve(
            account, rows, values[i], spread, bends, white[i], 0.0, subsurface, amounts[i],
            parts[i],
        )  # fmt: skip
