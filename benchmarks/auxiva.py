"""AuxIVA against pyroomacoustics, ssspy and scikit-learn on the same mixtures in the same run.

Each round runs all, one after the other, so that what else the machine does falls on all.
FastICA takes each colour apart on its own. Run from the root of the repository:
``python -m benchmarks.auxiva``.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import tracemalloc
import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pyroomacoustics.bss import auxiva as independent_auxiva
from sklearn.decomposition import FastICA
from sklearn.exceptions import ConvergenceWarning
from ssspy.bss.iva import AuxLaplaceIVA

from benchmarks.raw_decoding import seconds
from processing.auxiva import auxiva


def mixtures_of(n_colors: int, n_components: int, n_samples: int) -> NDArray[np.float32]:
    rng = np.random.default_rng(0)
    sources = rng.laplace(size=(n_colors, n_components, n_samples)).astype(np.float32)
    sources *= np.abs(rng.standard_normal((1, n_components, n_samples), np.float32))
    mixing = rng.standard_normal((n_colors, n_components, n_components)).astype(np.float32)
    return mixing @ sources


def peak_bytes() -> int:
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def peers(mixtures: NDArray[np.float32], iterations: int) -> dict[str, Callable[[], object]]:
    """The same number of iterations by others, none of which restores a scale or records a cost."""
    frames = np.ascontiguousarray(mixtures.transpose(2, 0, 1))
    channels = np.ascontiguousarray(mixtures.transpose(1, 0, 2))

    def by_colour() -> None:
        for colour in mixtures:
            FastICA(whiten="unit-variance", whiten_solver="eigh", max_iter=iterations, tol=0).fit(
                colour.T
            )

    return {
        "pyroomacoustics": lambda: independent_auxiva(
            frames, n_iter=iterations, proj_back=False, return_filters=True
        ),
        "ssspy": lambda: AuxLaplaceIVA(
            spatial_algorithm="IP", scale_restoration=False, record_loss=False
        )(channels, n_iter=iterations, initial_call=False),
        "FastICA": by_colour,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=2_000_000)
    parser.add_argument("--iterations", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    mixtures = mixtures_of(3, 3, options.samples)
    compiling_s = seconds(lambda: auxiva(mixtures[:, :, :1000], 1))
    tracemalloc.start()
    auxiva(mixtures, 1)
    beyond = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"mixtures {mixtures.shape} float32, {mixtures.nbytes / 1e6:.0f} MB")
    print(f"compiling or loading the compiled loop: {compiling_s:.2f} s")
    print(f"arrays beyond the mixtures: {beyond / 1e6:.1f} MB")
    others = peers(mixtures, options.iterations)
    ratios: dict[str, list[float]] = {name: [] for name in others}
    for _ in range(options.rounds):
        ours_s = seconds(lambda: auxiva(mixtures, options.iterations))
        read_s = min(seconds(mixtures.max) for _ in range(5))
        print(
            f"ours {ours_s:.3f} s = {1e3 * ours_s / options.iterations:.1f} ms an iteration, "
            f"one read by numpy {1e3 * read_s:.1f} ms"
        )
        for name, run in others.items():
            theirs_s = seconds(run)
            ratios[name].append(theirs_s / ours_s)
            print(f"  {name} {theirs_s:.2f} s, {ratios[name][-1]:.0f} times ours")
    print(f"peak of all: {peak_bytes() / 1e6:.0f} MB")
    for name, found in ratios.items():
        print(f"{name}: {statistics.median(found):.0f} times ours, median")


if __name__ == "__main__":
    main()
