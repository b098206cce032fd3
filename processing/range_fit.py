"""Fit of the ranges of light to many pixels at once: correlation with the pattern, then spectrum.

With Z the harmonics of a pixel and Z_r those that light of spread r from its place would have,
the correlation slope of the frames with the decoded pattern, and the response of each spread, are

    D(P) = 2 Re⟨Z_0, Z⟩ / ⟨Z_0, Z_0⟩,    A_r(P) = Re⟨Z_0, Z_r⟩ / ⟨Z_0, Z_0⟩,

with ⟨·,·⟩ over Z⁺ and Z⁻ (`processing.slopes`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.accounts import Account
from processing.response import ResponseTables
from processing.slopes import between, bin_of, model_errors
from processing.spectrum import solve_spectrum

Array = NDArray[np.float64]

# The total is held to white this many times tighter than a row, then scaled to it exactly.
TOTAL_WEIGHT = 300.0


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


def fit_places(
    harmonics: NDArray[np.complex64],
    places: Array,
    tables: ResponseTables,
    gains: Array,
    accounts: tuple[Account, Account],
    white: Array,
    variance: Array,
    noise_gains: Array,
    blur_deviations: Array,
) -> tuple[AccountFit, AccountFit]:
    """Fit two accounts where the places are known.

    Parameters
    ----------
    harmonics, places, tables, gains
        As for `slopes`.
    accounts
        The ranges.
    white
        (n,).
    variance
        (n, 2), of the noise of a frame, and of white.
    noise_gains
        (pitches,), `slope_noise_gain`.
    blur_deviations
        (n, 2), `processing.blur.Blur.deviations`.
    """
    pixels = np.ascontiguousarray(np.moveaxis(harmonics, -1, 0))
    one, other = accounts
    # Every layout of the places would be compiled anew.
    fitted = _fit_places(
        pixels, np.ascontiguousarray(places), tables.down, tables.right, tables.first,
        tables.pitch_px, gains, one.mixtures, other.mixtures, one.subsurface,
        other.subsurface, white, variance, noise_gains,
        model_errors(tables.pitch_px, tables.blur_px2), blur_deviations,
    )  # fmt: skip
    return _result(fitted[:3]), _result(fitted[3:])


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
    return _result(
        _fit_rows(
            rows,
            responses @ account.mixtures,
            account.subsurface,
            white,
            variance,
            model_errors(pitch_px),
        )
    )


def _result(fitted: tuple[Array, Array, Array]) -> AccountFit:
    amounts, parts, chi2 = fitted
    return AccountFit(amounts, parts[:, 0], parts[:, 1], parts[:, 2:5], parts[:, 5:], chi2)


@njit(cache=True, fastmath=True)
def _row(seen, down, right, first, pitch, y, x, gain, response):  # type: ignore[no-untyped-def]
    """D, ⟨Z_0, Z_0⟩ of one pitch and the part of Z⁺ in it; fills the responses of all spreads."""
    bin_y, part_y = bin_of(y, 2 * pitch)
    bin_x, part_x = bin_of(x, 2 * pitch)
    bin_y, bin_x = bin_y + first, bin_x + first
    at_y, at_x = between(down, bin_y, part_y, 0), between(right, bin_x, part_x, 0)
    plus, minus = at_y * at_x * gain[0], at_y * np.conj(at_x) * gain[1]
    energy = max(np.abs(plus) ** 2 + np.abs(minus) ** 2, 1e-12)
    slope = 2 * ((seen[0] * np.conj(plus)).real + (seen[1] * np.conj(minus)).real) / energy
    # Re(T_y T_x Z⁺*) and Re(T_y T_x* Z⁻*) of each spread, both diagonals together.
    gained, lessened = np.conj(plus) * gain[0] / energy, np.conj(minus) * gain[1] / energy
    response[0] = 1.0
    for r in range(1, len(response)):
        at_y, at_x = between(down, bin_y, part_y, r), between(right, bin_x, part_x, r)
        response[r] = (at_y * (at_x * gained + np.conj(at_x) * lessened)).real
    return slope, energy, np.abs(plus) ** 2 / energy


@njit(cache=True, fastmath=True)
def _add_row(gram, noise_gram, moment, row, value, noise, model):  # type: ignore[no-untyped-def]
    """Add a row to AᵀWA, AᵀWNWA and AᵀWb, with N the noise's part of the variances 1/W."""
    weight = 1 / (noise + model)
    part = weight * noise
    for a in range(len(row)):
        weighted = row[a] * weight
        moment[a] += weighted * value
        for b in range(a + 1):
            product = weighted * row[b]
            gram[a, b] += product
            noise_gram[a, b] += part * product


@njit(cache=True)
def _mirror(matrix):  # type: ignore[no-untyped-def]
    """Fill the upper triangle from the lower one."""
    for a in range(len(matrix)):
        for b in range(a):
            matrix[b, a] = matrix[a, b]


@njit(cache=True)
def _solve(  # type: ignore[no-untyped-def]
    gram, noise_gram, moment, square, white, white_variance, bent, subsurface, degrees, amounts,
    parts,
):  # fmt: skip
    """Hold the total to white, solve, share out; χ² of the rows. `bent`: of AᵀWb by the blur."""
    n = len(moment)
    _mirror(gram)
    _mirror(noise_gram)
    weight = (TOTAL_WEIGHT / max(white, 1e-12)) ** 2
    held, pull = gram + weight, moment + weight * white
    inverse = np.zeros((n, n))
    solve_spectrum(held, pull, amounts, inverse)
    chi2 = square - 2 * np.dot(moment, amounts) + np.dot(amounts, gram @ amounts)
    total = amounts.sum()
    amounts *= white / total if total > 0 else 0.0
    first, end = subsurface
    parts[0] = amounts[0]
    parts[1] = amounts[first:end].sum()
    if inverse[0, 0] == 0:
        # Held at 0, it has no variance of its own; that of direct light alone stands in.
        inverse[0, 0] = 1 / max(held[0, 0], 1e-300)
    inflation = max(chi2 / degrees, 1.0)
    for k, (one, other) in enumerate(((0, 1), (first, end), (end, n))):
        # How the component moves with AᵀWb.
        response = np.zeros(n)
        for a in range(one, other):
            response += inverse[a]
        noise = np.dot(response, noise_gram @ response)
        model = np.dot(response, gram @ response) - noise
        noise += (weight * response.sum()) ** 2 * white_variance + np.sum((bent @ response) ** 2)
        parts[2 + k] = np.sqrt(max(noise, 0.0))
        parts[5 + k] = np.sqrt(inflation * max(model, 0.0))
    return chi2


@njit(parallel=True, cache=True)
def _fit_places(  # type: ignore[no-untyped-def]
    harmonics, places, down, right, first, pitch_px, gain, mixtures, others, subsurface,
    other_subsurface, white, variance, noise_gains, model, blur_deviations,
):  # fmt: skip
    n_pixels, n_pitches, _ = harmonics.shape
    n_spreads, n_ranges = mixtures.shape
    n_others = others.shape[1]
    amounts, other_amounts = np.zeros((n_pixels, n_ranges + 1)), np.zeros((n_pixels, n_others + 1))
    parts, other_parts = np.zeros((n_pixels, 8)), np.zeros((n_pixels, 8))
    chi2, other_chi2 = np.zeros(n_pixels), np.zeros(n_pixels)
    degrees = max(n_pitches - 4, 1)
    for i in prange(n_pixels):
        gram, moment = np.zeros((n_ranges + 1, n_ranges + 1)), np.zeros(n_ranges + 1)
        other_gram, other_moment = np.zeros((n_others + 1, n_others + 1)), np.zeros(n_others + 1)
        noise_gram, other_noise = np.zeros_like(gram), np.zeros_like(other_gram)
        bent, other_bent = np.zeros((2, n_ranges + 1)), np.zeros((2, n_others + 1))
        response = np.zeros(n_spreads)
        row, other_row = np.zeros(n_ranges + 1), np.zeros(n_others + 1)
        square = 0.0
        for k in range(n_pitches):
            slope, energy, rising = _row(
                harmonics[i, k], down, right, first[k], pitch_px[k],
                places[0, i], places[1, i], gain[i, k], response,
            )  # fmt: skip
            noise = variance[i, 0] * noise_gains[k] / energy
            off = (model[k] * white[i]) ** 2 + 1e-30
            square += slope * slope / (noise + off)
            _mix(response, mixtures, row)
            _add_row(gram, noise_gram, moment, row, slope, noise, off)
            _mix(response, others, other_row)
            _add_row(other_gram, other_noise, other_moment, other_row, slope, noise, off)
            lift = slope * (np.pi / pitch_px[k]) ** 2 / (noise + off)
            for d in range(2):
                # Skew blurs one diagonal as much more as the other less.
                shift = lift * blur_deviations[i, d] * (2 * rising - 1 if d else 1.0)
                bent[d] += shift * row
                other_bent[d] += shift * other_row
        chi2[i] = _solve(
            gram, noise_gram, moment, square, white[i], variance[i, 1], bent, subsurface,
            degrees, amounts[i], parts[i],
        )  # fmt: skip
        other_chi2[i] = _solve(
            other_gram, other_noise, other_moment, square, white[i], variance[i, 1],
            other_bent, other_subsurface, degrees, other_amounts[i], other_parts[i],
        )  # fmt: skip
    return amounts, parts, chi2, other_amounts, other_parts, other_chi2


@njit(cache=True, fastmath=True)
def _mix(response, mixtures, row):  # type: ignore[no-untyped-def]
    """Responses of the ranges from those of the spreads; the last of the row stays 0."""
    row[:] = 0
    for r in range(mixtures.shape[0]):
        for a in range(mixtures.shape[1]):
            row[a] += response[r] * mixtures[r, a]


@njit(parallel=True, cache=True)
def _fit_rows(rows, responses, subsurface, white, variance, model):  # type: ignore[no-untyped-def]
    n_pixels, n_pitches = rows.shape
    n_ranges = responses.shape[1]
    bent = np.zeros((2, n_ranges + 1))
    amounts = np.zeros((n_pixels, n_ranges + 1))
    parts, chi2 = np.zeros((n_pixels, 8)), np.zeros(n_pixels)
    for i in prange(n_pixels):
        gram, moment = np.zeros((n_ranges + 1, n_ranges + 1)), np.zeros(n_ranges + 1)
        noise_gram = np.zeros_like(gram)
        row = np.zeros(n_ranges + 1)
        square = 0.0
        for k in range(n_pitches):
            row[:n_ranges] = responses[k]
            off = (model[k] * white[i]) ** 2 + 1e-30
            _add_row(gram, noise_gram, moment, row, rows[i, k], variance[k], off)
            square += rows[i, k] ** 2 / (variance[k] + off)
        degrees = max(n_pitches - 4, 1)
        chi2[i] = _solve(
            gram, noise_gram, moment, square, white[i], 0.0, bent, subsurface, degrees,
            amounts[i], parts[i],
        )  # fmt: skip
    return amounts, parts, chi2
