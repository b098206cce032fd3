"""One account of the light of a pixel: its normal equations, their solution, and its errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.ranges.kernels import compiled
from processing.ranges.spectrum import solve_passive, solve_spectrum

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

    @classmethod
    def of(cls, amounts: Array, parts: Array, chi2: Array) -> AccountFit:
        """What `solve_account` filled in."""
        return cls(amounts, parts[:, 0], parts[:, 1], parts[:, 2:5], parts[:, 5:], chi2)


@compiled
def add_row(gram, moment, row, value, weight):  # type: ignore[no-untyped-def]
    """Add a row to AᵀWA and AᵀWb."""
    for a in range(row.size):
        weighted = row[a] * weight
        moment[a] += weighted * value
        for b in range(row.size):
            gram[a, b] += weighted * row[b]


@compiled
def held_weight(white):  # type: ignore[no-untyped-def]
    """Of the row that holds the total to white."""
    return (TOTAL_WEIGHT / max(white, 1e-12)) ** 2


@compiled
def solve_account(  # type: ignore[no-untyped-def]
    account, power, rows, seen, roles, white, white_variance, amounts, parts
):  # fmt: skip
    """Hold the total to white, solve, share out, and say how far off; χ² of the rows.

    Parameters
    ----------
    account
        A `workspace` with AᵀWA and AᵀWb of the rows.
    power
        bᵀWb.
    rows
        (ranges, pitches), Aᵀ.
    seen
        (4, pitches): W² times the variance of noise, and of the model; how the blur's two errors
        move W b.
    roles
        (ranges,): 0 of direct light, 1 of subsurface scattering, 2 of the rest.
    amounts, parts
        (ranges,) and (8,), receive what `AccountFit` has.
    """
    gram, moment, passive, factor, members, _, moved, _ = account
    n, n_pitches = rows.shape
    held = held_weight(white)
    for a in range(n):
        moment[a] += held * white
        for b in range(n):
            gram[a, b] += held
    count = solve_spectrum(gram, moment, passive, amounts, factor, members, moved)
    chi2 = _misfit(gram, moment, power, held, white, members, count, amounts)
    inflation = max(chi2 / max(n_pitches - 4, 1), 1.0)
    total = 0.0
    for a in range(n):
        total += amounts[a]
    scale = white / total if total > 0 else 0.0
    parts[:2] = 0
    for a in range(n):
        amounts[a] *= scale
        if roles[a] < 2:
            parts[roles[a]] += amounts[a]
    for role in range(3):
        noise, model, total = _errors(rows, seen, roles, role, count, account)
        parts[2 + role] = np.sqrt(noise + (held * total) ** 2 * white_variance)
        parts[5 + role] = np.sqrt(inflation * model)
    return chi2


@compiled
def _misfit(  # type: ignore[no-untyped-def]
    gram, moment, power, held, white, members, count, amounts
):  # fmt: skip
    """χ² of the rows, bᵀWb − 2 xᵀAᵀWb + xᵀAᵀWAx, without the one that holds the total."""
    chi2 = power
    for c in range(count):
        a = members[c]
        fitted = -2 * (moment[a] - held * white)
        for d in range(count):
            b = members[d]
            fitted += (gram[a, b] - held) * amounts[b]
        chi2 += amounts[a] * fitted
    return max(chi2, 0.0)


@compiled
def _errors(rows, seen, roles, role, count, account):  # type: ignore[no-untyped-def]
    """Variances of a component from noise and model, and how it moves with the total."""
    gram, _, passive, factor, members, chosen, moved, alone = account
    any_of_it = False
    for a in range(len(roles)):
        chosen[a] = roles[a] == role
        any_of_it |= passive[a] and roles[a] == role
        if roles[a] == role:
            alone[0] = a
    if any_of_it:
        # How the component moves with AᵀWb.
        solve_passive(factor, members, count, chosen, moved)
        total = 0.0
        for c in range(count):
            total += moved[members[c]]
        noise, model = _moved(rows, seen, members, count, moved)
        return noise, model, total
    if role > 0:
        return 0.0, 0.0, 0.0
    # Direct light held at 0 has no variance of its own; that of direct light alone stands in.
    total = 1 / max(gram[alone[0], alone[0]], 1e-300)
    moved[alone[0]] = total
    noise, model = _moved(rows, seen, alone, 1, moved)
    return noise, model, total


@compiled
def _moved(rows, seen, members, count, moved):  # type: ignore[no-untyped-def]
    """Variance that noise (with the blur's) and model give to what moves so with AᵀWb."""
    noise, model, side, skew = 0.0, 0.0, 0.0, 0.0
    for k in range(rows.shape[1]):
        along = 0.0
        for c in range(count):
            along += moved[members[c]] * rows[members[c], k]
        noise += seen[0, k] * along * along
        model += seen[1, k] * along * along
        side += seen[2, k] * along
        skew += seen[3, k] * along
    return noise + side**2 + skew**2, model


@compiled
def workspace(n_ranges):  # type: ignore[no-untyped-def]
    """What the fit of an account works on: AᵀWA, AᵀWb, which are positive, and scratch."""
    return (
        np.empty((n_ranges, n_ranges)), np.empty(n_ranges), np.zeros(n_ranges, np.bool_),
        np.empty((n_ranges, n_ranges)), np.empty(n_ranges, np.int64), np.empty(n_ranges),
        np.empty(n_ranges), np.empty(1, np.int64),
    )  # fmt: skip


@compiled
def take(grams, span, pixel, account):  # type: ignore[no-untyped-def]
    """The part of the normal equations of one of many pixels that belongs to an account.

    Parameters
    ----------
    grams
        (ranges + 1, ranges + 1, pixels), where the first index is not the larger one: AᵀWA, in its
        last column AᵀWb.
    span
        First and end of the account's ranges.
    pixel
        Which one.
    account
        A `workspace`, receives them.
    """
    first = span[0]
    for a in range(len(account[1])):
        account[1][a] = grams[first + a, len(grams) - 1, pixel]
        for b in range(a, len(account[1])):
            account[0][a, b] = account[0][b, a] = grams[first + a, first + b, pixel]
