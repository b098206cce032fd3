"""How often the standard errors of max/min hold on plateaus of any tilt.

    python -m benchmarks.plateau_coverage [--shifts 36 16 8] [--weights]

Every pixel sees half of the frames lit. Light that travelled tilts what they show: it falls from
one shift to the next by a part of the noise's deviation, in all by as much as the first line says,
straight or bent. Neither noise nor tilt are given to the estimator. `--weights` finds those of
`processing.frames.bias_reading` again.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.special import ndtr

from processing.frames.frame_noise import FrameNoise, FrameSample, noise_of
from processing.frames.noise_bias import extrema_correction, measured_kinds
from processing.frames.single_pitch import extrema_estimate
from processing.patterns import Family, Pattern

Array = NDArray[np.float64]
TILTS = (0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0)
# Of full scale squared, and per full scale: dark and lit frames alike, and 20 000 electrons.
SENSORS = {"even noise": FrameNoise(np.full(3, 1e-5), np.zeros(3))}
SENSORS["shot noise"] = FrameNoise(
    np.array([1, 0.5, 1]) * (5 / 20_000) ** 2, np.array([1, 0.5, 1]) / 20_000
)
SHAPE = (90, 120)


def errors(tilt: float, bend: float, shifts: int, noise: FrameNoise, seed: int) -> Array:
    """Error of the estimate over its standard error, (height, width, 3).

    Parameters
    ----------
    tilt
        By how much a plateau falls, in units of the noise at half of white.
    bend
        1 if straight, above if it is flat at its top.
    shifts
        Number of frames, even.
    noise
        Of a frame.
    seed
        Of all randomness.
    """
    rng = np.random.default_rng(seed)
    patterns = [Pattern(Family.STRIPES_COLUMNS, shifts // 2, 0, k) for k in range(shifts)]
    white = np.exp(rng.uniform(np.log(0.05), np.log(0.9), SHAPE))[..., np.newaxis]
    direct = white * rng.uniform(0.3, 1, (*SHAPE, 1))
    turn = (np.arange(shifts)[:, np.newaxis, np.newaxis] - rng.integers(0, shifts, SHAPE)) % shifts
    along = (turn % (shifts // 2)) / (shifts // 2 - 1)
    sign = np.where(turn < shifts // 2, 1.0, -1.0)[..., np.newaxis]
    fall = tilt * noise.deviation(white / 2) * along[..., np.newaxis] ** bend
    light = white / 2 + sign * (direct / 2 - fall)
    frames = light + noise.deviation(light) * rng.standard_normal(light.shape)
    lit = np.broadcast_to(white, (*SHAPE, 3)).astype(np.float32)
    sample = FrameSample.whole(patterns, frames.astype(np.float32))
    everywhere, variance = np.ones(SHAPE, bool), sample.noise_variance
    assert variance is not None
    measured = noise_of([variance], lit, everywhere)
    correction = extrema_correction(shifts)
    kinds = measured_kinds(sample, measured, everywhere, correction)
    plain = np.ptp(frames, axis=0).astype(np.float32)
    found = extrema_estimate(plain, lit, measured, correction, kinds=kinds)
    off: Array = (found.direct_light - np.ptp(light, axis=0)) / found.deviation
    return off


def plateaus(count: int) -> Array:
    """How far the lit frames lie below the brightest, in units of the noise, (plateaus, count)."""
    steps = np.arange(count)
    found = [np.zeros(count)]
    for tilt in (0.5, 1, 2, 3, 4, 6, 8, 10, 14, 20, 30, 60):
        found += [tilt * (steps / (count - 1)) ** bend for bend in (1, 2)]
    for part in (0.72, 0.5, 0.33, 0.22, 0.16, 0.11, 0.05):
        even = max(1, round(count * part))
        found += [step * np.maximum(steps - even + 1, 0) for step in (1.4, 2, 3, 6, 100)]
    return np.array(found)


def mean_largest(below: Array, deviation: float) -> Array:
    """Mean of the largest frame of each plateau, under noise."""
    at = deviation * np.linspace(-6, 7, 209)
    less = np.prod(ndtr((at + below[..., np.newaxis]) / deviation), axis=1)
    found: Array = at[0] + np.trapezoid(1 - less, at, axis=1)
    return found


def best_weights(count: int, most: float = 5.0) -> tuple[Array, float]:
    """Weights of both growths with the least error at the worst plateau, and that error."""
    below = plateaus(count)
    bias = mean_largest(below, 1.0)
    grown = np.stack([mean_largest(below, one) - bias for one in (np.sqrt(2.0), 3.0)], axis=1)
    error = np.ones((len(below), 1))
    bounds = np.vstack(
        [
            np.hstack([grown, -grown, -error]),
            np.hstack([-grown, grown, -error]),
            [[1.0, 1.0, 1.0, 1.0, 0.0]],
        ]
    )
    found = linprog(
        [0, 0, 0, 0, 1], A_ub=bounds, b_ub=np.concatenate([bias, -bias, [most]]), bounds=(0, None)
    )
    assert found.x is not None
    return found.x[:2] - found.x[2:4], float(found.x[4])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shifts", nargs="+", type=int, default=[36, 16, 8])
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--weights", action="store_true")
    options = parser.parse_args()
    if options.weights:
        for count in (18, 8, 4):
            weights, error = best_weights(count)
            print(f"{count} pairs: {weights[0]:.2f}, {weights[1]:.2f}, error {error:.3f}")
        return
    print("| tilt | " + " | ".join(f"{tilt:g}" for tilt in TILTS) + " |")
    for shifts in options.shifts:
        for name, noise in SENSORS.items():
            for bend, shape in ((1.0, "straight"), (2.0, "bent")):
                cells = []
                for tilt in TILTS:
                    off = errors(tilt, bend, shifts, noise, options.seed)
                    cells.append(f"{np.mean(np.abs(off) <= 1):.3f} ({off.mean():+.2f})")
                print(f"| {shifts} shifts, {name}, {shape} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
