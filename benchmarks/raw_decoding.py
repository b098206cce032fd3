"""Decoding a raw file to linear light, against LibRaw's unpacking of the same file.

    python -m benchmarks.raw_decoding

Writes two files of 16 million photosites itself, one uncompressed and one with the lossless JPEG
that most cameras and converters use, and takes turns: rawpy's `unpack`, decoding to superpixels,
decoding to bilinear pixels, and filling a new array of the superpixels' size, which is the least
that delivering them costs on top.
"""

from __future__ import annotations

import io
import time
from collections.abc import Callable

import imagecodecs
import numpy as np
import rawpy
import tifffile
from numpy.typing import NDArray

from drivers.image import Demosaic
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.dng import encode_dng

HEIGHT, WIDTH = 3280, 4928  # a Nikon D4S
ROUNDS = 21
TARGET = 1.3


def photograph() -> NDArray[np.uint16]:
    """A smooth scene with shot noise: what a lossless code has to deal with."""
    down, right = np.mgrid[:HEIGHT, :WIDTH]
    signal = 4000 + 3000 * np.sin(down / 400) * np.cos(right / 300)
    noisy = np.random.default_rng(1).normal(signal, np.sqrt(signal))
    counts: NDArray[np.uint16] = (512 + noisy).clip(0, 16383).astype(np.uint16)
    return counts


def compressed(uncompressed: bytes) -> bytes:
    """The same DNG with its strip as lossless JPEG: pairs of columns as two components."""
    with tifffile.TiffFile(io.BytesIO(uncompressed)) as file:
        page = file.pages.first
        counts = page.asarray()
        tags = [
            (tag.code, tag.dtype, tag.count, tag.value, True)
            for tag in page.tags.values()
            if tag.code in {271, 272, 33421, 33422, 33434} or tag.code >= 50000
        ]
    strip = imagecodecs.ljpeg_encode(counts, bitspersample=14)
    buffer = io.BytesIO()
    tifffile.imwrite(
        buffer,
        iter([bytes(strip)]),
        shape=counts.shape,
        dtype=np.uint16,
        compression=7,
        photometric=32803,
        rowsperstrip=counts.shape[0],
        metadata=None,
        extratags=tags,
    )
    return buffer.getvalue()


def unpack(data: bytes) -> None:
    """What rawpy needs before anything can be seen."""
    with rawpy.RawPy() as raw:
        raw.open_buffer(io.BytesIO(data))
        raw.unpack()


def fill(height: int, width: int) -> None:
    """Write superpixels and their mask once."""
    np.empty((height, width, 3), np.float32).fill(1)
    np.empty((height, width), np.bool_).fill(0)


def seconds(action: Callable[[], object]) -> float:
    started_s = time.perf_counter()
    action()
    return time.perf_counter() - started_s


def compare(name: str, data: bytes) -> float:
    """Print one file's row; the superpixels' ratio."""
    actions: tuple[Callable[[], object], ...] = (
        lambda: unpack(data),
        lambda: decode_raw(data),
        lambda: decode_raw(data, Demosaic.BILINEAR),
        lambda: fill(HEIGHT // 2, WIDTH // 2),
    )
    for action in actions:
        action()
    rounds = np.array([[seconds(action) for action in actions] for _ in range(ROUNDS)])
    milliseconds = 1000 * np.median(rounds, axis=0)
    ratios = rounds / rounds[:, :1]
    low, middle, high = np.percentile(ratios[:, 1], [25, 50, 75])
    print(
        f"{name} ({len(data) / 1e6:.0f} MB): unpack {milliseconds[0]:.1f} ms, "
        f"superpixels {milliseconds[1]:.1f} ms, ratio {middle:.2f} (quartiles {low:.2f}, "
        f"{high:.2f}), bilinear {milliseconds[2]:.1f} ms, ratio {np.median(ratios[:, 2]):.2f}; "
        f"filling the superpixels' memory {milliseconds[3]:.1f} ms"
    )
    return float(middle)


def main() -> None:
    counts = photograph()
    plain = encode_dng(counts, CameraSettings(0.1, 8.0, 200))
    packed = compressed(plain)
    for data in (plain, packed):
        with rawpy.imread(io.BytesIO(data)) as raw:
            np.testing.assert_array_equal(raw.raw_image_visible, counts)
    ratios = [compare("uncompressed", plain), compare("lossless JPEG", packed)]
    assert max(ratios) <= TARGET, f"more than {TARGET} times the unpacking"


if __name__ == "__main__":
    main()
