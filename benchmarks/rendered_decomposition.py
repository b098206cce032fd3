"""The default decomposition on path-traced scenes, beside the oracle's single pitch.

One row a scene and baseline, one table a condition: relative error of direct light, of all other
light, of inter-reflection and of subsurface scattering by `ranges`, in parentheses of max and min
with the complement at the pitch that only the truth can choose (its global light is compared with
all that is not direct), and the share of values whose truth lies within the stated errors.

Run from the root of the repository: ``python -m benchmarks.rendered_decomposition --cache DIR``.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.decomposition import Captured
from benchmarks.rendered_captures import CONDITIONS, captures
from benchmarks.rendered_scenes import BASELINES, HELD_OUT, TUNED_ON, UNTOUCHED
from processing.metrics import errors_of, oracle, relative_error
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.result import RangeDecomposition

Image = NDArray[np.float32]

COLUMNS = (
    "scene", "direct", "not direct", "inter-reflection", "subsurface", "within the error", "blur",
)  # fmt: skip


def row(label: str, run: Captured, found: RangeDecomposition) -> list[str]:
    """One scene's cells."""
    rest = run.truth["subsurface"] + run.truth["interreflection"]
    direct = run.truth["direct"]
    best = oracle(errors_of(run.rows, direct, run.mask))
    # With the complement, what is not direct is off by as much as direct light is.
    best_rest = relative_error(run.white - run.rows[best.index], rest, run.mask)
    parts = dict(zip(found.names, found.components, strict=True))
    none = np.zeros_like(found.white)
    scattered = parts.get("subsurface", none)
    share = scattered[run.mask].sum() / found.white[run.mask].sum()
    cells = [
        label,
        f"{relative_error(parts['direct'], direct, run.mask):.4f} ({best.error:.4f})",
        f"{relative_error(found.white - parts['direct'], rest, run.mask):.4f} ({best_rest:.4f})",
        f"{relative_error(parts['interreflection'], run.truth['interreflection'], run.mask):.4f}",
    ]
    if run.truth["subsurface"][run.mask].any():
        cells.append(f"{relative_error(scattered, run.truth['subsurface'], run.mask):.3f}")
    else:
        cells.append(f"{share:.2%} of white")
    covered = [
        np.mean(np.abs(part - run.truth[name])[run.mask] <= deviation[run.mask])
        for name, part, deviation in zip(
            found.names, found.components, found.deviations, strict=True
        )
    ]
    cells.append(" ".join(f"{one:.2f}" for one in covered))
    cells.append(" ".join(f"{np.sqrt(one.side_px2):.2f}" for one in found.blur))
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=[*TUNED_ON, *HELD_OUT, *UNTOUCHED])
    parser.add_argument("--baselines", nargs="+", default=list(BASELINES), choices=BASELINES)
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), choices=CONDITIONS)
    parser.add_argument("--cache", type=Path, required=True, help="keeps what was rendered")
    options = parser.parse_args()
    for condition in options.conditions:
        print(f"\n## {condition}\n\n| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
        for scene in options.scenes:
            for baseline in options.baselines:
                run = captures(scene, baseline, options.cache, [condition])[condition]
                started = time.perf_counter()
                found = decompose_ranges(run.stack, run.mask)
                elapsed_s = time.perf_counter() - started
                aside = "" if scene in TUNED_ON else ", held out"
                cells = row(f"{scene}, {baseline}{aside}", run, found)
                print(f"| {' | '.join(cells)} | {elapsed_s:.1f} s", flush=True)
                for remark in found.warnings:
                    print(f"  ({remark.what[:60]}…)")


if __name__ == "__main__":
    main()
