"""Images as the rows of a matrix: inner products, means and linear combinations of them.

The matrix (rows: images; columns: pixels and colours) is never copied: threads share out blocks of
lines that fit the processor's caches, so the images may be files mapped to memory. Sums are taken
over fixed blocks in a fixed order; neither the number of threads nor the processor changes a bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from processing.numerics.strata import stratified
from processing.numerics.threads import in_threads

# Values of all images in a block: two megabytes of float32.
_BLOCK_VALUES = 1 << 19
_CHUNK_PIXELS = 128
# Sums that run beside each other.
_LANES = 32

Rows: TypeAlias = Sequence[NDArray[np.float32]] | NDArray[np.float32]
_Found = TypeVar("_Found")


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


def gram(rows: Rows, mask: NDArray[np.bool_], stride_px: int = 1) -> NDArray[np.float64]:
    """Inner products of all pairs of rows over usable pixels and all colours, (m, m).

    Parameters
    ----------
    rows
        m images, float32, (height, width, colours), or an array of them.
    mask
        bool, (height, width), True where a pixel is usable; other values are not looked at.
    stride_px
        One of so many lines is looked at, ≥ 1, see `processing.numerics.strata`.
    """
    n_rows = len(rows)
    looked_at = stratified(len(mask), stride_px)

    def products(some: slice) -> NDArray[np.float64]:
        lines = looked_at[some]
        sums = np.zeros((n_rows, n_rows))
        _add_products(_block(rows, lines), _per_value(mask[lines], rows[0].shape[2]), sums)
        return sums

    lower = np.sum(_in_blocks(products, rows, len(looked_at)), axis=0)
    whole: NDArray[np.float64] = lower + np.tril(lower, -1).T
    return whole


def means(rows: Rows, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Mean of each row over usable pixels, (colours, m)."""
    n_colors = rows[0].shape[2]

    def totals(lines: slice) -> NDArray[np.float64]:
        places = np.zeros((len(rows), _CHUNK_PIXELS * n_colors))
        _add_values(_block(rows, lines), _per_value(mask[lines], n_colors), places)
        by_color: NDArray[np.float64] = places.reshape(len(rows), -1, n_colors).sum(axis=1)
        return by_color

    mean: NDArray[np.float64] = np.sum(_in_blocks(totals, rows, len(mask)), axis=0).T
    return mean / np.count_nonzero(mask)


def combine(matrix: NDArray[np.float64], rows: Rows, out: NDArray[np.float32]) -> None:
    """Write linear combinations of rows, block by block; `out` may be `rows` itself.

    Parameters
    ----------
    matrix
        (k, m), or (colours, k, m) where each colour has its own.
    rows
        m images, (height, width, colours), or an array of them.
    out
        (k, height, width, colours), written.
    """
    per_color = np.broadcast_to(matrix, (out.shape[3], *matrix.shape[-2:]))
    factors = np.tile(np.moveaxis(per_color, 0, -1).astype(np.float32), _CHUNK_PIXELS)
    # The last four are filled up with nothing of the last row.
    factors = np.pad(factors, ((0, 0), (0, -len(rows) % 4), (0, 0)))
    fours = [np.ascontiguousarray(factors[:, m : m + 4]) for m in range(0, len(rows), 4)]

    def mix(lines: slice) -> None:
        mixed = np.zeros((len(out), rows[0][lines].size), np.float32)
        for m, four in zip(range(0, len(rows), 4), fours, strict=True):
            values = [_values(row, lines) for row in rows[m : m + 4]]
            v0, v1, v2, v3 = (values + 3 * values[-1:])[:4]
            _add_four(four, v0, v1, v2, v3, mixed)
        out[:, lines] = mixed.reshape(len(out), -1, *out.shape[2:])

    _in_blocks(mix, rows, rows[0].shape[0])


def _in_blocks(work: Callable[[slice], _Found], rows: Rows, n_lines: int) -> list[_Found]:
    """What `work` makes of each block of so many lines, in their order."""
    _, width, n_colors = rows[0].shape
    step = max(1, _BLOCK_VALUES // (len(rows) * width * n_colors))
    blocks = [slice(start, min(start + step, n_lines)) for start in range(0, n_lines, step)]
    return in_threads(work, blocks)


def _block(rows: Rows, lines: slice | NDArray[np.int64]) -> NDArray[np.float32]:
    """Some lines of all rows, (m, values)."""
    first = rows[0][lines]
    block = np.empty((len(rows), first.size), np.float32)
    block[0] = first.reshape(-1)
    for target, row in zip(block[1:], rows[1:], strict=True):
        target.reshape(first.shape)[:] = row[lines]
    return block


def _values(row: NDArray[np.float32], lines: slice) -> NDArray[np.float32]:
    """Some lines of an image, (values,), copied only where they do not lie one by one."""
    return np.ascontiguousarray(row[lines]).reshape(-1)


def _per_value(usable: NDArray[np.bool_], n_colors: int) -> NDArray[np.bool_]:
    return np.repeat(usable.ravel(), n_colors)


# Sums run in lanes of fixed number and nothing is contracted: vectors of any width give the same
# bits.
_compiled = numba.njit(nogil=True, cache=True, error_model="numpy")


@_compiled
def _add_products(block, usable, sums):  # type: ignore[no-untyped-def]
    """Add inner products of usable values to the lower triangle of `sums`."""
    n_rows, n_values = block.shape
    size = 8 * _LANES
    flat = np.empty((n_rows, size))
    chunk = flat.reshape((n_rows, 8, _LANES))
    lanes = np.zeros((n_rows, n_rows, _LANES))
    for start in range(0, n_values, size):
        length = min(size, n_values - start)
        kept = usable[start : start + length]
        for k in range(n_rows):
            source, target = block[k, start : start + length], flat[k]
            for i in range(length):
                target[i] = source[i] if kept[i] else np.float32(0)
            target[length:] = 0
        for a in range(n_rows):
            one = chunk[a]
            x0, x1, x2, x3 = one[0], one[1], one[2], one[3]
            x4, x5, x6, x7 = one[4], one[5], one[6], one[7]
            for b in range(a + 1):
                other, lane = chunk[b], lanes[a, b]
                y0, y1, y2, y3 = other[0], other[1], other[2], other[3]
                y4, y5, y6, y7 = other[4], other[5], other[6], other[7]
                # Eight products a lane: its sum is loaded once for all.
                for i in range(_LANES):
                    lane[i] += (
                        ((x0[i] * y0[i] + x1[i] * y1[i]) + (x2[i] * y2[i] + x3[i] * y3[i]))
                        + ((x4[i] * y4[i] + x5[i] * y5[i]) + (x6[i] * y6[i] + x7[i] * y7[i]))
                    )  # fmt: skip
    for a in range(n_rows):
        for b in range(a + 1):
            for i in range(_LANES):
                sums[a, b] += lanes[a, b, i]


@_compiled
def _add_values(block, usable, places):  # type: ignore[no-untyped-def]
    """Add usable values to `places`, (m, chunk), one chunk after the other."""
    n_values, size = block.shape[1], places.shape[1]
    for start in range(0, n_values, size):
        length = min(size, n_values - start)
        kept = usable[start : start + length]
        for k in range(len(block)):
            source, target = block[k, start : start + length], places[k]
            for i in range(length):
                target[i] += source[i] if kept[i] else np.float32(0)


@_compiled
def _add_four(factors, v0, v1, v2, v3, out):  # type: ignore[no-untyped-def]
    """`factors`, (k, 4, chunk), repeat with the colours, so that the inner loop has no index."""
    n_out, _, size = factors.shape
    for start in range(0, len(v0), size):
        end = min(start + size, len(v0))
        a, b, c, d = v0[start:end], v1[start:end], v2[start:end], v3[start:end]
        for k in range(n_out):
            mixed, f = out[k, start:end], factors[k]
            f0, f1, f2, f3 = f[0], f[1], f[2], f[3]
            for i in range(end - start):
                mixed[i] += (f0[i] * a[i] + f1[i] * b[i]) + (f2[i] * c[i] + f3[i] * d[i])
