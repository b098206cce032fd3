"""Lamp and exposure of each frame of a pitch against the mean of white and black."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A lamp does not change by more from one frame to the next of a pitch.
GAIN_BOUNDS = 0.6, 1.6
_ROUNDS = 3
_FEWEST_LIT = 0.05
_TIE = 1e-3


def whole_light(values: Array, mean: Array) -> Array:
    """Light of whole frames, (frames, n), over that of the mean, (frames,).

    That of a pattern, as far as its cells are many; the median over the frames otherwise.
    """
    light = values.sum(axis=1) / max(float(mean.sum()), 1e-30)
    return np.asarray(np.clip(light, *GAIN_BOUNDS), np.float64)


def joint_gains(
    values: Array, mean: Array, weights: Array, trusted: NDArray[np.bool_], usual: Array
) -> Array:
    """Gains of frames that predict each other exactly, (frames,), all by least squares.

    The residuals of the predictions are A(f/g − m) with A = 1 − W. With a = 1/g that is

        ((AᵀA) ∘ ⟨f f⟩) a = (AᵀA 1) ∘ ⟨f m⟩,

    held by a weak tie to what they usually are: equations that leave gains open are no rarity.

    Parameters
    ----------
    values
        (frames, n).
    mean
        (n,).
    weights
        W, (frames, frames).
    trusted
        bool, (frames,): the others have their usual gains.
    usual
        (frames,).
    """
    ties = (np.eye(len(weights)) - weights)[trusted]
    normal = ties.T @ ties
    gram = values @ values.T
    tie = _TIE * np.diag(gram)
    right = normal.sum(axis=1) * (values @ mean) + tie / usual
    inverse = np.linalg.lstsq(normal * gram + np.diag(tie), right, rcond=None)[0]
    low, high = GAIN_BOUNDS
    return np.asarray(1 / np.clip(inverse, 1 / high, 1 / low), np.float64)


def pair_gains(
    values: Array, mean: Array, pairs: Sequence[tuple[int, int]], singles: Array
) -> Array:
    """Light of each frame against the mean, (frames,): medians over places that it lights.

    Where a frame is the brighter one of a pair, f_k/g_k = 2m − f_k'/g_k'. The median stands frames
    that are wrong at less than half of these places. Beside pairs, single frames have their usual
    light: predictions that are not exact are no measure of it.

    Parameters
    ----------
    values
        (frames, n).
    mean
        (n,).
    pairs
        Complementary frames.
    singles
        (frames,): gains of frames without a complement where there are no pairs at all.
    """
    gains = np.ones(len(values))
    for _ in range(_ROUNDS if pairs else 0):
        for first, second in pairs:
            for k, other in ((first, second), (second, first)):
                lit = values[k] > values[other]
                due = 2 * mean - values[other] / gains[other]
                gains[k] = _ratio(values[k], due, lit & (due > mean))
    members = [k for pair in pairs for k in pair]
    alone = sorted(set(range(len(values))) - set(members))
    gains[alone] = float(np.median(gains[members])) if members else singles[alone]
    return gains


def fitted_gain(light: Array, due: Array, variance: Array) -> float:
    """Gain of a frame by least squares, (n,) each: its light against what is due, and how well.

    Parameters
    ----------
    light
        Of the frame.
    due
        What a gain of 1 lets expect; places that count for nothing have an infinite variance.
    variance
        Of the difference.
    """
    weight = 1 / variance
    power = float(np.sum(weight * due**2))
    if power <= 0:
        return 1.0
    return float(np.clip(np.sum(weight * due * light) / power, *GAIN_BOUNDS))


def _ratio(light: Array, due: Array, chosen: NDArray[np.bool_]) -> float:
    if chosen.sum() < _FEWEST_LIT * len(light):
        return 1.0
    return float(np.clip(np.median(light[chosen] / due[chosen]), *GAIN_BOUNDS))
