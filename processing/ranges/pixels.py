"""Fit of the ranges of light to many pixels at once, each at the place that it sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import product
from processing.ranges.account_fit import AccountFit, add_row, solve_account, take, workspace
from processing.ranges.accounts import Account
from processing.ranges.response import ResponseTables
from processing.ranges.rows import Single, compiled, fill_row, filled, mix, split_table, weigh
from processing.ranges.slopes import model_errors

Array = NDArray[np.float64]

# Pixels whose rows are made pitch by pitch: their tables, and the rows, fit the processor's caches.
_TOGETHER = 32


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
            split_table(tables.down),
            split_table(tables.right),
            tables.first,
            tables.pitch_px,
            filled(filled(columns, 0), 1),
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
            (n, 2), `processing.ranges.blur.Blur.deviations`.
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
        one, other = (AccountFit.of(*fit) for fit in zip(amounts, parts, chi2, strict=True))
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
    design = np.column_stack([product(responses, account.mixtures), np.zeros(len(pitch_px))])
    _fit_rows(
        np.ascontiguousarray(rows), design, np.array(account.subsurface, np.int64),
        np.ascontiguousarray(white), variance, model_errors(pitch_px), amounts, parts, chi2,
    )  # fmt: skip
    return AccountFit.of(amounts, parts, chi2)


@compiled
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
    one, other = workspace(len(members), n_pitches), workspace(len(others), n_pitches)
    for start in range(0, n_pixels, _TOGETHER):
        end = min(start + _TOGETHER, n_pixels)
        for k in range(n_pitches):
            for i in range(start, end):
                j = i - start
                slope, energy, rising = fill_row(
                    harmonics[i, k], down, right, first[k], pitch_px[k], places[0, i],
                    places[1, i], gain[i, k], at_y, at_x, response,
                )  # fmt: skip
                mix(response, mixtures, row)
                rows[j, k] = row
                values[j, k] = slope
                weigh(
                    slope, energy, rising, (np.pi / pitch_px[k]) ** 2, white[i], variance[i, 0],
                    noise_gains[k], model[k], blur_deviations[i], spread[j, :, k], bends[j, :, k],
                )  # fmt: skip
        for i in range(start, end):
            j = i - start
            gram[:] = 0
            moment[:] = 0
            for k in range(n_pitches):
                weight = 1 / (spread[j, 0, k] + spread[j, 1, k])
                add_row(gram, moment, rows[j, k], values[j, k], weight)
            take(gram, moment, rows[j], members, one, mine)
            chi2[0, i] = solve_account(
                one, mine, values[j], spread[j], bends[j], white[i], variance[i, 1],
                subsurface[0], amounts[i], parts[0, i],
            )  # fmt: skip
            take(gram, moment, rows[j], others, other, mine)
            chi2[1, i] = solve_account(
                other, mine, values[j], spread[j], bends[j], white[i], variance[i, 1],
                subsurface[1], other_amounts[i], parts[1, i],
            )  # fmt: skip


@compiled
def _fit_rows(  # type: ignore[no-untyped-def]
    values, design, subsurface, white, variance, model, amounts, parts, chi2
):  # fmt: skip
    n_pixels, n_pitches = values.shape
    n_ranges = design.shape[1]
    rows = design.T.copy()
    spread, bends = np.empty((2, n_pitches)), np.zeros((2, n_pitches))
    account = workspace(n_ranges, n_pitches)
    gram, moment = account[0], account[1]
    for i in range(n_pixels):
        gram[:] = 0
        moment[:] = 0
        for k in range(n_pitches):
            spread[0, k] = variance[k]
            spread[1, k] = (model[k] * white[i]) ** 2 + 1e-30
            add_row(gram, moment, design[k], values[i, k], 1 / (spread[0, k] + spread[1, k]))
        chi2[i] = solve_account(
            account, rows, values[i], spread, bends, white[i], 0.0, subsurface, amounts[i],
            parts[i],
        )  # fmt: skip
