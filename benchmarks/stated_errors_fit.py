"""Makes the coefficients of `processing.ranges.stated_errors` again from path-traced scenes.

    python -m benchmarks.stated_errors_fit --cache DIR

The captures are those of `benchmarks.rendered_decomposition`, all scenes, baselines and conditions
that DIR holds; nothing is rendered. For each component the coefficients minimise the pinball loss
at a quantile of log |error|, every capture with the same weight. What they are worth is told by
leaving out one scene at a time: the share of pixels within the error, on a scene that the
coefficients do not know, is printed for each capture. There is no chance in it: the same captures
make the same numbers, which are those of `processing.ranges.stated_errors`.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, minimize

from benchmarks.rendered_captures import captures, kept_in
from benchmarks.rendered_scenes import BASELINES, HELD_OUT, TUNED_ON
from processing.ranges.decomposition import fit_ranges
from processing.ranges.result import NAMES
from processing.ranges.shares import unsharpness
from processing.ranges.stated_errors import COEFFICIENTS, SIGNS, defocus_px2

Array = NDArray[np.float64]

CONDITIONS = ("noise-free", "noisy", "blurred", "defocused")
QUANTILES = (0.75,)
# Every so many-th pixel: neighbours err alike.
_STEP = 17
_START, _BOUNDS = 0.3, (1e-3, 10.0)


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
        fitted.fits.colour(fitted.found, run.mask, lit, colour, unsharpness(blur))
        for colour, blur in enumerate(fitted.capture.blur)
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
            beyond_px2 = np.float32(defocus_px2(fitted.capture.blur[colour]))
            error = np.abs(one.components[index] - truth[..., colour])
            misfit = misfits[index]
            images = (error, one.noise_errors[index], misfit, *shared, beyond_px2 * misfit)
            rows.append(np.stack([image[where] / white for image in images]).astype(np.float64))
        values = np.concatenate(rows, axis=1)
        label = f"{scene}, {baseline}, {condition}: {name}"
        chosen.append(Samples(scene, label, values[0], values[1], values[2:]))
    return chosen


def fitted_coefficients(seen: list[Samples], quantile: float) -> Array:
    """(signs,), by Powell's method in the logarithms."""
    errors = [np.log(one.error[::_STEP] + 1e-7) for one in seen]
    weight = np.concatenate([np.full(len(one), 1 / len(one)) for one in errors]) / len(seen)
    error = np.concatenate(errors)
    noise2 = np.concatenate([one.noise[::_STEP] ** 2 for one in seen])
    signs2 = np.concatenate([one.signs[:, ::_STEP] ** 2 for one in seen], axis=1)

    def loss(logs: Array) -> float:
        """Mean pinball loss of log |error|, every capture with the same weight."""
        off = error - 0.5 * np.log(noise2 + np.exp(2 * logs) @ signs2 + 1e-18)
        return float(weight @ np.where(off > 0, quantile * off, (quantile - 1) * off))

    size = len(SIGNS)
    low, high = (np.full(size, np.log(end)) for end in _BOUNDS)
    found = minimize(
        loss, np.full(size, np.log(_START)), method="Powell", bounds=Bounds(low, high),
        options={"maxiter": 10, "xtol": 0.02, "ftol": 1e-4},
    )  # fmt: skip
    return np.exp(np.asarray(found.x))


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
    options = parser.parse_args()
    seen: dict[str, list[Samples]] = {name: [] for name in NAMES}
    for scene in (*TUNED_ON, *HELD_OUT):
        for baseline in BASELINES:
            for condition in options.conditions:
                if not kept_in(options.cache, scene, baseline, condition).exists():
                    continue
                for one in samples(scene, baseline, condition, options.cache):
                    seen[one.label.split(": ")[1]].append(one)
    report(seen, options.quantiles)


def report(seen: dict[str, list[Samples]], quantiles: list[float]) -> None:
    """Coefficients of each component, and what they cover."""
    for index, (name, rows) in enumerate(seen.items()):
        print(f"\n## {name}\n", flush=True)
        show("in the code", {one.label: one.covered(COEFFICIENTS[index]) for one in rows})
        for quantile in quantiles if rows else ():
            coefficients = np.round(fitted_coefficients(rows, quantile), 2)
            print(f"{quantile}: {coefficients.tolist()}")
            show("  fitted to all", {one.label: one.covered(coefficients) for one in rows})
            show("  scene left out", left_out(rows, quantile), each=True)


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
