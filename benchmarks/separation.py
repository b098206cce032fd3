"""Streamed extrema against numpy on the whole stack, each in a process of its own.

Frames are written to a file first; both read them from there. Run from the root of the
repository: ``python -m benchmarks.separation``.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from processing.frames.separation import ExtremaSeparation

Shape = tuple[int, int, int]


def frame(folder: str, index: int) -> np.ndarray:
    loaded: np.ndarray = np.load(Path(folder) / f"{index}.npy")
    return loaded


def streamed(folder: str, n_frames: int, shape: Shape) -> None:
    extrema = ExtremaSeparation(shape)
    for index in range(n_frames):
        extrema.add(frame(folder, index))
    extrema.separate()


def stacked(folder: str, n_frames: int, shape: Shape) -> None:
    stack = np.stack([frame(folder, index) for index in range(n_frames)]).reshape(-1, *shape)
    largest, smallest = stack.max(axis=0), stack.min(axis=0)
    _ = largest - smallest, 2 * smallest


def measured(
    run: Callable[[str, int, Shape], None], folder: str, n_frames: int, shape: Shape
) -> tuple[float, float]:
    """Seconds, and megabytes that the run added to the process's peak."""
    warm_up = ExtremaSeparation((2, 2, 3))
    warm_up.add(np.zeros((2, 2, 3), np.float32))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started = time.perf_counter()
    run(folder, n_frames, shape)
    elapsed_s = time.perf_counter() - started
    return elapsed_s, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3


def in_child(
    run: Callable[[str, int, Shape], None], folder: str, n_frames: int, shape: Shape
) -> tuple[float, float]:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as child:
        return child.submit(measured, run, folder, n_frames, shape).result()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--height", type=int, default=1200)
    parser.add_argument("--width", type=int, default=1600)
    parser.add_argument("--frames", type=int, default=36)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    shape = (options.height, options.width, 3)
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        for index in range(options.frames):
            np.save(Path(folder) / f"{index}.npy", rng.random(shape, np.float32))
        frame_mb = 4 * np.prod(shape) / 1e6
        print(f"{options.frames} frames {shape} float32, {frame_mb:.0f} MB each")
        ratios = []
        for _ in range(options.rounds):
            ours_s, ours_mb = in_child(streamed, folder, options.frames, shape)
            theirs_s, theirs_mb = in_child(stacked, folder, options.frames, shape)
            ratios.append(theirs_s / ours_s)
            print(
                f"streamed {ours_s:.2f} s, {ours_mb:.0f} MB = {ours_mb / frame_mb:.1f} frames; "
                f"whole stack {theirs_s:.2f} s, {theirs_mb:.0f} MB = {theirs_mb / frame_mb:.1f} "
                f"frames; {ratios[-1]:.1f} times faster, {theirs_mb / ours_mb:.1f} times less"
            )
    print(f"median ratio of times {statistics.median(ratios):.1f}")


if __name__ == "__main__":
    main()
