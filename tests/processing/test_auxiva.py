"""AuxIVA: agreement with an independent program, descent, invariance, determinism."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pyroomacoustics.bss import auxiva as independent_auxiva

from processing.auxiva import auxiva


def mixtures_of(
    n_colors: int, n_components: int, n_samples: int, seed: int = 0
) -> NDArray[np.float64]:
    """Sparse sources whose colours are active together, mixed by random matrices."""
    rng = np.random.default_rng(seed)
    activity = np.abs(rng.standard_normal((1, n_components, n_samples)))
    sources = activity * rng.laplace(size=(n_colors, n_components, n_samples))
    return rng.standard_normal((n_colors, n_components, n_components)) @ sources


def unit_rows(unmixing: NDArray[Any]) -> NDArray[Any]:
    rows: NDArray[Any] = unmixing / np.linalg.norm(unmixing, axis=-1, keepdims=True)
    return rows


@pytest.mark.parametrize("n_iterations", [1, 10])
@pytest.mark.parametrize("n_components", [2, 3, 4])
def test_unmixing_agrees_with_an_independent_program(n_components: int, n_iterations: int) -> None:
    mixtures = mixtures_of(3, n_components, 20_000)
    _, expected = independent_auxiva(
        np.ascontiguousarray(mixtures.transpose(2, 0, 1)),
        n_iter=n_iterations,
        proj_back=False,
        model="laplace",
        return_filters=True,
    )
    found = auxiva(mixtures, n_iterations).unmixing
    np.testing.assert_allclose(unit_rows(found), unit_rows(expected), rtol=0, atol=1e-9)


@settings(deadline=None, max_examples=40)
@given(
    n_colors=st.integers(1, 3),
    n_components=st.integers(2, 4),
    n_samples=st.integers(50, 3000),
    seed=st.integers(0, 2**32 - 1),
    gain=st.sampled_from([1e-6, 1.0, 1e6]),
    kind=st.sampled_from([np.float32, np.float64]),
)
def test_cost_never_rises(
    n_colors: int,
    n_components: int,
    n_samples: int,
    seed: int,
    gain: float,
    kind: type[np.floating[Any]],
) -> None:
    mixtures: NDArray[Any] = (gain * mixtures_of(n_colors, n_components, n_samples, seed)).astype(
        kind
    )
    cost = auxiva(mixtures, 25).cost
    # Rounding of a mean over n_samples in float64 is all that may be left.
    assert np.all(np.diff(cost) <= 1e-11 * np.abs(cost[:-1]).max())


def test_cost_is_that_of_the_model() -> None:
    mixtures = mixtures_of(3, 2, 5000)
    result = auxiva(mixtures, 4)
    sources = result.unmixing @ mixtures
    last = np.linalg.norm(sources, axis=0).sum(axis=0).mean()
    last -= np.log(np.abs(np.linalg.det(result.unmixing))).sum()
    assert result.cost.shape == (5,)
    assert result.cost[0] == pytest.approx(np.linalg.norm(mixtures, axis=0).sum(axis=0).mean())
    assert result.cost[-1] == pytest.approx(last)


@pytest.mark.parametrize("n_colors", [1, 3], ids=["one-color", "three-colors"])
def test_known_sources_are_recovered(n_colors: int) -> None:
    rng = np.random.default_rng(3)
    sparse = rng.random((1, 3, 60_000)) < 0.1
    sources = sparse * rng.standard_normal((n_colors, 3, 60_000))
    mixing = np.eye(3) + 0.5 * rng.uniform(-1, 1, (n_colors, 3, 3))
    gains = np.abs(auxiva(mixing @ sources, 30).unmixing @ mixing)
    gains /= gains.max(axis=2, keepdims=True)
    assert np.all(np.sort(gains, axis=2)[..., :-1] < 0.03)
    # One source has one place in all colours.
    assert np.all(gains.argmax(axis=2) == gains.argmax(axis=2)[:1])


@pytest.mark.parametrize("n_colors", [1, 2, 3])
@pytest.mark.parametrize("gain", [1e-8, 1e8])
def test_a_gain_of_the_mixtures_changes_only_the_scale(n_colors: int, gain: float) -> None:
    mixtures = mixtures_of(n_colors, 3, 10_000)
    expected = unit_rows(auxiva(mixtures).unmixing)
    np.testing.assert_allclose(
        unit_rows(auxiva(gain * mixtures).unmixing), expected, rtol=0, atol=1e-9
    )


def test_samples_without_light_change_nothing() -> None:
    mixtures = mixtures_of(3, 3, 9000)
    dark = np.concatenate([mixtures, np.zeros((3, 3, 9000))], axis=2)
    np.testing.assert_allclose(
        unit_rows(auxiva(dark).unmixing), unit_rows(auxiva(mixtures).unmixing), rtol=0, atol=1e-9
    )


def test_float32_and_float64_agree() -> None:
    rough = mixtures_of(3, 3, 30_000).astype(np.float32)
    expected = unit_rows(auxiva(rough.astype(np.float64)).unmixing)
    np.testing.assert_allclose(unit_rows(auxiva(rough).unmixing), expected, rtol=0, atol=1e-12)


def test_threads_do_not_change_a_bit() -> None:
    mixtures = mixtures_of(3, 3, 50_001).astype(np.float32)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        single = auxiva(mixtures)
    finally:
        numba.set_num_threads(before)
    several = auxiva(mixtures)
    assert single.unmixing.tobytes() == several.unmixing.tobytes()
    assert single.cost.tobytes() == several.cost.tobytes()


def test_without_iterations_nothing_is_unmixed() -> None:
    result = auxiva(mixtures_of(3, 3, 1000), 0)
    assert result.cost.shape == (1,)
    np.testing.assert_allclose(unit_rows(result.unmixing), np.tile(np.eye(3), (3, 1, 1)))


def dependent() -> NDArray[np.float64]:
    mixtures = mixtures_of(3, 3, 1000)
    mixtures[:, 2] = mixtures[:, 0]
    return mixtures


@pytest.mark.parametrize(
    ("mixtures", "n_iterations", "said"),
    [
        pytest.param(np.ones((3, 100)), 10, r"\(3, 100\)", id="two-axes"),
        pytest.param(np.ones((3, 2, 0)), 10, r"\(3, 2, 0\)", id="empty"),
        pytest.param(np.ones((3, 4, 3)), 10, r"\(3, 4, 3\)", id="fewer-samples-than-components"),
        pytest.param(np.ones((3, 2, 50), complex), 10, "complex", id="complex"),
        pytest.param(np.ones((3, 2, 50), int), 10, "int64", id="integers"),
        pytest.param(np.full((3, 2, 50), np.nan), 10, "finite", id="nan"),
        pytest.param(np.zeros((3, 2, 50)), 10, "zeros", id="dark"),
        pytest.param(mixtures_of(3, 2, 50), -1, "-1", id="negative-iterations"),
        pytest.param(dependent(), 10, "depend on each other", id="dependent"),
    ],
)
def test_what_cannot_be_unmixed_is_refused(
    mixtures: NDArray[Any], n_iterations: int, said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        auxiva(mixtures, n_iterations)
