"""The non-negative solver and the profile of diffusion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from processing.accounts import Account, opaque, spread_grid, translucent
from processing.spectrum import RIDGE, diffusion_mixture, solve_spectrum

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
    rng = np.random.default_rng(0)
    for _ in range(200):
        light = rng.exponential(size=rows.shape[1]) * (rng.random(rows.shape[1]) < 0.5)
        measured = rows @ light / max(np.sum(light), 1e-9) + rng.normal(size=len(rows))
        amounts, inverse = np.zeros(rows.shape[1]), np.zeros((rows.shape[1],) * 2)
        solve_spectrum(rows.T @ rows, rows.T @ measured, amounts, inverse)
        _, norm = nnls(rows, measured)
        assert amounts.min() >= 0
        assert np.sum((rows @ amounts - measured) ** 2) == pytest.approx(norm**2, abs=1e-4)
        passive = amounts > 0
        gram = rows.T @ rows + RIDGE * np.trace(rows.T @ rows) / rows.shape[1] * np.eye(
            rows.shape[1]
        )
        product = inverse[np.ix_(passive, passive)] @ gram[np.ix_(passive, passive)]
        np.testing.assert_allclose(product, np.eye(len(product)), atol=1e-5)


def test_nothing_comes_of_nothing() -> None:
    amounts, inverse = np.ones(4), np.ones((4, 4))
    solve_spectrum(np.eye(4), -np.ones(4), amounts, inverse)
    assert not amounts.any()
    assert not inverse.any()


@pytest.mark.parametrize("range_px", [2.0, 5.0, 16.0, 40.0])
def test_diffusion_has_the_transform_of_its_profile(range_px: float) -> None:
    """1/√(1 + k²d²), the Hankel transform of e^{−r/d}/(2π d r)."""
    mixture = diffusion_mixture(SPREAD_PX, range_px)
    assert mixture.min() >= 0
    assert mixture.sum() == pytest.approx(1)
    expected = 1 / np.sqrt(1 + (RATE * range_px) ** 2)
    np.testing.assert_allclose(RESPONSES @ mixture, expected, atol=0.005)
