"""What noise does to the largest and the smallest of many frames, and how to undo it.

A pixel with direct light D sees in frame k the light f_k = m + D s_k/2 + noise of deviation σ, with
s_k the contrast of the pattern at its place, scaled so that max s − min s = 2. The range
R = (max f − min f)/σ of n such frames is distributed as (David and Nagaraja, Order Statistics,
2003, section 2.3)

    P(R ≤ r) = Σ_k ∫ φ(x − μ_k) Π_{j ≠ k} [Φ(x + r − μ_j) − Φ(x − μ_j)] dx,    μ_k = δ s_k/2,

with δ = D/σ; where white W is known too and has noise of deviation τσ, max |2f − W|/σ as

    P(R ≤ r) = ∫ φ(w) Π_k [Φ((r − δ s_k + τw)/2) − Φ((−r − δ s_k + τw)/2)] dw,

and the amplitude of a sinusoid fitted by least squares as Rice's distribution. All lie above δ.
The interval of the δ at which an observed r is neither among the highest nor among the lowest
16 % (Neyman 1937) holds the truth at a rate of 68 % wherever that lies; its middle is the estimate,
nearly free of bias, its half width the standard error. Below δ = 0 both ends go on in straight
lines, such that the median of a pixel without direct light is taken for 0: estimates may be
negative.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import cos, deviate, exp, normal, sin

Array: TypeAlias = NDArray[np.float64]
Distribution: TypeAlias = Callable[[Array, Array], Array]

# δ beyond which everything only shifts along, and between which the tables are interpolated.
_DELTAS = np.concatenate([np.arange(0, 4, 0.4), [4, 5, 6, 8, 10, 13, 18, 28, 50, 120]])
# Φ(−1).
_TAIL = 0.15865525393145705
STEP = 0.02
_STEPS = 8
# Of Rice's distribution: parts of an integral, and how far noise reaches.
_PARTS, _FARTHEST = 40, 8.0
# Contrasts nearer than this are one and the same.
_SAME_CONTRAST = 1e-3


@dataclass(frozen=True, slots=True)
class IntervalTable:
    """Estimate and standard error of D/σ for an observed R.

    Parameters
    ----------
    middle, half
        float64, (k,), at R = 0, step, 2 step …; beyond the end the middle rises by as much as R.
    step
        Distance of the entries.
    """

    middle: Array
    half: Array
    step: float = STEP

    @classmethod
    def of(cls, distributions: Sequence[Distribution]) -> IntervalTable:
        """Table for a pixel that has any of some distributions, all equally likely.

        Parameters
        ----------
        distributions
            P(R ≤ r) of r and δ, arrays of one shape.
        """
        low, median, high = (_quantiles(distributions, p) for p in (_TAIL, 0.5, 1 - _TAIL))
        ratios = np.arange(0, high[-1] + STEP, STEP)
        fall = np.interp(median[0], low, _DELTAS) / max(high[0] - median[0], 1e-9)
        upper, lower = _inverse(ratios, low, fall), _inverse(ratios, high, fall)
        return cls((upper + lower) / 2, (upper - lower) / 2)

    def __call__(self, ratio: Array) -> tuple[Array, Array]:
        """Estimate and standard error of D/σ at R = `ratio`, any shape, ≥ 0."""
        end = (len(self.middle) - 1) * self.step
        held = np.minimum(ratio, end)
        at = np.arange(len(self.middle)) * self.step
        beyond = ratio - held
        return np.interp(held, at, self.middle) + beyond, np.interp(held, at, self.half)


def range_distribution(contrasts: Array) -> Distribution:
    """P(R ≤ r) of the range of frames with known contrasts.

    Parameters
    ----------
    contrasts
        (n,), s_k, n ≥ 2, not all alike; scaled here so that max − min = 2.
    """
    values, counts = _grouped(
        contrasts, np.ptp(contrasts), float(contrasts.max() + contrasts.min())
    )
    below = np.linspace(-6.0, 5.5, 34)

    def probability(r: Array, delta: Array) -> Array:
        r, delta = np.broadcast_arrays(r, delta)
        x = below - delta[..., np.newaxis] / 2
        product, rates = np.ones_like(x), np.zeros_like(x)
        for value, count in zip(values, counts, strict=True):
            at = x - delta[..., np.newaxis] * value / 2
            inside = np.maximum(normal(at + r[..., np.newaxis]) - normal(at), 1e-30)
            product *= _power(inside, count)
            rates += count * exp(-0.5 * at**2) / inside
        total = np.sum(product * rates, axis=-1)
        found: Array = total * (below[1] - below[0]) / np.sqrt(2 * np.pi)
        return found

    return probability


def complemented_distribution(contrasts: Array, white_deviation: float) -> Distribution:
    """P(R ≤ r) of max |2f − W|/σ.

    Parameters
    ----------
    contrasts
        (n,), s_k, not all 0; scaled here so that max |s| = 1.
    white_deviation
        τ, the standard deviation of W in units of σ.
    """
    values, counts = _grouped(contrasts, 2 * float(np.abs(contrasts).max()), 0.0)
    nodes = np.linspace(-8.0, 8.0, 33)
    weights = exp(-0.5 * nodes**2)
    shift = white_deviation * nodes

    def probability(r: Array, delta: Array) -> Array:
        product = np.ones((*r.shape, len(nodes)))
        for value, count in zip(values, counts, strict=True):
            off = shift - delta[..., np.newaxis] * value
            bound = r[..., np.newaxis]
            inside = normal((bound + off) / 2) - normal((off - bound) / 2)
            product *= _power(inside, count)
        found: Array = np.sum(product * weights, axis=-1) / weights.sum()
        return found

    return probability


def amplitude_distribution(r: Array, delta: Array) -> Array:
    """P(R ≤ r) of the length of a vector of length δ with unit noise along both axes (Rice)."""
    r, delta = (one[..., np.newaxis] for one in np.broadcast_arrays(r, delta))
    # Along the other axis, at the middles of equal parts: of the angle where r is short, so that
    # nothing ends abruptly, else of the length as far as there is any noise.
    parts = (np.arange(_PARTS) + 0.5) / _PARTS
    near = r < _FARTHEST
    aside = np.where(near, r * sin(np.pi / 2 * parts), _FARTHEST * parts)
    width = np.where(near, np.pi / 2 * r * cos(np.pi / 2 * parts), _FARTHEST) / _PARTS
    reach = np.sqrt(np.maximum(r**2 - aside**2, 0))
    inside = normal(reach - delta) - normal(-reach - delta)
    total = np.sum(width * exp(-0.5 * aside**2) * inside, axis=-1)
    found: Array = total * np.sqrt(2 / np.pi)
    return found


def _power(values: Array, count: int) -> Array:
    """Values to the power of a count ≥ 1, by products alone."""
    found, square = np.ones_like(values), values
    while count:
        found = found * square if count % 2 else found
        count //= 2
        square = square * square
    return found


def mean_range(distribution: Distribution) -> tuple[Array, Array]:
    """δ, and the mean of R at each."""
    ratios = np.linspace(-6, 10, 65)
    below = distribution(np.maximum(_DELTAS[:, np.newaxis] + ratios, 0), _DELTAS[:, np.newaxis])
    below = np.where(_DELTAS[:, np.newaxis] + ratios > 0, below, 0)
    total = np.trapezoid(1 - below, dx=ratios[1] - ratios[0], axis=1)
    return _DELTAS, _DELTAS + ratios[0] + total


def mean_extrema(contrasts: Array) -> tuple[Array, Array]:
    """δ, and the mean of the range R of frames with known contrasts at each.

    The same as `mean_range` in less time. The mean of a difference is that of its parts,
    ∫ [1 − Π_k Φ(x − μ_k)] dx for the largest frame.
    """
    values, counts = _grouped(
        contrasts, np.ptp(contrasts), float(contrasts.max() + contrasts.min())
    )
    # From the brightest frame, below and above which the largest hardly ever lies.
    beside = np.linspace(-6.0, 7.0, 105)
    total = _DELTAS + 2 * beside[0]
    x = beside + _DELTAS[:, np.newaxis] / 2
    for side in (values, -values):
        below = np.ones_like(x)
        for value, count in zip(side, counts, strict=True):
            below *= _power(normal(x - _DELTAS[:, np.newaxis] * value / 2), count)
        total += np.trapezoid(1 - below, dx=beside[1] - beside[0], axis=1)
    return _DELTAS, total


def _grouped(contrasts: Array, span: float, twice_middle: float) -> tuple[Array, NDArray[np.int_]]:
    """Different contrasts, scaled, and how many frames have each."""
    if contrasts.ndim != 1 or contrasts.size < 1 or not span > 0:
        raise ValueError(
            f"contrasts of shape {contrasts.shape} span {span:g}: extrema need frames that differ"
        )
    scaled = (2 * contrasts - twice_middle) / span
    rounded = np.rint(scaled / _SAME_CONTRAST)
    values, counts = np.unique(rounded, return_counts=True)
    return values * _SAME_CONTRAST, counts


def _quantiles(distributions: Sequence[Distribution], probability: float) -> Array:
    """R at which the mean of the distributions reaches a probability, for every δ."""

    def reached(r: Array) -> Array:
        mean = np.mean([one(r, _DELTAS) for one in distributions], axis=0)
        return deviate(np.clip(mean, 1e-12, 1 - 1e-12)) - deviate(probability)

    # The normal deviate of a probability is nearly straight in R: false position (Illinois).
    low, high = np.maximum(_DELTAS - 6, 0), _DELTAS + 12
    at_low, at_high = reached(low), reached(high)
    for _ in range(_STEPS):
        middle = low + (high - low) * at_low / (at_low - at_high)
        found = reached(middle)
        above = found >= 0
        at_low = np.where(above, at_low / 2, found)
        at_high = np.where(above, found, at_high / 2)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    middle = low + (high - low) * at_low / (at_low - at_high)
    quantiles: Array = np.maximum.accumulate(middle)
    return quantiles


def _inverse(ratios: Array, quantiles: Array, fall: float) -> Array:
    """δ of which a ratio is the quantile, continued to both sides in straight lines."""
    found: Array = np.interp(ratios, quantiles, _DELTAS)
    found += np.maximum(ratios - quantiles[-1], 0) - fall * np.maximum(quantiles[0] - ratios, 0)
    return found
