"""Uncentred principal components of the direct images of several pitches.

They come from the Gram matrix D D' of its rows: one direct image a pitch, then the white image.
Nothing is centred: in D = A X (Subpa-asa et al., eq. 7) no constant is free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import symmetric_eigen
from processing.numerics.rows import Rows, check_rows, gram
from processing.numerics.strata import stratified

# Share of a direction that rows of float32 do not have.
ROUNDING = 1e-13


@dataclass(frozen=True, slots=True)
class PrincipalComponents:
    """Directions of D among its rows, the strongest first.

    Parameters
    ----------
    shares
        float64, (m,), each direction's part of the sum of squares of D; they add up to 1.
    vectors
        float64, (m, m), orthonormal columns; the largest entry of each is positive.
    mean_square
        Mean of the squares of D over pixels, colours and rows, in the unit of D squared.
    """

    shares: NDArray[np.float64]
    vectors: NDArray[np.float64]
    mean_square: float

    @property
    def rank(self) -> int:
        """How many hold more than what rounding leaves of none, at least 1."""
        return max(1, int(np.count_nonzero(self.shares >= ROUNDING)))


def principal_components(
    rows: Rows, mask: NDArray[np.bool_], stride_px: int = 1
) -> PrincipalComponents:
    """Uncentred PCA over usable pixels and all colours.

    Parameters
    ----------
    rows
        m images, float32, (height, width, colours), or an array of them.
    mask
        bool, (height, width), True where a pixel is usable; other values of `rows` are not
        looked at.
    stride_px
        One of so many lines is looked at, ≥ 1, see `processing.numerics.strata`.
    """
    check_rows(rows, mask)
    n_rows = len(rows)
    products = gram(rows, mask, stride_px)
    if not np.all(np.isfinite(products)):
        raise ValueError("usable pixels hold values that are not finite; mask them")
    energy = float(np.trace(products))
    if energy <= 0:
        raise ValueError("no light in any usable pixel: is the mask right, was the lamp on?")
    values, vectors = symmetric_eigen(products)
    values, vectors = values[::-1], vectors[:, ::-1]
    largest = np.abs(vectors).argmax(axis=0)
    signs = np.sign(vectors[largest, np.arange(n_rows)])
    looked_at = mask[stratified(len(mask), stride_px)]
    n_samples = np.count_nonzero(looked_at) * rows[0].shape[2]
    return PrincipalComponents(
        np.maximum(values, 0) / energy, vectors * signs, energy / (n_samples * n_rows)
    )
