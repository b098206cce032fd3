"""The non-negative solver and the profile of diffusion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import nnls

from processing.ranges.accounts import Account, opaque, spread_grid, translucent
from processing.ranges.spectrum import RIDGE, diffusion_mixture, solve_passive, solve_spectrum

PITCH_PX = np.arange(8, 97, 4.0)
SPREAD_PX = spread_grid(PITCH_PX)
RATE = np.pi * np.sqrt(2) / PITCH_PX
RESPONSES = np.exp(-0.5 * RATE[:, np.newaxis] ** 2 * SPREAD_PX**2)


@pytest.mark.parametrize(
    "account", [opaque(PITCH_PX), translucent(PITCH_PX)], ids=["opaque", "translucent"]
)
def test_the_solver_reaches_the_minimum_that_scipy_reaches(account: Account) -> None:
    mixtures = account.mixtures
    rows = np.column_stack([RESPONSES @ mixtures, np.zeros(len(PITCH_PX))])
    rows = np.vstack([100 * rows, 300 * np.ones(rows.shape[1])])
    n = rows.shape[1]
    gram = rows.T @ rows
    rng = np.random.default_rng(0)
    for _ in range(200):
        light = rng.exponential(size=n) * (rng.random(n) < 0.5)
        measured = rows @ light / max(np.sum(light), 1e-9) + rng.normal(size=len(rows))
        guesses = [np.zeros(n, bool), np.less(rng.random(n), 0.5)]
        found = [_Solved.of(gram, rows.T @ measured, guess) for guess in guesses]
        _, norm = nnls(rows, measured)
        for one in found:
            assert one.amounts.min() >= 0
            assert np.sum((rows @ one.amounts - measured) ** 2) == pytest.approx(norm**2, abs=1e-4)
            np.testing.assert_array_equal(one.passive, one.amounts > 0)
            lifted = gram + RIDGE * np.trace(gram) / n * np.eye(n)
            right = np.asarray(rng.normal(size=n))
            moved = lifted[np.ix_(one.passive, one.passive)] @ one.of_passive(right)[one.passive]
            np.testing.assert_allclose(moved, right[one.passive], atol=1e-5)


def test_nothing_comes_of_nothing() -> None:
    found = _Solved.of(np.eye(4), -np.ones(4), np.ones(4, bool))
    assert not found.amounts.any()
    assert not found.passive.any()
    assert not found.of_passive(np.ones(4)).any()


@dataclass(frozen=True)
class _Solved:
    """What `solve_spectrum` leaves behind."""

    amounts: NDArray[np.float64]
    passive: NDArray[np.bool_]
    factor: NDArray[np.float64]
    members: NDArray[np.int64]
    count: int

    @classmethod
    def of(
        cls, gram: NDArray[np.float64], moment: NDArray[np.float64], guess: NDArray[np.bool_]
    ) -> _Solved:
        n = len(moment)
        amounts, factor = np.ones(n), np.ones((n, n))
        passive, members = guess.copy(), np.zeros(n, np.int64)
        count = solve_spectrum(gram, moment, passive, amounts, factor, members, np.ones(n))
        return cls(amounts, passive, factor, members, count)

    def of_passive(self, right: NDArray[np.float64]) -> NDArray[np.float64]:
        solution = np.ones(len(right))
        solve_passive(self.factor, self.members, self.count, right, solution)
        return solution


@pytest.mark.parametrize("range_px", [2.0, 5.0, 16.0, 40.0])
def test_diffusion_has_the_transform_of_its_profile(range_px: float) -> None:
    """1/√(1 + k²d²), the Hankel transform of e^{−r/d}/(2π d r)."""
    mixture = diffusion_mixture(SPREAD_PX, range_px)
    assert mixture.min() >= 0
    assert mixture.sum() == pytest.approx(1)
    expected = 1 / np.sqrt(1 + (RATE * range_px) ** 2)
    np.testing.assert_allclose(RESPONSES @ mixture, expected, atol=0.005)
