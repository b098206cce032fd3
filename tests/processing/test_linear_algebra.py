"""Small matrices: right, and in an order of their own."""

from __future__ import annotations

import numpy as np
import pytest

from processing.numerics.linear_algebra import (
    inner,
    inverse,
    least_squares,
    log_determinant,
    product,
    solved,
    symmetric_eigen,
)


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.mark.parametrize("n", [1, 2, 5, 24])
def test_a_solution_solves(n: int) -> None:
    matrix, right = rng().standard_normal((n, n)), rng().standard_normal((n, 3))
    # Elimination loses some n·ε of the condition, here below 1e4.
    np.testing.assert_allclose(matrix @ solved(matrix, right), right, atol=1e-10)
    np.testing.assert_allclose(matrix @ solved(matrix, right[:, 0]), right[:, 0], atol=1e-10)
    np.testing.assert_allclose(matrix @ inverse(matrix), np.eye(n), atol=1e-10)


def test_a_pivot_that_is_zero_is_no_hindrance() -> None:
    assert solved(np.array([[0.0, 2.0], [4.0, 0.0]]), np.array([2.0, 4.0])).tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    "matrix", [np.ones((2, 2)), np.zeros((3, 3)), np.full((2, 2), np.nan)], ids=str
)
def test_what_has_no_solution_is_said(matrix: np.ndarray) -> None:
    with pytest.raises(np.linalg.LinAlgError, match=str(matrix.shape[0])):
        inverse(matrix)


@pytest.mark.parametrize("n", [1, 3, 8, 24])
def test_eigenvectors(n: int) -> None:
    half = rng().standard_normal((n, n)) * np.logspace(0, -5, n)[:, np.newaxis]
    matrix = half @ half.T
    values, vectors = symmetric_eigen(matrix)
    largest = np.abs(matrix).max()
    assert np.all(np.diff(values) >= 0)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(n), atol=1e-13)
    np.testing.assert_allclose(vectors * values @ vectors.T, matrix, atol=1e-13 * largest)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), atol=1e-13 * largest)


def test_eigenvalues_of_both_signs() -> None:
    values, vectors = symmetric_eigen(np.array([[0.0, 1.0], [1.0, 0.0]]))
    assert values.tolist() == [-1.0, 1.0]
    np.testing.assert_allclose(np.abs(vectors), np.sqrt(0.5), rtol=1e-15)


def test_small_eigenvalues_keep_their_digits() -> None:
    scale = np.array([1.0, 1e-6, 1e-12])
    inner_part = np.array([[2.0, 1.0, 0.5], [1.0, 3.0, 1.0], [0.5, 1.0, 4.0]])
    values, _ = symmetric_eigen(inner_part * np.outer(scale, scale))
    # The determinant is exact to rounding, and the two larger ones are to 1e-12.
    expected = np.linalg.det(inner_part) * np.prod(scale) ** 2
    assert np.prod(values) == pytest.approx(expected, rel=1e-12)


def test_products_and_sums() -> None:
    first, second = rng().standard_normal((3, 700)), rng().standard_normal((700, 4))
    np.testing.assert_allclose(product(first, second), first @ second, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(product(first, second[:, 0]), first @ second[:, 0], atol=1e-12)
    assert product(np.ones((2, 0)), np.ones((0, 3))).tolist() == [[0.0] * 3] * 2
    assert inner(first, first) == pytest.approx(np.sum(first**2), rel=1e-14)


def test_stacks_and_single_precision() -> None:
    first, second = rng().standard_normal((2, 3, 4)), rng().standard_normal((4, 5))
    np.testing.assert_allclose(product(first, second), first @ second, atol=1e-13)
    single = product(first[0].astype(np.float32), second.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, first[0] @ second, atol=1e-5)
    square = rng().standard_normal((2, 4, 4))
    np.testing.assert_allclose(inverse(square) @ square, [np.eye(4)] * 2, atol=1e-10)


def test_determinants() -> None:
    matrix = rng().standard_normal((5, 5))
    assert log_determinant(matrix) == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-12)
    assert log_determinant(np.ones((2, 2))) == -np.inf


def test_a_line_through_points() -> None:
    rows = np.stack([np.ones(9), np.arange(9.0)], axis=1)
    np.testing.assert_allclose(least_squares(rows, 2 - 3 * np.arange(9.0)), [2, -3], atol=1e-12)


def test_shapes_that_do_not_fit_are_named() -> None:
    with pytest.raises(ValueError, match=r"\(2, 3\).*\(2, 3\)"):
        product(np.ones((2, 3)), np.ones((2, 3)))
    with pytest.raises(ValueError, match=r"\(2, 3\).*\(2,\)"):
        solved(np.ones((2, 3)), np.ones(2))
    with pytest.raises(ValueError, match=r"\(2, 3\)"):
        symmetric_eigen(np.ones((2, 3)))
    with pytest.raises(ValueError, match=r"\(2,\).*\(3,\)"):
        inner(np.ones(2), np.ones(3))
