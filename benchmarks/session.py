"""A session's frames from raw files to what the decompositions need, against unpacking alone.

    python -m benchmarks.session

Writes raw files of 16 million photosites, losslessly compressed, and takes turns on the same cores:
rawpy's `unpack` of all of them in as many threads as decode a session; decoding with separation as
`iva` needs it; and with the harmonics that `ranges` needs beside it. What comes after the frames
(decomposition) does not grow with their number and is not in these figures.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from acquire.frames import DECODERS
from benchmarks.raw_decoding import HEIGHT, WIDTH, compressed, photograph, unpack
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.dng import encode_dng
from processing.frame_noise import FrameSample
from processing.harmonics import PitchDesign, PitchHarmonics
from processing.patterns import Family, Pattern, shift_grid
from processing.separation import ExtremaSeparation

PATTERNS = [Pattern(Family.CHECKER, 12, *shift) for shift in shift_grid(12, (6, 6))]


def write_files(folder: Path, count: int) -> list[Path]:
    """Different frames of one scene, so that no cache of decoded values helps."""
    counts = photograph()
    settings = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
    paths = []
    for index in range(count):
        shifted = np.roll(counts, 37 * index, axis=0)
        path = folder / f"{index:03d}.dng"
        path.write_bytes(compressed(encode_dng(shifted, settings)))
        paths.append(path)
    return paths


def unpacked(paths: list[Path]) -> None:
    with ThreadPoolExecutor(DECODERS) as threads:
        list(threads.map(lambda path: unpack(path.read_bytes()), paths))


def separated(paths: list[Path], *, with_harmonics: bool) -> None:
    """As `acquire.pitches` and `acquire.methods` go through the frames of a pitch."""
    shape = (HEIGHT // 2, WIDTH // 2, 3)
    patterns = PATTERNS[: len(paths)]
    extrema, sample = ExtremaSeparation(shape), FrameSample(patterns)
    harmonics = PitchHarmonics(PitchDesign.of(patterns), shape) if with_harmonics else None
    dark = np.zeros(shape, np.float32)
    total = np.zeros(shape, np.float32)
    with ThreadPoolExecutor(DECODERS) as threads:
        waiting = [threads.submit(lambda p: decode_raw(p.read_bytes()), p) for p in paths[:2]]
        for index, pattern in enumerate(patterns):
            values = waiting.pop(0).result().values - dark
            if index + 2 < len(paths):
                waiting.append(
                    threads.submit(lambda p: decode_raw(p.read_bytes()), paths[index + 2])
                )
            extrema.add(values)
            total += values
            sample.add(values, pattern)
            if harmonics is not None:
                harmonics.add(values, pattern)
    extrema.separate()


def for_iva(paths: list[Path]) -> None:
    separated(paths, with_harmonics=False)


def for_ranges(paths: list[Path]) -> None:
    separated(paths, with_harmonics=True)


def measured(run: Callable[[list[Path]], None], paths: list[Path]) -> tuple[float, float]:
    """Seconds, and the peak of the process in megabytes."""
    run(paths[:12])
    started = time.perf_counter()
    run(paths)
    elapsed_s = time.perf_counter() - started
    return elapsed_s, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def in_child(run: Callable[[list[Path]], None], paths: list[Path]) -> tuple[float, float]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as child:
        return child.submit(measured, run, paths).result()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, nargs="+", default=[18, 36])
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        paths = write_files(Path(folder), max(options.frames))
        size_mb = paths[0].stat().st_size / 1e6
        print(f"{HEIGHT} x {WIDTH} photosites, {size_mb:.1f} MB a file, {DECODERS} threads")
        for count in options.frames:
            ratios: dict[str, list[float]] = {"iva": [], "ranges": []}
            for _ in range(options.rounds):
                alone_s, _ = in_child(unpacked, paths[:count])
                for name, run in (("iva", for_iva), ("ranges", for_ranges)):
                    run_s, peak_mb = in_child(run, paths[:count])
                    ratios[name].append(run_s / alone_s)
                    print(
                        f"{count} frames: unpacking {alone_s:.2f} s, {name} {run_s:.2f} s, "
                        f"{1e3 * run_s / count:.0f} ms a frame, peak {peak_mb:.0f} MB"
                    )
            for name, found in ratios.items():
                print(f"{count} frames, {name}: {statistics.median(found):.2f} times unpacking")


if __name__ == "__main__":
    main()
