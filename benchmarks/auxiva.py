"""AuxIVA against pyroomacoustics on the same mixtures in the same run.

Each round runs both, one after the other, so that what else the machine does falls on both.
Run from the root of the repository: ``python -m benchmarks.auxiva``.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import time
import tracemalloc
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pyroomacoustics.bss import auxiva as independent_auxiva

from processing.auxiva import auxiva


def mixtures_of(n_colors: int, n_components: int, n_samples: int) -> NDArray[np.float32]:
    rng = np.random.default_rng(0)
    sources = rng.laplace(size=(n_colors, n_components, n_samples)).astype(np.float32)
    sources *= np.abs(rng.standard_normal((1, n_components, n_samples), np.float32))
    mixing = rng.standard_normal((n_colors, n_components, n_components)).astype(np.float32)
    return mixing @ sources


def seconds(run: Callable[[], object]) -> float:
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


def peak_bytes() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=2_000_000)
    parser.add_argument("--iterations", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    mixtures = mixtures_of(3, 3, options.samples)
    frames = np.ascontiguousarray(mixtures.transpose(2, 0, 1))
    compiling_s = seconds(lambda: auxiva(mixtures[:, :, :1000], 1))
    tracemalloc.start()
    auxiva(mixtures, 1)
    beyond = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"mixtures {mixtures.shape} float32, {mixtures.nbytes / 1e6:.0f} MB")
    print(f"compiling or loading the compiled loop: {compiling_s:.2f} s")
    print(f"arrays beyond the mixtures: {beyond / 1e6:.1f} MB")
    ours, theirs = [], []
    for _ in range(options.rounds):
        ours_s = seconds(lambda: auxiva(mixtures, options.iterations))
        read_s = min(seconds(mixtures.max) for _ in range(5))
        theirs_s = seconds(
            lambda: independent_auxiva(
                frames, n_iter=options.iterations, proj_back=False, return_filters=True
            )
        )
        ours.append(ours_s)
        theirs.append(theirs_s)
        print(
            f"ours {ours_s:.3f} s = {1e3 * ours_s / options.iterations:.1f} ms an iteration, "
            f"one read by numpy {1e3 * read_s:.1f} ms; pyroomacoustics {theirs_s:.2f} s; "
            f"{theirs_s / ours_s:.0f} times faster"
        )
    print(f"peak with pyroomacoustics: {peak_bytes() / 1e6:.0f} MB in all")
    ratio = statistics.median(b / a for a, b in zip(ours, theirs, strict=True))
    print(f"median ratio {ratio:.0f}; ratio of the best times {min(theirs) / min(ours):.0f}")


if __name__ == "__main__":
    main()
