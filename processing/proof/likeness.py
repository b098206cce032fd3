"""How far pictures lie from those that were taken before them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.proof.gains import GAIN_BOUNDS
from processing.proof.prediction import Array, Predictions, Samples, complements

# Changes that the noise hides to this part of what is expected are no figure.
LEAST_SEEN = 0.15


@dataclass(frozen=True, slots=True)
class Before:
    """Frames, (frames, n), with the pictures before them; see `processing.proof.showing.Kind`."""

    frames: Samples
    before: Samples
    before_index: NDArray[np.int64]
    covariance: Array
    change: Array


def changes(predicted: Predictions, trusted: NDArray[np.bool_], seen: Before) -> Array:
    """Change from the picture before in parts of the expected one; NaN where it is too small.

    The picture before is the one that was taken, or the one that its pattern should have given
    where that is known: what was taken before may have been wrong itself.
    """
    n_frames, n = seen.frames.shape
    noise = float(predicted.noise.mean())
    expected = predicted.contrast * seen.change
    power = distance(seen.frames, seen.before) - 2 * noise
    pairs = complements(seen.covariance)
    partner = dict(pairs) | {second: first for first, second in pairs}
    for k in range(n_frames):
        j = int(seen.before_index[k])
        if j >= 0 and not trusted[j]:
            power[k] = np.nan
        other = partner.get(j, k)
        if other != k and trusted[other]:
            due = predicted.mean - predicted.deviations[other]
            away = distance(seen.frames[k : k + 1], due[np.newaxis])[0]
            power[k] = np.fmin(power[k], away - 2 * noise)
    # Six standard deviations of the noise's mean square.
    visible = expected > 6 * 2 * noise * np.sqrt(2 / n) / LEAST_SEEN
    changes: Array = np.where(visible, power / np.maximum(expected, 1e-30), np.nan)
    return changes


def distance(frames: NDArray[np.floating], others: NDArray[np.floating]) -> Array:
    """Mean square difference of pictures, (frames, n), the others in the light that suits best."""
    first, second = frames.astype(np.float64), others.astype(np.float64)
    scale = np.sum(first * second, axis=1) / np.maximum(np.sum(second**2, axis=1), 1e-30)
    first -= np.clip(scale, *GAIN_BOUNDS)[:, np.newaxis] * second
    power: Array = np.mean(first**2, axis=1)
    return power
