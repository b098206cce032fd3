"""The paper's decomposition against one read of its rows, and against numpy on the whole stack.

    python -m benchmarks.iva_decomposition
    python -m benchmarks.iva_decomposition --megapixels 1 2 4 --rows 6 12 24    # how the cost grows

Rows are mixtures of three images with texture, with noise, in memory. Each round takes turns: one
read of all rows (their sum, by as many threads as the decomposition uses), the decomposition, and,
where asked, the same steps written with numpy on the whole stack.
"""

from __future__ import annotations

import argparse
import statistics

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from benchmarks.raw_decoding import seconds
from processing.auxiva import auxiva
from processing.independence.decomposition import decompose_iva

Image = NDArray[np.float32]
TARGET = 20.0
ASPECT = 1.5
NOISE = 0.002


def rows_of(megapixels: float, n_rows: int) -> Image:
    """(rows, height, width, 3), the last white."""
    height = int(np.sqrt(megapixels * 1e6 / ASPECT))
    shape = height, int(ASPECT * height)
    rng = np.random.default_rng(0)
    sources = [textured(shape, cell_px, rng) for cell_px in (8, 60, 400)]
    pitch_px = np.append(np.geomspace(8, 72, n_rows - 1), np.inf)
    alpha = np.stack([np.ones(n_rows), 1 / (1 + 20 / pitch_px), 1 / (1 + 200 / pitch_px)], -1)
    rows = np.empty((n_rows, *shape, 3), np.float32)
    for k, shares in enumerate(alpha.astype(np.float32)):
        rows[k] = np.float32(NOISE) * rng.standard_normal(rows[k].shape, np.float32)
        for share, source in zip(shares, sources, strict=True):
            rows[k] += share * source
    return rows


def textured(shape: tuple[int, int], cell_px: int, rng: np.random.Generator) -> Image:
    """Patches of about `cell_px`, in three colours."""
    coarse = rng.random((shape[0] // cell_px + 2, shape[1] // cell_px + 2, 3), np.float32)
    image = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_NEAREST)
    return np.asarray(image / 3, np.float32)


@numba.njit(parallel=True, fastmath=True)
def read(values):  # type: ignore[no-untyped-def]
    """Sum by all threads."""
    total = 0.0
    for i in numba.prange(values.size):
        total += values[i]
    return total


def with_numpy(rows: Image) -> None:
    """Principal components, gradients, whitening, AuxIVA and unmixing, the stack in one matrix."""
    matrix = rows.reshape(len(rows), -1)
    vectors = np.linalg.eigh(matrix @ matrix.T)[1][:, ::-1][:, :3]
    images = (vectors.T @ matrix).reshape(3, *rows.shape[1:])
    gradients = np.concatenate(
        [np.diff(images, axis=axis).reshape(3, -1, 3) for axis in (1, 2)], axis=1
    ).transpose(2, 0, 1)
    whitened = np.empty_like(gradients)
    filters = []
    for colour, samples in zip(whitened, gradients, strict=True):
        values, axes = np.linalg.eigh(np.cov(samples))
        filters.append(axes / np.sqrt(values) @ axes.T)
        colour[:] = filters[-1] @ samples
    unmixing = auxiva(whitened).unmixing @ np.array(filters)
    np.einsum("cij,jhwc->ihwc", unmixing, images, optimize=True)


def compare(rows: Image, rounds: int, *, naive: bool) -> None:
    """Take turns and print the medians."""
    mask = np.ones(rows.shape[1:3], bool)
    pitch_px = np.append(np.geomspace(8, 72, len(rows) - 1), np.inf)
    found: list[tuple[float, float, float]] = []
    for _ in range(rounds):
        read_s = min(seconds(lambda: read(rows.reshape(-1))) for _ in range(3))
        ours_s = seconds(lambda: decompose_iva(rows, pitch_px, mask))
        found.append((read_s, ours_s, seconds(lambda: with_numpy(rows)) if naive else np.nan))
    read_s, ours_s, numpy_s = np.median(found, axis=0)
    reads = statistics.median(ours / one for one, ours, _ in found)
    megapixels = rows.shape[1] * rows.shape[2] / 1e6
    print(
        f"{megapixels:.1f} MP × {rows.shape[3]} × {len(rows)} rows ({rows.nbytes / 1e9:.2f} GB): "
        f"one read {1e3 * read_s:.0f} ms, decomposition {ours_s:.2f} s = {reads:.1f} reads"
        + (f" (target {TARGET:.0f}), numpy on the stack {numpy_s:.1f} s" if naive else ""),
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megapixels", type=float, nargs="+", default=[4.0])
    parser.add_argument("--rows", type=int, nargs="+", default=[24])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--naive", action="store_true", help="numpy on the whole stack as well")
    options = parser.parse_args()
    compare(rows_of(0.05, 6), 1, naive=False)
    for megapixels in options.megapixels:
        for n_rows in options.rows:
            compare(rows_of(megapixels, n_rows), options.rounds, naive=options.naive)


if __name__ == "__main__":
    main()
