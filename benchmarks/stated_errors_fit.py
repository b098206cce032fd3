"""Makes the coefficients of `processing.stated_errors` again from path-traced scenes.

    python -m benchmarks.stated_errors_fit --cache DIR

The captures are those of `benchmarks.rendered_decomposition`; DIR keeps them. For each component
the coefficients minimise the pinball loss at a quantile of log |error|, every capture of the
tuning scenes with the same weight. The quantile is chosen by leaving out one scene at a time: the
share of pixels within the error, on scenes that the coefficients do not know, is printed for each.
The scenes held out are looked at last, with the coefficients in the code. There is no chance in it:
the same captures make the same numbers.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, minimize

from benchmarks.rendered_captures import captures
from benchmarks.rendered_scenes import BASELINES, HELD_OUT, TUNED_ON
from processing.range_decomposition import NAMES
from processing.ranges import fit_ranges
from processing.stated_errors import COEFFICIENTS, SIGNS

Array = NDArray[np.float64]

CONDITIONS = ("noise-free", "noisy", "blurred", "defocused")
QUANTILES = (0.68, 0.72, 0.76)
# Which signs share a coefficient.
_TIED = ((0,), (1,), (2,), (3, 4))
# Every so many-th pixel: neighbours err alike.
_STEP = 17
_START, _BOUNDS = 0.3, (1e-3, 10.0)
_SWEEPS = 1


@dataclass(frozen=True, slots=True)
class Samples:
    """One capture and component, relative to white.

    Parameters
    ----------
    scene, label
        Which.
    error, noise
        float64, (n,): |estimate − truth| and the standard error from noise.
    signs
        float64, (signs, n).
    """

    scene: str
    label: str
    error: Array
    noise: Array
    signs: Array

    def covered(self, coefficients: Array) -> float:
        """Share of pixels within the error."""
        return float(np.mean(self.error <= self.deviation(coefficients) + 1e-6))

    def deviation(self, coefficients: Array) -> Array:
        """Standard errors in all."""
        total: Array = np.sqrt(self.noise**2 + coefficients**2 @ self.signs**2)
        return total


def samples(scene: str, baseline: str, condition: str, cache: Path) -> list[Samples]:
    """One for each component; none for subsurface light where there is none, in truth or found."""
    run = captures(scene, baseline, cache, [condition])[condition]
    fitted = fit_ranges(run.stack, run.mask)
    lit = np.maximum(fitted.capture.white, 0)
    colours = [
        fitted.fits.colour(fitted.found, run.mask, lit, colour) for colour in range(lit.shape[2])
    ]
    chosen = []
    for index, name in enumerate(NAMES):
        truth, where = run.truth[name], run.mask
        if name == "subsurface":
            where = run.mask & (fitted.found | (truth.sum(axis=-1) > 0))
        if (name == "subsurface" and not fitted.found.any()) or not where.any():
            continue
        rows = []
        for colour, one in enumerate(colours):
            white = np.maximum(lit[where, colour], 1e-6)
            misfits, *shared = one.signs
            error = np.abs(one.components[index] - truth[..., colour])
            images = (error, one.noise_errors[index], misfits[index], *shared)
            rows.append(np.stack([image[where] / white for image in images]).astype(np.float64))
        values = np.concatenate(rows, axis=1)
        label = f"{scene}, {baseline}, {condition}: {name}"
        chosen.append(Samples(scene, label, values[0], values[1], values[2:]))
    return chosen


def loss(seen: list[Samples], coefficients: Array, quantile: float) -> float:
    """Mean pinball loss of log |error|, every capture with the same weight."""
    total = 0.0
    for one in seen:
        off = np.log(one.error[::_STEP] + 1e-7)
        off = off - np.log(
            np.sqrt(one.noise[::_STEP] ** 2 + coefficients**2 @ one.signs[:, ::_STEP] ** 2) + 1e-9
        )
        total += float(np.mean(np.where(off > 0, quantile * off, (quantile - 1) * off)))
    return total / len(seen)


def fitted_coefficients(seen: list[Samples], quantile: float) -> Array:
    """(signs,), by Powell's method in the logarithms."""

    def spread(logs: Array) -> Array:
        coefficients = np.zeros(len(SIGNS))
        for value, tied in zip(np.exp(logs), _TIED, strict=True):
            coefficients[list(tied)] = value
        return coefficients

    logs = np.full(len(_TIED), np.log(_START))
    low, high = (np.full(len(_TIED), np.log(end)) for end in _BOUNDS)
    bounds = Bounds(low, high)
    for _ in range(_SWEEPS):
        logs = minimize(  # type: ignore[call-overload]  # its stubs know no float options
            lambda at: loss(seen, spread(at), quantile), logs, method="Powell",
            bounds=bounds,
            options={"maxiter": 8, "xtol": 0.02, "ftol": 1e-4},
        ).x  # fmt: skip
    return spread(np.asarray(logs))


def left_out(seen: list[Samples], quantile: float) -> dict[str, float]:
    """Coverage of each capture by coefficients that do not know its scene."""
    shares = {}
    for scene in dict.fromkeys(one.scene for one in seen):
        others = [one for one in seen if one.scene != scene]
        if not others:
            continue
        coefficients = fitted_coefficients(others, quantile)
        shares.update({one.label: one.covered(coefficients) for one in seen if one.scene == scene})
    return shares


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, required=True, help="keeps what was rendered")
    parser.add_argument("--quantiles", nargs="+", type=float, default=list(QUANTILES))
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), choices=CONDITIONS)
    parser.add_argument("--held-out", action="store_true", help="look at the scenes held out")
    options = parser.parse_args()
    scenes = HELD_OUT if options.held_out else TUNED_ON
    seen: dict[str, list[Samples]] = {name: [] for name in NAMES}
    for scene in scenes:
        for baseline in BASELINES:
            for condition in options.conditions:
                for one in samples(scene, baseline, condition, options.cache):
                    seen[one.label.split(": ")[1]].append(one)
    for index, (name, rows) in enumerate(seen.items()):
        print(f"\n## {name}\n", flush=True)
        show(
            "in the code", {one.label: one.covered(COEFFICIENTS[index]) for one in rows}, each=True
        )
        if options.held_out or not rows:
            continue
        for quantile in options.quantiles:
            coefficients = fitted_coefficients(rows, quantile)
            print(f"{quantile}: {np.round(coefficients, 2).tolist()}")
            known = {one.label: one.covered(np.round(coefficients, 2)) for one in rows}
            show("  fitted to all", known, each=quantile == options.quantiles[-1])
            show("  scene left out", left_out(rows, quantile))


def show(label: str, shares: dict[str, float], *, each: bool = False) -> None:
    """Mean, extremes and root mean square distance from 0.68."""
    if not shares:
        return
    values = np.array(list(shares.values()))
    off = np.sqrt(np.mean((values - 0.68) ** 2))
    print(
        f"{label}: mean {values.mean():.3f}, {values.min():.2f} to {values.max():.2f}, "
        f"off 0.68 by {off:.3f}",
        flush=True,
    )
    if each:
        for name, value in shares.items():
            print(f"    {name}: {value:.2f}")


if __name__ == "__main__":
    main()
