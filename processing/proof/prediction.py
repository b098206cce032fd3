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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import inner, product, solved
from processing.patterns import Family, Pattern
from processing.proof.gains import GAIN_BOUNDS, joint_gains, pair_gains, whole_light
from processing.proof.parts import Parts
from processing.proof.sample_noise import FEWEST_PAIRS, SampleNoise

Array = NDArray[np.float64]
Samples = NDArray[np.float32]

# Noise over contrast that is assumed at least: keeps the covariance of complements invertible.
LEAST_NUGGET = 1e-3
COMPLEMENT = -0.999
# A linear prediction that holds less of the contrast is not exact.
EXACT_FROM = 0.97


@dataclass(frozen=True, slots=True)
class Predictions:
    """Frames and what the others say about them.

    Parameters
    ----------
    mean
        float64, (n,): m, the mean of white and black, by these frames.
    deviations
        float64, (frames, n): frames in the light of the mean, less m.
    residuals
        float64, (frames, n): deviations less what the trusted others predict and what is moved.
    moved
        float64, (frames, n): what a movement of the scene explains of them.
    weights
        float64, (frames, frames): row k predicts frame k; 0 where a frame is not trusted.
    explained
        (frames,): part of a right frame's contrast that its prediction holds, in [0, 1].
    unexplained
        float64, (frames, n): variance of a right frame about its prediction, without noise.
    gains
        (frames,): lamp and exposure against the mean.
    noise
        (n,): variance of a frame's noise where its light is m.
    noise_gain
        (frames,): variance of a residual's noise in parts of that, at least 1.
    contrast
        Mean square of the deviations of a pattern with |2c − 1| = 1, noise taken off; ≥ 0.
    """

    mean: Array
    deviations: Array
    residuals: Array
    moved: Array
    weights: Array
    explained: Array
    unexplained: Array
    gains: Array
    noise: Array
    noise_gain: Array
    contrast: float

    def expected(self, k: int) -> Array:
        """Deviations that the others predict of frame k, (n,)."""
        expected: Array = self.deviations[k] - self.residuals[k]
        return expected


def code_covariance(codes: Array) -> Array:
    """R of codes, (frames, projector pixels), each in [0, 1]."""
    signs = 2 * codes - 1
    covariance: Array = signs @ signs.T / codes.shape[1]
    return covariance


def pattern_covariance(patterns: Sequence[Pattern], projector_px: tuple[int, int]) -> Array:
    """R of patterns of one family and pitch over whole periods, (frames, frames).

    That of checkers is the product of those along both directions.

    Parameters
    ----------
    patterns
        What is shown.
    projector_px
        (height, width), beyond which no period is seen.
    """
    period = 2 * max(pattern.pitch_px for pattern in patterns)
    height, width = (min(period, side) for side in projector_px)
    down, right = _codes(patterns, (height, 1)), _codes(patterns, (1, width))
    if patterns[0].family is Family.CHECKER:
        corner = 2 * _codes(patterns, (1, 1)) - 1
        product = code_covariance(down) * code_covariance(right) * (corner @ corner.T)
        return np.asarray(product, np.float64)
    return code_covariance(down if patterns[0].family.varies_down else right)


def _codes(patterns: Sequence[Pattern], shape: tuple[int, int]) -> Array:
    return np.stack([pattern.code(shape).ravel() for pattern in patterns])


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
    noise: SampleNoise,
    anchor: Array | None,
    slopes: Array,
) -> Predictions:
    """Predict every frame from the trusted others.

    Parameters
    ----------
    frames
        float32, (frames, n), linear light of n places, that of black taken off.
    covariance
        (frames, frames), R of what the frames should show.
    trusted
        bool, (frames,), which may predict others.
    noise
        Of a sample.
    anchor
        (n,), half of white less black; three or more complementary pairs give a better mean.
    slopes
        (4, n), as for `movements`.
    """
    if covariance.shape != (len(frames), len(frames)) or trusted.shape != (len(frames),):
        raise ValueError(f"{len(frames)} frames, but R {covariance.shape}, trust {trusted.shape}")
    values = frames.astype(np.float64)
    middle = _middle(values, covariance, trusted, anchor)
    variance = noise.at(middle)
    contrast = _whole_contrast(values - middle, covariance, trusted, variance)
    nugget = max(float(variance.mean()) / contrast, LEAST_NUGGET) if contrast > 0 else 1.0
    weights, explained = _weights(covariance, trusted, nugget)
    pairs = [pair for pair in complements(covariance) if trusted[list(pair)].all()]
    # The mean of frames of unequal light knows less of it than white.
    due = middle if anchor is None else anchor
    exact = bool(explained.min() >= EXACT_FROM)
    gains = _gains(values, due, pairs, weights, trusted if exact else None)
    if anchor is None and trusted.any():
        gains = gains / np.median(gains[trusted])
    values /= gains[:, np.newaxis]
    middle = _middle(values, covariance, trusted, anchor)
    deviations = values - middle
    contrast = _whole_contrast(deviations, covariance, trusted, variance)
    residuals = deviations - weights @ deviations
    left, moved = contrast * np.diag(covariance) * (1 - explained), movements(residuals, slopes)
    return Predictions(
        mean=middle,
        deviations=deviations,
        residuals=residuals - moved,
        moved=moved,
        weights=weights,
        explained=explained,
        unexplained=np.outer(left, np.ones(len(middle))),
        gains=gains,
        noise=variance,
        noise_gain=_noise_gain(weights, len(pairs), anchor is not None),
        contrast=contrast,
    )


def _gains(
    values: Array,
    due: Array,
    pairs: Sequence[tuple[int, int]],
    weights: Array,
    exact: NDArray[np.bool_] | None,
) -> Array:
    """Lamp and exposure of each frame; `exact`: the trusted ones, where all predict each other."""
    singles = whole_light(values, due)
    if not pairs and exact is not None:
        singles = joint_gains(values, due, weights, exact, singles)
    return pair_gains(values, due, pairs, singles)


def movements(residuals: Array, slopes: Array) -> Array:
    """What a movement of the scene explains of residuals, (…, n).

    A picture f that moved by a part δ of a pixel is (1 − δ) f + δ f' with its neighbour f', and one
    that lost focus is like it. The sum of a pattern and its complement, and what a prediction
    leaves, differ as the mean picture does.

    Parameters
    ----------
    residuals
        (…, n).
    slopes
        (4, n): the mean picture above, below, left and right of a place, less that at it.
    """
    shifts = residuals @ slopes.T @ np.linalg.pinv(slopes @ slopes.T, hermitian=True)
    moved: Array = shifts @ slopes
    return moved


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
        weights[others] = solved(among, covariance[others, frame])
    own = float(covariance[frame, frame])
    left = own - 2 * inner(weights, covariance[frame])
    left += inner(weights, product(covariance, weights))
    return weights, float(np.clip(1 - left / own, 0, 1))


def _middle(
    frames: Array,
    covariance: Array,
    trusted: NDArray[np.bool_],
    anchor: Array | None,
) -> Array:
    """m, of white and black or of the frames."""
    pairs = [pair for pair in complements(covariance) if trusted[list(pair)].all()]
    if len(pairs) >= FEWEST_PAIRS:
        sums = np.stack([frames[first] + frames[second] for first, second in pairs])
        if anchor is not None:
            sums = np.concatenate([sums, 2 * anchor[np.newaxis], 2 * anchor[np.newaxis]])
        # The median stands a minority of wrong pairs.
        typical: Array = np.median(sums, axis=0) / 2
        low, high = GAIN_BOUNDS
        # Where most pairs are wrong white and black are not outvoted: no lamp changes so much.
        if anchor is None or low < typical.mean() / max(anchor.mean(), 1e-30) < high:
            return typical
    if anchor is not None:
        return anchor
    members = [k for pair in pairs for k in pair] or list(np.flatnonzero(trusted))
    members = members or list(range(len(frames)))
    total: Array = frames[members].mean(axis=0)
    return total


def contrast_of(
    deviations: Array, covariance: Array, trusted: NDArray[np.bool_], noise: Array, parts: Parts
) -> Array:
    """Mean square deviation of a pattern with |2c − 1| = 1, noise taken off, of each part; ≥ 0.

    From what the frames differ from each other by: an error of the mean, that all share, is no
    contrast. With P = 1 − 1/N the deviations Pe have the mean squares C (P R P)_kk + v (1 − 1/N).

    Parameters
    ----------
    deviations
        (frames, n).
    covariance
        (frames, frames), R.
    trusted
        bool, (frames,): of these, the median counts.
    noise
        (n,), variance of a frame.
    """
    chosen = trusted if trusted.any() else np.ones_like(trusted)
    number = int(chosen.sum())
    own, among = deviations[chosen], covariance[np.ix_(chosen, chosen)]
    if number > 1:
        own = own - own.mean(axis=0)
        centred = np.eye(number) - 1 / number
        among = centred @ among @ centred
    left = 1 - 1 / number if number > 1 else 1.0
    squares = parts.means(own**2) - left * parts.means(noise)
    power = np.maximum(np.diag(among), 1e-3 * np.diag(covariance)[chosen])
    contrast: Array = np.median(squares / power[:, np.newaxis], axis=0)
    return np.maximum(contrast, 0)


def _whole_contrast(
    deviations: Array, covariance: Array, trusted: NDArray[np.bool_], noise: Array
) -> float:
    whole = Parts.whole(deviations.shape[1])
    return float(contrast_of(deviations, covariance, trusted, noise, whole)[0])


def _weights(covariance: Array, trusted: NDArray[np.bool_], nugget: float) -> tuple[Array, Array]:
    n_frames = len(covariance)
    weights = np.zeros((n_frames, n_frames))
    explained = np.zeros(n_frames)
    for k in range(n_frames):
        others = trusted.copy()
        others[k] = False
        weights[k], explained[k] = weights_for(k, covariance, others, nugget)
    return weights, explained


def _noise_gain(weights: Array, n_pairs: int, is_anchored: bool) -> Array:
    """1 + Σ w² + (1 − Σ w)² μ, with μ v the variance of m.

    The median of p sums of two frames, half of it taken, has μ = π/(4 p), half of white ½.
    """
    few = 0.5 if is_anchored else 0.0
    mean = np.pi / (4 * n_pairs) if n_pairs >= FEWEST_PAIRS else few
    gain: Array = 1 + np.sum(weights**2, axis=1) + (1 - weights.sum(axis=1)) ** 2 * mean
    return gain
