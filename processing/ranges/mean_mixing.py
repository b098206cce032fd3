"""Mean response of each kind of light against pitch, and how sure that mean is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.jackknife import half_width
from processing.numerics.linear_algebra import product
from processing.ranges.account_fit import AccountFit
from processing.ranges.accounts import Account

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MeanMixing:
    """α of direct, near and far light, (colours, m + 1, 3) each; the last row, white, is 1.

    Parameters
    ----------
    alpha
        Response of the mean spectrum of ranges, 1 where a kind of light does not occur.
    half_width
        Half of its 95 % confidence interval; 0 where α is 1 by definition, NaN where too little of
        the picture holds the light.
    """

    alpha: Array
    half_width: Array


def mean_mixing(
    responses: Sequence[Array],
    accounts: tuple[Account, Account],
    fits: Sequence[tuple[AccountFit, AccountFit]],
    found: NDArray[np.bool_],
    tile: NDArray[np.int64],
) -> MeanMixing:
    """Mean over pixels, and over those outside of each tile.

    Parameters
    ----------
    responses
        (m, spreads) for each colour.
    accounts
        Opaque and translucent.
    fits
        Of n pixels by both, for each colour.
    found
        bool, (n,): where the translucent account holds.
    tile
        int, (n,): which part of the picture each lies in.
    """
    parts = int(tile.max(initial=0)) + 1
    alpha = np.ones((len(fits), len(responses[0]) + 1, 3))
    widths = np.zeros_like(alpha)
    for colour, (pair, response) in enumerate(zip(fits, responses, strict=True)):
        spectra = np.zeros((2, parts, response.shape[1]))
        totals = np.zeros((2, parts))
        for account, fit, chosen in zip(accounts, pair, (~found, found), strict=True):
            amounts = np.zeros((parts, fit.amounts.shape[1]))
            np.add.at(amounts, tile[chosen], fit.amounts[chosen])
            first, end = account.subsurface
            spectra[0] += product(amounts[:, first:end], account.mixtures[:, first:end].T)
            spectra[1] += product(amounts[:, end:-1], account.mixtures[:, end:].T)
            totals[0] += amounts[:, first:end].sum(axis=1)
            totals[1] += amounts[:, end:].sum(axis=1)
        for k in np.flatnonzero(totals.sum(axis=1) > 0):
            mean = _ratio(spectra[k], totals[k], response)
            alpha[colour, :-1, 1 + k], widths[colour, :-1, 1 + k] = mean
    return MeanMixing(alpha, widths)


def _ratio(spectra: Array, totals: Array, response: Array) -> tuple[Array, Array]:
    """Response of the mean of (parts, spreads) with the light (parts,), and its half interval."""
    held = totals > 0
    whole, light = spectra.sum(axis=0), float(totals.sum())
    alpha: Array = product(response, whole) / light
    if np.count_nonzero(held) < 2:
        return alpha, np.full_like(alpha, np.nan)
    rest = light - totals[held]
    without = product(whole - spectra[held], response.T) / rest[:, np.newaxis]
    return alpha, half_width(without, totals[held])
