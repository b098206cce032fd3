"""Fit of the ranges of light to many pixels at once, each at the place that it sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.ranges.account_fit import AccountFit, solve_account, take, workspace
from processing.ranges.accounts import Account
from processing.ranges.kernels import compiled
from processing.ranges.response import ResponseTables
from processing.ranges.rows import (
    Single,
    filled,
    mix,
    multiply,
    respond,
    row_room,
    split_table,
    weigh,
)
from processing.ranges.slopes import model_errors

Array = NDArray[np.float64]

# Pixels that are worked on side by side: what is kept of them fits the processor's caches.
_TOGETHER = 64


@dataclass(frozen=True, slots=True)
class PlaceFit:
    """Fit of two accounts to pixels of one colour whose places are known.

    Parameters
    ----------
    down, right
        float32, (bins, 2 · spreads): real parts, then imaginary parts, of those of
        `ResponseTables`, each filled up with 0 to whole mixtures.
    first, pitch_px
        Of `ResponseTables`.
    mixtures
        float32, (spreads, ranges): all ranges of both accounts, infinity, which is 0, among them;
        the spreads filled up likewise.
    spans
        (2, 2): first and end of those that are an account's.
    roles
        Of each account's: 0 of direct light, 1 of subsurface scattering, 2 of the rest.
    members
        Where they lie in their account, direct light first and infinity last.
    noise_gains, model
        (pitches,): `slope_noise_gain` and `model_errors`.
    """

    down: Single
    right: Single
    first: NDArray[np.int64]
    pitch_px: Array
    mixtures: Single
    spans: NDArray[np.int64]
    roles: tuple[NDArray[np.int64], NDArray[np.int64]]
    members: tuple[NDArray[np.int64], NDArray[np.int64]]
    noise_gains: Array
    model: Array

    @classmethod
    def of(
        cls, tables: ResponseTables, accounts: tuple[Account, Account], noise_gains: Array
    ) -> PlaceFit:
        """What is the same for all pixels of a colour."""
        columns, spans, members = united(accounts)
        one, other = (a.roles(m) for a, m in zip(accounts, members, strict=True))
        return cls(
            split_table(tables.down),
            split_table(tables.right),
            tables.first,
            tables.pitch_px,
            filled(columns, 0),
            spans,
            (one, other),
            members,
            noise_gains,
            model_errors(tables.pitch_px, tables.blur_error_px2),
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
            np.ascontiguousarray(harmonics), np.ascontiguousarray(places),
            self.down, self.right, self.first, self.pitch_px,
            np.ascontiguousarray(np.moveaxis(gains, 0, -1)),
            self.mixtures, self.spans, self.roles[0], self.roles[1],
            np.ascontiguousarray(white), np.ascontiguousarray(variance), self.noise_gains,
            self.model, np.ascontiguousarray(blur_deviations), amounts[0], amounts[1], parts, chi2,
        )  # fmt: skip
        one, other = (
            AccountFit.of(found[:, members], *fit)
            for found, members, *fit in zip(amounts, self.members, parts, chi2, strict=True)
        )
        return one, other


def united(
    accounts: tuple[Account, Account],
) -> tuple[Array, NDArray[np.int64], tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """The ranges of both accounts without repetition, in an order in which each has a span of them.

    Returns
    -------
    Mixtures, (spreads, ranges); first and end of each account's; where each account's own order,
    direct light first and infinity last, finds its ranges in its span.
    """
    one, other = ([*account.mixtures.T, np.zeros(len(account.mixtures))] for account in accounts)
    shared = [column for column in one if _index(column, other) is not None]
    first = [column for column in one if _index(column, other) is None]
    second = [column for column in other if _index(column, one) is None]
    spans = np.array([[0, len(one)], [len(first), len(first) + len(other)]])
    members = tuple(
        np.array([_index(column, span) for column in columns], np.int64)
        for columns, span in ((one, first + shared), (other, shared + second))
    )
    return np.stack(first + shared + second, axis=1), spans, (members[0], members[1])


def _index(column: Array, columns: list[Array]) -> int | None:
    """Which one it is."""
    return next((k for k, one in enumerate(columns) if np.array_equal(one, column)), None)


@compiled
def _fit_places(  # type: ignore[no-untyped-def]
    harmonics, places, down, right, first, pitch_px, gain, mixtures, spans, roles, other_roles,
    white, variance, noise_gains, model, blur_deviations, amounts, other_amounts, parts, chi2,
):  # fmt: skip
    n_pitches, _, n_pixels = harmonics.shape
    n_spreads, n_ranges = mixtures.shape
    together, whole = min(_TOGETHER, n_pixels), n_pitches + -n_pitches % 4
    room, measured = row_room(n_spreads, together), np.empty((3, together))
    # What was seen is one range more, which makes AᵀWb and bᵀWb parts of AᵀWA.
    rows = np.zeros((n_ranges + 1, whole, together), np.float32)
    weights, weighted = np.zeros((whole, together)), np.empty((whole, together))
    seen, grams = np.empty((4, n_pitches, together)), np.empty((n_ranges + 1, len(rows), together))
    # First guesses are what the pixel before came to.
    one, other = workspace(len(roles)), workspace(len(other_roles))
    for begin in range(0, n_pixels, _TOGETHER):
        # The last ones are worked on beside some of those before, again.
        start = min(begin, n_pixels - together)
        end = start + together
        for k in range(n_pitches):
            respond(
                harmonics[k, 0, start:end], harmonics[k, 1, start:end], down, right, first[k],
                pitch_px[k], places[0, start:end], places[1, start:end], gain[k, 0, start:end],
                gain[k, 1, start:end], room, measured,
            )  # fmt: skip
            mix(room[-1], mixtures, k, rows)
            for j in range(together):
                rows[n_ranges, k, j] = measured[0, j]
            weigh(
                measured, (np.pi / pitch_px[k]) ** 2, white[start:end], variance[start:end],
                noise_gains[k], model[k], blur_deviations[start:end], k, weights, seen,
            )  # fmt: skip
        multiply(rows, weights, weighted, grams)
        for i in range(begin, end):
            j = i - start
            power = grams[n_ranges, n_ranges, j]
            take(grams, spans[0], j, one)
            chi2[0, i] = solve_account(
                one, power, rows[spans[0, 0] : spans[0, 1], :n_pitches, j], seen[:, :, j], roles,
                white[i], variance[i, 1], amounts[i], parts[0, i],
            )  # fmt: skip
            take(grams, spans[1], j, other)
            chi2[1, i] = solve_account(
                other, power, rows[spans[1, 0] : spans[1, 1], :n_pitches, j], seen[:, :, j],
                other_roles, white[i], variance[i, 1], other_amounts[i], parts[1, i],
            )  # fmt: skip
