"""Fit of the ranges of light to direct images alone, of pixels whose places are not known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import product
from processing.ranges.account_fit import AccountFit, add_row, solve_account, workspace
from processing.ranges.accounts import Account
from processing.ranges.kernels import compiled

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RowErrors:
    """What rows of direct light are off by.

    Parameters
    ----------
    variance
        (pitches,), of the noise of D; white is taken to have none.
    bias
        (pitches, colours): standard deviation of what the noise adds to every pixel alike, in
        roots of white.
    model
        (pitches,): standard deviation of D/white that is laid to the model.
    """

    variance: Array
    bias: Array
    model: Array


def fit_rows(
    rows: Array,
    responses: Array,
    account: Account,
    white: Array,
    errors: RowErrors,
    colour: int,
) -> AccountFit:
    """Fit an account to rows of direct light that were found without places.

    Parameters
    ----------
    rows
        (n, pitches), D.
    responses
        (pitches, spreads), the same for every pixel.
    account
        The ranges.
    white
        (n,).
    errors
        Of the rows.
    colour
        Which one these are of.
    """
    n_ranges = account.mixtures.shape[1] + 1
    amounts, parts = np.zeros((len(rows), n_ranges)), np.zeros((len(rows), 8))
    chi2 = np.zeros(len(rows))
    design = np.column_stack([product(responses, account.mixtures), np.zeros(len(responses))])
    _fit_rows(
        np.ascontiguousarray(rows), design, account.roles(np.arange(n_ranges)),
        np.ascontiguousarray(white), errors.variance, errors.bias[:, colour].copy(), errors.model,
        amounts, parts, chi2,
    )  # fmt: skip
    return AccountFit.of(amounts, parts, chi2)


@compiled
def _fit_rows(  # type: ignore[no-untyped-def]
    values, design, roles, white, variance, bias, model, amounts, parts, chi2
):  # fmt: skip
    n_pixels, n_pitches = values.shape
    rows, n_ranges = design.T.copy(), design.shape[1]
    seen, account = np.zeros((4, n_pitches)), workspace(n_ranges)
    gram, moment = account[0], account[1]
    for i in range(n_pixels):
        gram[:] = 0
        moment[:] = 0
        power = 0.0
        for k in range(n_pitches):
            left_out = (model[k] * white[i]) ** 2 + 1e-30
            weight = 1 / (variance[k] + left_out)
            seen[0, k], seen[1, k] = variance[k] * weight**2, left_out * weight**2
            seen[2, k] = bias[k] * np.sqrt(white[i]) * weight
            add_row(gram, moment, design[k], values[i, k], weight)
            power += weight * values[i, k] ** 2
        chi2[i] = solve_account(
            account, power, rows, seen, roles, white[i], 0.0, amounts[i], parts[i]
        )
