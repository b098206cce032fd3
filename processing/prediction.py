"""What a frame ought to look like, predicted from the other frames of its kind.

Light transport is linear: a frame is f = m + ½ T(2c − 1) with the code c of its pattern, the mean
m of white and black, and the unknown transport T of the scene. Averaged over a scene, two frames'
deviations e = f − m therefore correlate as their codes do,

    R_ij = ⟨(2c_i − 1)(2c_j − 1)⟩ over the projector's pixels,

and the best linear prediction of one frame from others is the conditional mean of a process with
covariance R + τ (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, eq. 2.25),
pixel by pixel with the same weights. Where the complement of a pattern was captured it has
R = −1 and predicts the frame exactly, whatever the scene is; without one, neighbours in shift do
as well as they can, and it is known how well that is. With Q = (R + τ)⁻¹ every frame's prediction
from all the others leaves the residual (Q e)_k/Q_kk (ibid., eq. 5.12).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Samples = NDArray[np.float32]

# Noise over contrast that is assumed at least: keeps the covariance of complements invertible.
LEAST_NUGGET = 1e-3
# A lamp does not change by more from one frame to the next of a pitch.
GAIN_BOUNDS = 0.6, 1.6
COMPLEMENT = -0.999


@dataclass(frozen=True, slots=True)
class Predictions:
    """Frames and what the others say about them.

    Parameters
    ----------
    mean
        float64, (n,): m, the mean of white and black, by these frames.
    deviations
        float64, (frames, n): frames in the light of the typical frame, less m.
    residuals
        float64, (frames, n): deviations less what the trusted others predict.
    weights
        float64, (frames, frames): row k predicts frame k; 0 where a frame is not trusted.
    explained
        (frames,): part of a right frame's contrast that its prediction holds, in [0, 1].
    gains
        (frames,): lamp and exposure against the typical frame.
    noise
        Variance of a sample's noise.
    contrast
        Mean square of the deviations of a pattern with |2c − 1| = 1, noise taken off; ≥ 0.
    """

    mean: Array
    deviations: Array
    residuals: Array
    weights: Array
    explained: Array
    gains: Array
    noise: float
    contrast: float


def code_covariance(codes: Array) -> Array:
    """R of codes, (frames, projector pixels), each in [0, 1]."""
    signs = 2 * codes - 1
    covariance: Array = signs @ signs.T / codes.shape[1]
    return covariance


def complements(covariance: Array) -> list[tuple[int, int]]:
    """Pairs of frames whose patterns are complements of each other, each frame at most once."""
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.maximum(np.outer(scale, scale), 1e-12)
    pairs: list[tuple[int, int]] = []
    free = np.ones(len(covariance), bool)
    for first in range(len(covariance)):
        partners = np.flatnonzero(free & (correlation[first] < COMPLEMENT))
        if free[first] and partners.size:
            pairs.append((first, int(partners[0])))
            free[[first, partners[0]]] = False
    return pairs


def predict(
    frames: Samples,
    covariance: Array,
    trusted: NDArray[np.bool_],
    noise: float,
    mean: Array | None,
) -> Predictions:
    """Predict every frame from the trusted others.

    Parameters
    ----------
    frames
        float32, (frames, n), linear light of n places.
    covariance
        (frames, frames), R of what the frames should show.
    trusted
        bool, (frames,), which may predict others.
    noise
        Variance of a sample's noise.
    mean
        (n,), half of white and black; where complements were captured, they give a better one.
    """
    if covariance.shape != (len(frames), len(frames)) or trusted.shape != (len(frames),):
        raise ValueError(f"{len(frames)} frames, but R {covariance.shape}, trust {trusted.shape}")
    middle = _middle(frames, covariance, trusted, mean)
    values = frames.astype(np.float64)
    contrast = _contrast(values - middle, covariance, trusted, noise)
    nugget = max(noise / contrast, LEAST_NUGGET) if contrast > 0 else 1.0
    weights, explained = _weights(covariance, trusted, nugget)
    gains = _gains(values, middle, weights, trusted)
    values /= gains[:, np.newaxis]
    middle = _middle(values, covariance, trusted, mean)
    deviations = values - middle
    return Predictions(
        mean=middle,
        deviations=deviations,
        residuals=deviations - weights @ deviations,
        weights=weights,
        explained=explained,
        gains=gains,
        noise=noise,
        contrast=_contrast(deviations, covariance, trusted, noise),
    )


def weights_for(
    frame: int, covariance: Array, others: NDArray[np.bool_], nugget: float
) -> tuple[Array, float]:
    """How the deviation of one frame follows from those of others.

    Parameters
    ----------
    frame
        Which is predicted.
    covariance
        (frames, frames), R of what the frames should show.
    others
        bool, (frames,), from which it is predicted; without `frame` itself.
    nugget
        τ: variance of the noise in parts of the contrast, > 0.

    Returns
    -------
    (frames,), 0 where a frame is not used; and the part of the contrast of the frame that its
    prediction holds, in [0, 1].
    """
    weights = np.zeros(len(covariance))
    if others.any():
        among = covariance[np.ix_(others, others)] + nugget * np.eye(int(others.sum()))
        weights[others] = np.linalg.solve(among, covariance[others, frame])
    own = float(covariance[frame, frame])
    left = own - 2 * float(weights @ covariance[frame]) + float(weights @ covariance @ weights)
    return weights, float(np.clip(1 - left / own, 0, 1))


def pair_noise(frames: Samples, covariance: Array) -> float | None:
    """Variance of a sample's noise from the sums of complementary pairs; None below three pairs.

    All the sums are white plus black. Each is scaled to the level of their median; the median
    over the pairs stands a minority of wrong frames.
    """
    sums = [frames[i].astype(np.float64) + frames[j] for i, j in complements(covariance)]
    if len(sums) < 3:
        return None
    stack = np.stack(sums)
    levels = stack.mean(axis=1)
    stack *= (np.median(levels) / np.maximum(levels, 1e-9))[:, np.newaxis]
    typical = np.median(stack, axis=0)
    # The median of n values has π/(2n) of the variance of one (less so for few: on the safe side).
    own = 1 - 1 / len(sums)
    return float(np.median(np.mean((stack - typical) ** 2, axis=1)) / (2 * own))


def _middle(
    frames: NDArray[np.floating],
    covariance: Array,
    trusted: NDArray[np.bool_],
    mean: Array | None,
) -> Array:
    pairs = [pair for pair in complements(covariance) if trusted[list(pair)].all()]
    members = [k for pair in pairs for k in pair]
    if not members:
        if mean is not None:
            return mean
        members = list(np.flatnonzero(trusted))
    total: Array = frames[members].mean(axis=0, dtype=np.float64)
    return total


def _contrast(
    deviations: Array, covariance: Array, trusted: NDArray[np.bool_], noise: float
) -> float:
    power = np.mean(deviations[trusted] ** 2, axis=1) - noise
    return max(float(np.median(power / np.diag(covariance)[trusted])), 0.0)


def _weights(covariance: Array, trusted: NDArray[np.bool_], nugget: float) -> tuple[Array, Array]:
    n_frames = len(covariance)
    weights = np.zeros((n_frames, n_frames))
    explained = np.zeros(n_frames)
    for k in range(n_frames):
        others = trusted.copy()
        others[k] = False
        weights[k], explained[k] = weights_for(k, covariance, others, nugget)
    return weights, explained


def _gains(values: Array, mean: Array, weights: Array, trusted: NDArray[np.bool_]) -> Array:
    """Gains that let frames and their predictions agree best, in the mean 1.

    With x = 1/gain the residuals are A(x f − m), A = 1 − weights; least squares in x.
    """
    n_frames, n = values.shape
    residual = (np.eye(n_frames) - weights)[trusted]
    inner = residual.T @ residual
    power = float(mean @ mean) / n
    left = inner * (values @ values.T) / n + 1e-3 * power * np.eye(n_frames)
    right = inner.sum(axis=1) * (values @ mean) / n + 1e-3 * power
    inverse = np.linalg.solve(left, right)
    low, high = GAIN_BOUNDS
    gains = np.clip(1 / np.clip(inverse, 1 / high, 1 / low), low, high)
    gains[~trusted] = 1.0
    scaled: Array = gains / np.median(gains[trusted]) if trusted.any() else gains
    return scaled
