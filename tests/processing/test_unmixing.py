"""Sign, scale, order and names follow from α, whatever the blind result looked like."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.independence.unmixing import component_names, resolve

PITCH_PX = np.arange(8, 100, 4.0)
FLAT = np.ones(23)
BLURRED = 1 - 0.4 * np.exp(-PITCH_PX / 10)
NEAR = 1 - np.exp(-((PITCH_PX / 18) ** 1.5))
FAR = 0.02 + 0.3 * (PITCH_PX / 96) ** 2
STEEP = 6 * FAR


def rows_by_components(*alpha: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.vstack([np.column_stack(alpha), np.ones(len(alpha))])


def blind(
    mixing: NDArray[np.float64], seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """An unmixing with random order, and sign and scale per colour; and principal directions."""
    rng = np.random.default_rng(seed)
    n = mixing.shape[1]
    vectors, inside = np.linalg.qr(mixing)
    order = rng.permutation(n)
    factors = rng.choice([-1, 1], (3, n, 1)) * rng.uniform(0.01, 100, (3, n, 1))
    return factors * np.linalg.inv(inside)[order], vectors


@pytest.mark.parametrize("seed", range(6))
def test_sign_scale_and_order_come_back(seed: int) -> None:
    mixing = rows_by_components(FLAT, NEAR, FAR)
    unmixing, vectors = blind(mixing, seed)
    found = resolve(unmixing, vectors, PITCH_PX, np.ones((3, 3)) @ np.linalg.qr(mixing)[1].T)
    np.testing.assert_allclose(found.mixing, np.tile(mixing, (3, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(vectors @ np.linalg.inv(found.matrix), found.mixing, atol=1e-9)
    assert found.names == ("direct", "subsurface", "interreflection")
    assert found.warnings == ()


@pytest.mark.parametrize(
    ("alpha", "names"),
    [
        pytest.param((FLAT, FAR), ("direct", "interreflection"), id="direct-far"),
        pytest.param((FLAT, NEAR), ("direct", "subsurface"), id="direct-near"),
        pytest.param(
            (BLURRED, NEAR, FAR), ("direct", "subsurface", "interreflection"), id="blurred"
        ),
        pytest.param((FLAT, FAR, FAR / 2), ("direct", "component-2", "component-3"), id="two-far"),
        pytest.param((FLAT, 0.9 * FLAT), ("component-1", "component-2"), id="two-flat"),
        pytest.param((FLAT, FAR - 1), ("component-1", "component-2"), id="negative-light"),
        pytest.param((FLAT, FAR, STEEP), ("component-1", "component-2", "component-3"), id="steep"),
        pytest.param((NEAR, FAR), ("component-1", "component-2"), id="no-direct"),
    ],
)
def test_names_are_given_only_where_curves_tell(
    alpha: tuple[NDArray[np.float64], ...], names: tuple[str, ...]
) -> None:
    assert component_names(np.column_stack(alpha), PITCH_PX) == names


def test_too_few_pitches_name_direct_light_alone() -> None:
    alpha = np.array([[1.0, 0.1], [1.0, 0.2]])
    assert component_names(alpha, np.array([8.0, 16.0])) == ("direct", "component-2")


def test_what_white_does_not_hold_is_warned_of() -> None:
    mixing = rows_by_components(FLAT, NEAR, FAR)
    mixing[-1, 2] = 1e-3
    unmixing, vectors = blind(mixing, 0)
    means = np.ones((3, 3)) @ np.linalg.qr(mixing)[1].T
    found = resolve(unmixing, vectors, PITCH_PX, means)
    assert any("nearly absent from the white image" in one.what for one in found.warnings)
    mixing[-1, 2] = 0
    unmixing, vectors = blind(mixing, 0)
    assert np.all(np.isfinite(resolve(unmixing, vectors, PITCH_PX, means).matrix))


def test_negative_light_is_warned_of() -> None:
    mixing = rows_by_components(FLAT, NEAR, FAR)
    unmixing, vectors = blind(mixing, 1)
    means = np.tile([1.0, 1.0, 1.0], (3, 1))
    means[1, 2] = -1
    found = resolve(unmixing, vectors, PITCH_PX, means @ np.linalg.qr(mixing)[1].T)
    (remark,) = found.warnings
    assert "interreflection is negative on average in 1 of 3 colours." in remark.what
    assert "do not read it as light" in remark.meaning
    assert remark.remedy
