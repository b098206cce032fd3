"""Images as the rows of a matrix: inner products, means and linear combinations of them.

The matrix (rows: images; columns: pixels and colours) is never copied: threads share out blocks of
lines that fit the processor's caches, so the images may be files mapped to memory. Sums are taken
over fixed blocks in a fixed order; the number of threads does not change a bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeAlias, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

# Values of all images in a block: two megabytes of float32.
_BLOCK_VALUES = 1 << 19
_CHUNK_PIXELS = 128
# Products that one loop takes, so that a value is loaded once for several.
_TOGETHER = 4

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


def gram(rows: Rows, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Inner products of all pairs of rows over usable pixels and all colours, (m, m).

    Parameters
    ----------
    rows
        m images, float32, (height, width, colours), or an array of them.
    mask
        bool, (height, width), True where a pixel is usable; other values are not looked at.
    """
    n_rows = len(rows)

    def products(lines: slice) -> NDArray[np.float64]:
        sums = np.zeros((n_rows + -n_rows % _TOGETHER, n_rows + -n_rows % _TOGETHER))
        _add_products(_block(rows, lines), _per_value(mask[lines], rows[0].shape[2]), sums)
        return sums[:n_rows, :n_rows]

    lower = np.tril(np.sum(_in_blocks(products, rows), axis=0))
    whole: NDArray[np.float64] = lower + np.tril(lower, -1).T
    return whole


def means(rows: Rows, mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Mean of each row over usable pixels, (colours, m)."""
    n_colors = rows[0].shape[2]

    def totals(lines: slice) -> NDArray[np.float64]:
        sums = np.zeros((len(rows), n_colors))
        _add_values(_block(rows, lines), mask[lines].ravel(), sums)
        return sums

    mean: NDArray[np.float64] = np.sum(_in_blocks(totals, rows), axis=0).T
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

    def mix(lines: slice) -> None:
        block = _block(rows, lines)
        mixed = np.empty((len(out), block.shape[1]), np.float32)
        _mix(factors, block, mixed)
        out[:, lines] = mixed.reshape(len(out), -1, *out.shape[2:])

    _in_blocks(mix, rows)


def _in_blocks(work: Callable[[slice], _Found], rows: Rows) -> list[_Found]:
    """What `work` makes of each block of lines, in their order."""
    with ThreadPoolExecutor(numba.get_num_threads(), thread_name_prefix="rows") as threads:
        return list(threads.map(work, _line_blocks(rows)))


def _line_blocks(rows: Rows) -> Iterator[slice]:
    height, width, n_colors = rows[0].shape
    step = max(1, _BLOCK_VALUES // (len(rows) * width * n_colors))
    for start in range(0, height, step):
        yield slice(start, min(start + step, height))


def _block(rows: Rows, lines: slice) -> NDArray[np.float32]:
    """Some lines of all rows, (m, values)."""
    return np.stack([row[lines].reshape(-1) for row in rows])


def _per_value(usable: NDArray[np.bool_], n_colors: int) -> NDArray[np.bool_]:
    return np.repeat(usable.ravel(), n_colors)


# Without "nnan" and "ninf": values that are not finite must be found out.
_compiled = numba.njit(
    nogil=True, cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"}
)


@_compiled
def _add_products(block, usable, sums):  # type: ignore[no-untyped-def]
    """Add inner products of usable values to the lower triangle of `sums`, some at a time."""
    n_rows, n_values = block.shape
    size = 3 * _CHUNK_PIXELS
    chunk = np.zeros((len(sums), size))
    for start in range(0, n_values, size):
        length = min(size, n_values - start)
        kept = usable[start : start + length]
        for k in range(n_rows):
            source, target = block[k, start : start + length], chunk[k]
            for i in range(length):
                target[i] = source[i] if kept[i] else np.float32(0)
            target[length:] = 0
        for a in range(n_rows):
            one = chunk[a]
            for b in range(0, a + 1, _TOGETHER):
                first, second, third, fourth = chunk[b], chunk[b + 1], chunk[b + 2], chunk[b + 3]
                w = x = y = z = 0.0
                for i in range(size):
                    w += one[i] * first[i]
                    x += one[i] * second[i]
                    y += one[i] * third[i]
                    z += one[i] * fourth[i]
                sums[a, b] += w
                sums[a, b + 1] += x
                sums[a, b + 2] += y
                sums[a, b + 3] += z


@_compiled
def _add_values(block, usable, sums):  # type: ignore[no-untyped-def]
    n_colors = sums.shape[1]
    for k in range(len(block)):
        for i in range(len(usable)):
            if usable[i]:
                for c in range(n_colors):
                    sums[k, c] += block[k, n_colors * i + c]


@_compiled
def _mix(factors, values, out):  # type: ignore[no-untyped-def]
    """`factors`, (k, m, chunk), repeat with the colours, so that the inner loop has no index."""
    n_out, n_rows, size = factors.shape
    n_values = values.shape[1]
    for start in range(0, n_values, size):
        length = min(size, n_values - start)
        for k in range(n_out):
            mixed = out[k, start : start + length]
            mixed[:] = 0
            for m in range(n_rows):
                source, factor = values[m, start : start + length], factors[k, m]
                for i in range(length):
                    mixed[i] += factor[i] * source[i]
