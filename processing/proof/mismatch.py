"""Where frames differ from their predictions by more than noise and model allow.

The residual r of a right frame has the mean square

    ⟨r²⟩ = v (1 + Σ w² + (1 − Σ w)² μ) + u

in every part of the picture: v the noise of a frame, w the weights of its prediction, μ v the
variance of the mean, and u the variance that the prediction leaves, place by place
(`processing.proof.prediction`, `processing.proof.phases`). In a part that shows something else,
⟨r²⟩ exceeds this by the local contrast C times the mean square of the difference of the two codes,
which is between 0.2 and 4 for any two patterns worth showing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.proof.parts import Parts
from processing.proof.prediction import Array, Predictions, contrast_of

# Excess, in parts of the contrast, that movement, drift and flicker leave in a right frame: twice
# the most that was seen in 201 pitches of simulated benches with all of them.
TOLERATED = 0.02
# Part of the light by which a pattern and its complement miss white on a good bench.
ADDITIVE_WITHIN = 0.02
# Part by which a piece of the scene may move otherwise than the whole.
MOVED_OTHERWISE = 0.5
# And in one that is predicted by phases, which know the footprints of pixels only roughly.
INEXACT_AT = 0.5
# A place counts where its prediction leaves less of the local contrast than this; a part, where
# that part of its places do.
DETERMINED_AT = 0.15
LEAST_PLACES = 0.25
# Standard deviations of the noise's mean square, and of the shares of one part over the frames.
CERTAIN = 7.0
# A part whose share is less certain is not judged.
LEAST_CERTAIN = 0.15
FEWEST_PLACES = 8
# Part of the largest excess that a part has at least for the frame to be wrong there.
CORE = 0.1
# Of two patterns the codes differ by more: a part whose excess may be such is not judged.
TELLS_NOTHING = 1.5
FEWEST_FRAMES = 6
_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class Mismatch:
    """How far frames lie from their predictions.

    Parameters
    ----------
    share
        (frames,): excess of the whole frame, in parts of the contrast.
    places
        bool, (frames, n): places in parts that show something else.
    can_tell
        bool, (frames,): whether any part of the frame can be judged.
    contrast
        (n,): local contrast C of a pattern with |2c − 1| = 1.
    """

    share: Array
    places: NDArray[np.bool_]
    can_tell: NDArray[np.bool_]
    contrast: Array


def mismatch(
    predicted: Predictions,
    covariance: Array,
    trusted: NDArray[np.bool_],
    exact: NDArray[np.bool_],
    partitions: Sequence[Parts],
) -> Mismatch:
    """Look for parts of every frame that differ from its prediction.

    Parameters
    ----------
    predicted
        From the trusted frames.
    covariance
        (frames, frames), R of what the frames should show.
    trusted
        bool, (frames,).
    exact
        bool, (frames,), whose predictions hold for any scene; of the others only the whole is
        judged.
    partitions
        Ways to cut the picture; the first is the whole, the second says what is local.
    """
    n_frames = len(predicted.residuals)
    found: list[NDArray[np.bool_]] = []
    can_tell = np.zeros(n_frames, bool)
    power = np.diag(covariance)
    contrasts = [
        contrast_of(predicted.deviations, covariance, trusted, predicted.noise, parts)
        for parts in partitions
    ]
    local = contrasts[min(1, len(partitions) - 1)][partitions[min(1, len(partitions) - 1)].labels]
    certain = predicted.unexplained < DETERMINED_AT * np.outer(power, local)
    share = np.zeros(n_frames)
    for number, (parts, contrast) in enumerate(zip(partitions, contrasts, strict=True)):
        scale = np.maximum(np.outer(power, contrast), 1e-30)
        shares, deviations, usable = _shares(predicted, certain, scale, parts)
        if number > 0:
            usable &= exact[:, np.newaxis]
        inexact = ADDITIVE_WITHIN**2 * parts.means(predicted.mean**2)
        inexact = inexact + MOVED_OTHERWISE**2 * parts.means(predicted.moved**2)
        tolerated = TOLERATED + inexact / scale
        bound = _bounds(shares, tolerated + CERTAIN * deviations, usable, trusted)
        bound[~exact] = np.maximum(bound[~exact], INEXACT_AT)
        usable &= bound < TELLS_NOTHING
        wrong = usable & (shares > bound)
        excess = np.where(wrong, shares * scale, 0)
        # What is wrong elsewhere shines through everywhere: in the gain, in what is moved.
        wrong &= excess >= CORE * excess.max(axis=1, keepdims=True)
        found.append(wrong[:, parts.labels])
        can_tell |= usable.any(axis=1)
        if number == 0:
            share = shares[:, 0]
    return Mismatch(share, _where(found) & certain, can_tell, local)


def _where(found: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """The places in question, (frames, n): as closely as the ways to cut the picture tell."""
    whole = found[0].copy()
    for finer in found[1:]:
        closer = whole & finer
        told = closer.any(axis=1)
        whole[told] = closer[told]
        untold = ~whole.any(axis=1)
        whole[untold] = finer[untold]
    return whole


def _shares(
    predicted: Predictions, certain: NDArray[np.bool_], scale: Array, parts: Parts
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """(frames, parts): excess in parts of the contrast, its standard deviation from noise, use.

    Of the places whose prediction is certain.
    """
    gain = predicted.noise_gain
    counts = parts.sums(certain.astype(np.float64))
    usable = counts >= np.maximum(FEWEST_PLACES, LEAST_PLACES * _looked_at(predicted, parts))
    sizes = np.maximum(counts, 1)
    noise = certain * predicted.noise
    excess = predicted.residuals**2 - np.where(certain, predicted.unexplained, 0)
    shares = (parts.sums(excess * certain) - gain[:, np.newaxis] * parts.sums(noise)) / sizes
    rest = gain[:, np.newaxis] * np.sqrt(2 * parts.sums(noise**2)) / sizes
    deviations = rest / scale
    return shares / scale, deviations, usable & (deviations < LEAST_CERTAIN)


def _looked_at(predicted: Predictions, parts: Parts) -> Array:
    """(frames, parts): places for which there is a prediction at all."""
    return parts.sums(np.isfinite(predicted.unexplained).astype(np.float64))


def _bounds(
    shares: Array, least: Array, usable: NDArray[np.bool_], trusted: NDArray[np.bool_]
) -> Array:
    """(frames, parts): the excess up to which a frame counts as right, some at least."""
    bounds = least.copy()
    known = np.where(usable & trusted[:, np.newaxis], shares, np.nan)
    enough = np.isfinite(known).sum(axis=0) >= FEWEST_FRAMES
    if enough.any():
        middle = np.nanmedian(known[:, enough], axis=0)
        width = _MAD * np.nanmedian(np.abs(known[:, enough] - middle), axis=0)
        bounds[:, enough] = np.maximum(bounds[:, enough], middle + CERTAIN * width)
    return bounds
