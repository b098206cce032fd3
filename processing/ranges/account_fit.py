"""One account of the light of a pixel: its normal equations, their solution, and its errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.ranges.rows import compiled
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
def solve_account(  # type: ignore[no-untyped-def]
    account, rows, values, spread, bends, white, white_variance, subsurface, amounts, parts
):  # fmt: skip
    """Hold the total to white, solve, share out; χ² of the rows.

    `account` is a `workspace` with AᵀWA and AᵀWb of the first of `rows`, (ranges, pitches);
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


@compiled
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


@compiled
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


@compiled
def workspace(n_ranges, n_pitches):  # type: ignore[no-untyped-def]
    """What the fit of an account works on: AᵀWA, AᵀWb, which are positive, and scratch."""
    return (
        np.empty((n_ranges, n_ranges)), np.empty(n_ranges), np.zeros(n_ranges, np.bool_),
        np.empty((n_ranges, n_ranges)), np.empty(n_ranges, np.int64), np.empty(n_ranges),
        np.empty(n_ranges), np.empty(n_pitches),
    )  # fmt: skip


@compiled
def take(gram, moment, rows, members, account, mine):  # type: ignore[no-untyped-def]
    """The part of the normal equations that belongs to an account, and of their rows."""
    for a in range(len(members)):
        account[1][a] = moment[members[a]]
        for b in range(len(members)):
            account[0][a, b] = gram[members[a], members[b]]
        for k in range(len(rows)):
            mine[a, k] = rows[k, members[a]]
