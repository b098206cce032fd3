"""Uncentred principal components of the direct images of several pitches.

D (rows: one direct image a pitch, then the white image; columns: pixels and colours) is never
copied: its Gram matrix D D' is summed over blocks of lines, so rows may be files mapped to memory.
Nothing is centred: in D = A X (Subpa-asa et al., eq. 7) no constant is free.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_BLOCK_VALUES = 1 << 22

Rows: TypeAlias = Sequence[NDArray[np.float32]] | NDArray[np.float32]


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


def principal_components(rows: Rows, mask: NDArray[np.bool_]) -> PrincipalComponents:
    """Uncentred PCA over usable pixels and all colours.

    Parameters
    ----------
    rows
        m images, float32, (height, width, colours), or an array of them.
    mask
        bool, (height, width), True where a pixel is usable; other values of `rows` are not
        looked at.
    """
    check_rows(rows, mask)
    n_rows = len(rows)
    gram = np.zeros((n_rows, n_rows))
    for lines in line_blocks(rows):
        block = np.stack([row[lines][mask[lines]].ravel() for row in rows]).astype(np.float64)
        gram += block @ block.T
    if not np.all(np.isfinite(gram)):
        raise ValueError("usable pixels hold values that are not finite; mask them")
    energy = float(np.trace(gram))
    if energy <= 0:
        raise ValueError("no light in any usable pixel: is the mask right, was the lamp on?")
    values, vectors = np.linalg.eigh(gram)
    values, vectors = values[::-1], vectors[:, ::-1]
    largest = np.abs(vectors).argmax(axis=0)
    signs = np.sign(vectors[largest, np.arange(n_rows)])
    n_samples = np.count_nonzero(mask) * rows[0].shape[2]
    return PrincipalComponents(
        np.maximum(values, 0) / energy, vectors * signs, energy / (n_samples * n_rows)
    )


def combine(matrix: NDArray[np.float64], images: Rows, out: NDArray[np.float32]) -> None:
    """Write linear combinations of images, block by block; `out` may be `images` itself.

    Parameters
    ----------
    matrix
        (k, m), or (colours, k, m) where each colour has its own.
    images
        m images, (height, width, colours), or an array of them.
    out
        (k, height, width, colours), written.
    """
    n_colors = out.shape[3]
    per_color = np.broadcast_to(matrix, (n_colors, *matrix.shape[-2:])).astype(np.float32)
    for lines in line_blocks(images):
        block = np.stack([image[lines] for image in images])
        out[:, lines] = np.einsum("ckm,mhwc->khwc", per_color, block, optimize=True)


def check_rows(rows: Rows, mask: NDArray[np.bool_]) -> None:
    """Refuse rows and mask that do not fit each other."""
    shapes = {row.shape for row in rows}
    if len(shapes) != 1 or len(rows[0].shape) != 3 or rows[0].shape[:2] != mask.shape:
        raise ValueError(
            "rows must be images of one shape, (height, width, colours), and mask (height, width); "
            f"their shapes are {sorted(shapes)} and {mask.shape}"
        )
    if mask.dtype != np.bool_:
        raise ValueError(f"mask must be bool, True where a pixel is usable, not {mask.dtype}")
    if not mask.any():
        raise ValueError("the mask leaves no usable pixel: all are saturated or unlit")


def line_blocks(images: Rows) -> Iterator[slice]:
    """Lines of all images in blocks small enough to be copied."""
    height, width, n_colors = images[0].shape
    step = max(1, _BLOCK_VALUES // (len(images) * width * n_colors))
    for start in range(0, height, step):
        yield slice(start, min(start + step, height))
