"""Fit of the ranges of light to differences of patterns and complements, with their neighbours.

With r_k the difference of pitch k over white and s_kr(t) what light of range r adds to it at the
pixel's place (`processing.ranges.two_positions.code_waves`),

    r_k = Σ_r x_r s_kr(t_k),   x ≥ 0,   Σ_r x_r = 1.

One pixel sees one place of each stripe: in its middle coarse pitches tell little of how far light
travelled, at its edge nothing. Pixels side by side see other places. To the normal equations of
every pixel the mean of those of its neighbourhood is added: its light travels as theirs does, as
far as its own differences leave that open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import product
from processing.ranges.account_fit import AccountFit, solve_account, take, workspace
from processing.ranges.accounts import Account
from processing.ranges.kernels import compiled
from processing.ranges.pixels import united
from processing.ranges.response import bin_of
from processing.ranges.rows import Single, multiply
from processing.ranges.two_positions.code_waves import CodeWaves

Array = NDArray[np.float64]

# Neighbourhood on either side of a pixel, and the weight of its mean beside the pixel's own.
HALO = 2
_NEIGHBOURS = 1.0
# Standard deviation of a difference over white that is laid to the model, and of a place.
_MODEL_ERROR, _PLACE_ERROR_PX = 0.03, 0.1


@dataclass(frozen=True, slots=True)
class PairFit:
    """Fit of two accounts to pixels of one colour whose places are known.

    Parameters
    ----------
    waves
        float32, (bins, ranges): what light of each range of both accounts adds.
    slope, first, pitch_px, axis
        Of `CodeWaves`.
    spans, roles, members
        As in `processing.ranges.pixels.PlaceFit`.
    """

    waves: Single
    slope: Single
    first: NDArray[np.int64]
    pitch_px: Array
    axis: NDArray[np.int64]
    spans: NDArray[np.int64]
    roles: tuple[NDArray[np.int64], NDArray[np.int64]]
    members: tuple[NDArray[np.int64], NDArray[np.int64]]

    @classmethod
    def of(cls, waves: CodeWaves, accounts: tuple[Account, Account]) -> PairFit:
        """What is the same for all pixels of a colour; waves of all spreads of the accounts."""
        columns, spans, members = united(accounts)
        one, other = (a.roles(m) for a, m in zip(accounts, members, strict=True))
        return cls(
            product(waves.wave.astype(np.float64), columns).astype(np.float32),
            waves.slope,
            waves.first,
            waves.pitch_px,
            waves.axis,
            spans,
            (one, other),
            members,
        )

    def fitted(
        self,
        relative: Single,
        places_px: Single,
        gains: Single,
        mask: NDArray[np.bool_],
        variance: Single,
        inner: slice,
    ) -> PairsFitted:
        """Fit both accounts.

        Parameters
        ----------
        relative
            float32, (pitches, lines, columns): differences over white.
        places_px
            float32, (2, lines, columns).
        gains
            float32, (pitches, lines, columns): what the footprint leaves of each pitch beside
            the typical one.
        mask
            bool, (lines, columns).
        variance
            float32, (2, lines, columns): of the noise of a difference, and of white, both over
            white squared.
        inner
            Which lines are wanted; `HALO` more on either side help.
        """
        chosen = mask[inner]
        count = int(np.count_nonzero(chosen))
        amounts = [np.zeros((count, len(one))) for one in self.members]
        parts, chi2 = np.zeros((2, count, 8)), np.zeros((2, count))
        own = np.zeros(count)
        _fit_lines(
            relative, places_px, gains, mask, variance, self.waves, self.slope, self.first,
            self.pitch_px, self.axis, self.spans, self.roles[0], self.roles[1], inner.start,
            inner.stop, amounts[0], amounts[1], parts, chi2, own,
        )  # fmt: skip
        one, other = (
            AccountFit.of(found[:, members], *fit)
            for found, members, *fit in zip(amounts, self.members, parts, chi2, strict=True)
        )
        return PairsFitted((one, other), own)


@dataclass(frozen=True, slots=True)
class PairsFitted:
    """Both accounts, in parts of white, and χ² of the better one's own differences, (n,)."""

    accounts: tuple[AccountFit, AccountFit]
    own_chi2: Array


@compiled
def weigh_pitch(  # type: ignore[no-untyped-def]
    relative, place, gain, mask, variance, waves, slope, first, pitch, rows, weights, seen
):  # fmt: skip
    """Rows of one pitch and one line of pixels.

    Parameters
    ----------
    relative, place, gain, mask, variance
        (columns,).
    waves, slope
        Tables of this and the other pitches; `first` is where this one's begin.
    rows
        (ranges + 1, columns), receives responses, and last what was seen.
    weights, seen
        (columns,) and (4, columns), see `processing.ranges.rows.weigh`.
    """
    n_ranges = waves.shape[1]
    for j in range(place.size):
        if not mask[j]:
            weights[j] = 0
            rows[:, j] = 0
            seen[:, j] = 0
            continue
        index, part = bin_of(place[j], 2 * pitch)
        at, left = first + index, gain[j]
        one, other = left * (1 - part), left * part
        for a in range(n_ranges):
            rows[a, j] = waves[at, a] * one + waves[at + 1, a] * other
        rows[n_ranges, j] = relative[j]
        along = slope[at] * one + slope[at + 1] * other
        left_out = _MODEL_ERROR**2 + (_PLACE_ERROR_PX * along) ** 2
        weight = 1 / (variance[j] + left_out)
        weights[j] = weight
        seen[0, j], seen[1, j] = variance[j] * weight * weight, left_out * weight * weight
        seen[2, j] = seen[3, j] = 0


@compiled
def _box(grams, y, x, mask, found):  # type: ignore[no-untyped-def]
    """Mean of the normal equations around a pixel, over its usable neighbours."""
    n = grams.shape[1]
    found[:] = 0
    count = 0
    for row in range(max(y - HALO, 0), min(y + HALO + 1, len(grams))):
        for column in range(max(x - HALO, 0), min(x + HALO + 1, mask.shape[1])):
            if mask[row, column]:
                count += 1
                for a in range(n):
                    for b in range(a, n):
                        found[a, b] += grams[row, a, b, column]
    share = 1 / max(count, 1)
    for a in range(n):
        for b in range(a, n):
            found[a, b] *= share


@compiled
def _own_misfit(grams, y, x, first, amounts):  # type: ignore[no-untyped-def]
    """χ² of a pixel's own rows, bᵀWb − 2 xᵀAᵀWb + xᵀAᵀWAx."""
    last = grams.shape[1] - 1
    chi2 = grams[y, last, last, x]
    for a in range(amounts.size):
        chi2 -= 2 * amounts[a] * grams[y, first + a, last, x]
        chi2 += amounts[a] ** 2 * grams[y, first + a, first + a, x]
        for b in range(a + 1, amounts.size):
            chi2 += 2 * amounts[a] * amounts[b] * grams[y, first + a, first + b, x]
    return max(chi2, 0.0)


@compiled
def _gather(  # type: ignore[no-untyped-def]
    relative, places, gains, mask, variance, waves, slope, first, pitch_px, axis, rows, seen, grams
):  # fmt: skip
    """Rows and normal equations of all pixels."""
    n_pitches, n_lines, width = relative.shape
    whole = rows.shape[2]
    weights, weighted = np.zeros((whole, width)), np.empty((whole, width))
    for y in range(n_lines):
        for k in range(n_pitches):
            weigh_pitch(
                relative[k, y], places[axis[k], y], gains[k, y], mask[y], variance[0, y], waves,
                slope, first[k], pitch_px[k], rows[y, :, k], weights[k], seen[y, k],
            )  # fmt: skip
        multiply(rows[y], weights, weighted, grams[y])


@compiled
def _combine(grams, y, x, both):  # type: ignore[no-untyped-def]
    """A pixel's own normal equations and what its neighbourhood adds to them."""
    n = grams.shape[1]
    for a in range(n):
        for b in range(a, n):
            both[a, b, 0] = grams[y, a, b, x] + _NEIGHBOURS * both[a, b, 0]


@compiled
def _fit_lines(  # type: ignore[no-untyped-def]
    relative, places, gains, mask, variance, waves, slope, first, pitch_px, axis, spans, roles,
    other_roles, begin, end, amounts, other_amounts, parts, chi2, own,
):  # fmt: skip
    n_pitches, n_lines, width = relative.shape
    n = waves.shape[1]
    rows = np.zeros((n_lines, n + 1, n_pitches + -n_pitches % 4, width), np.float32)
    seen = np.empty((n_lines, n_pitches, 4, width))
    grams = np.zeros((n_lines, n + 1, n + 1, width))
    _gather(relative, places, gains, mask, variance, waves, slope, first, pitch_px, axis, rows,
            seen, grams)  # fmt: skip
    one, other = workspace(len(roles)), workspace(len(other_roles))
    both = np.zeros((n + 1, n + 1, 1))
    i = 0
    for y in range(begin, end):
        for x in range(width):
            if not mask[y, x]:
                continue
            _box(grams, y, x, mask, both[:, :, 0])
            _combine(grams, y, x, both)
            mine = np.ascontiguousarray(rows[y, :n, :n_pitches, x])
            about = np.ascontiguousarray(seen[y, :, :, x].T)
            take(both, spans[0], 0, one)
            chi2[0, i] = solve_account(
                one, both[n, n, 0], mine[spans[0, 0] : spans[0, 1]], about, roles, 1.0,
                variance[1, y, x], amounts[i], parts[0, i],
            )  # fmt: skip
            take(both, spans[1], 0, other)
            chi2[1, i] = solve_account(
                other, both[n, n, 0], mine[spans[1, 0] : spans[1, 1]], about, other_roles, 1.0,
                variance[1, y, x], other_amounts[i], parts[1, i],
            )  # fmt: skip
            own[i] = min(
                _own_misfit(grams, y, x, spans[0, 0], amounts[i]),
                _own_misfit(grams, y, x, spans[1, 0], other_amounts[i]),
            )
            i += 1
