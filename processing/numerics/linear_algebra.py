"""Linear algebra of small matrices that gives the same bits on every processor.

BLAS and LAPACK choose their code by the processor, and with it the order of their sums. Here every
sum is taken in the order of its indices. Meant for matrices of some dozen rows; the long axis of a
product may have any length.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from processing.numerics.elementary import log

Array = NDArray[np.float64]
_Floats = TypeVar("_Floats", NDArray[np.float64], NDArray[np.float32])

# They converge within some six.
_MOST_SWEEPS = 60
_ROUNDING = 1e-16


def product(first: _Floats, second: _Floats) -> _Floats:
    """The matrix product of (…, k, m) and (…, m, n), or of (k, m) with a vector of (m,)."""
    if second.ndim == 1:
        return product(first, second[:, np.newaxis])[..., 0]
    if min(first.ndim, second.ndim) < 2 or first.shape[-1] != second.shape[-2]:
        raise ValueError(f"there is no product of shapes {first.shape} and {second.shape}")
    ahead: tuple[int, ...] = np.broadcast_shapes(first.shape[:-2], second.shape[:-2])
    total = np.zeros((*ahead, first.shape[-2], second.shape[-1]), first.dtype)
    ones = np.broadcast_to(first, (*ahead, *first.shape[-2:]))
    others = np.broadcast_to(second, (*ahead, *second.shape[-2:]))
    for place in np.ndindex(ahead):
        one, other = np.ascontiguousarray(ones[place]), np.ascontiguousarray(others[place])
        _multiply(one, other, total[place])
    return total


def inner(first: Array, second: Array) -> float:
    """Sum of the products of all entries of two arrays of one shape."""
    if first.shape != second.shape:
        raise ValueError(f"there is no inner product of shapes {first.shape} and {second.shape}")
    return float(np.sum(first * second))


def solved(matrix: Array, right: Array) -> Array:
    """The x of `matrix` x = `right`, by elimination (Gauss and Jordan) with column pivots.

    Parameters
    ----------
    matrix
        (n, n).
    right
        (n,) or (n, k).

    Raises
    ------
    numpy.linalg.LinAlgError
        The matrix is singular, or not finite.
    """
    if matrix.ndim != 2 or matrix.shape != (len(right), len(right)):
        raise ValueError(f"a matrix of shape {matrix.shape} does not go with {right.shape}")
    joined = np.column_stack([matrix, right]).astype(np.float64)
    if not _eliminate(joined):
        raise np.linalg.LinAlgError(f"the matrix of shape {matrix.shape} is singular")
    found: Array = joined[:, len(matrix) :] / np.diagonal(joined)[:, np.newaxis]
    return found.reshape(right.shape)


def inverse(matrix: Array) -> Array:
    """The inverse of (…, n, n), see `solved`."""
    size = matrix.shape[-1]
    inverses = [solved(one, np.eye(size)) for one in matrix.reshape(-1, size, size)]
    return np.stack(inverses).reshape(matrix.shape)


def log_determinant(matrix: Array) -> float:
    """Ln |det| of (n, n); −∞ of a singular one."""
    joined = np.array(matrix, np.float64)
    if not _eliminate(joined):
        return -np.inf
    return float(np.sum(log(np.abs(np.diagonal(joined)))))


def least_squares(rows: Array, values: Array) -> Array:
    """The x, (n,), at which `rows` x, (m, n), is nearest to `values`, (m,).

    By normal equations: for few unknowns of one order of magnitude.
    """
    return solved(product(rows.T, rows), product(rows.T, values))


def symmetric_eigen(matrix: Array) -> tuple[Array, Array]:
    """Eigenvalues, rising, and eigenvectors, the columns of (n, n), of a symmetric matrix.

    By Jacobi's rotations (Golub and Van Loan, Matrix Computations, 4th ed., section 8.5), which
    find small eigenvalues of positive matrices to more digits than other ways do.
    """
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"a symmetric matrix is square, not {matrix.shape}")
    if not np.all(np.isfinite(matrix)):
        raise np.linalg.LinAlgError("the matrix has entries that are not finite")
    rotated, vectors = np.array(matrix, np.float64), np.eye(len(matrix))
    _diagonalise(rotated, vectors)
    values = np.diagonal(rotated)
    order = np.argsort(values, kind="stable")
    return values[order], vectors[:, order]


@njit(cache=True)
def _multiply(first, second, total):  # type: ignore[no-untyped-def]
    for i in range(first.shape[0]):
        for k in range(first.shape[1]):
            for j in range(second.shape[1]):
                total[i, j] += first[i, k] * second[k, j]


@njit(cache=True)
def _eliminate(joined):  # type: ignore[no-untyped-def]
    """Turn (matrix, right sides) into (diagonal, its right sides); False where there is none."""
    size = len(joined)
    for k in range(size):
        pivot = k + np.abs(joined[k:, k]).argmax()
        if not np.abs(joined[pivot, k]) > 0:
            return False
        for j in range(k, joined.shape[1]):
            joined[k, j], joined[pivot, j] = joined[pivot, j], joined[k, j]
        for i in range(size):
            if i != k:
                factor = joined[i, k] / joined[k, k]
                for j in range(k, joined.shape[1]):
                    joined[i, j] -= factor * joined[k, j]
    return True


@njit(cache=True)
def _diagonalise(matrix, vectors):  # type: ignore[no-untyped-def]
    """Rotate until nothing but the diagonal is left; the columns of `vectors` turn along."""
    size = len(matrix)
    for _ in range(_MOST_SWEEPS):
        turned = False
        for p in range(size - 1):
            for q in range(p + 1, size):
                aside = matrix[p, q]
                along = np.sqrt(np.abs(matrix[p, p])) * np.sqrt(np.abs(matrix[q, q]))
                if np.abs(aside) <= _ROUNDING * along:
                    continue
                turned = True
                ratio = (matrix[q, q] - matrix[p, p]) / (2 * aside)
                tangent = 1 / (np.abs(ratio) + np.sqrt(1 + ratio * ratio))
                if ratio < 0:
                    tangent = -tangent
                cosine = 1 / np.sqrt(1 + tangent * tangent)
                sine = tangent * cosine
                matrix[p, p] -= tangent * aside
                matrix[q, q] += tangent * aside
                matrix[p, q] = matrix[q, p] = 0.0
                for k in range(size):
                    if k not in (p, q):
                        one, other = matrix[k, p], matrix[k, q]
                        matrix[k, p] = matrix[p, k] = cosine * one - sine * other
                        matrix[k, q] = matrix[q, k] = sine * one + cosine * other
                    one, other = vectors[k, p], vectors[k, q]
                    vectors[k, p] = cosine * one - sine * other
                    vectors[k, q] = sine * one + cosine * other
        if not turned:
            return
