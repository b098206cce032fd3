"""Where frames differ from their predictions by more than noise and model allow.

The residual r of a right frame has the mean square

    ⟨r²⟩ = v (1 + Σ w² + (1 − Σ w)² μ) + u

in every part of the picture: v the noise of a frame, w the weights of its prediction, μ v the
variance of the mean, and u the variance that the prediction leaves, place by place
(`processing.prediction`, `processing.phases`). In a part that shows something else, ⟨r²⟩ exceeds
this by the local contrast C times the mean square of the difference of the two codes, which is
between 0.2 and 4 for any two patterns worth showing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.parts import Parts
from processing.prediction import Array, Predictions

# Excess, in parts of the contrast, that movement, drift and flicker leave at most in a right frame.
TOLERATED = 0.12
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
    n_frames, n = predicted.residuals.shape
    places = np.zeros((n_frames, n), bool)
    can_tell = np.zeros(n_frames, bool)
    power = np.diag(covariance)
    contrasts = [_contrast(predicted, power, trusted, parts) for parts in partitions]
    local = contrasts[min(1, len(partitions) - 1)][partitions[min(1, len(partitions) - 1)].labels]
    certain = predicted.unexplained < DETERMINED_AT * np.outer(power, local)
    share = np.zeros(n_frames)
    for number, (parts, contrast) in enumerate(zip(partitions, contrasts, strict=True)):
        scale = np.maximum(np.outer(power, contrast), 1e-30)
        shares, deviations, usable = _shares(predicted, certain, scale, parts)
        if number > 0:
            usable &= exact[:, np.newaxis]
        bound = _bounds(shares, deviations, usable, trusted)
        bound[~exact] = np.maximum(bound[~exact], INEXACT_AT)
        places |= (usable & (shares > bound))[:, parts.labels]
        can_tell |= usable.any(axis=1)
        if number == 0:
            share = shares[:, 0]
    return Mismatch(share, places & certain, can_tell, local)


def _contrast(
    predicted: Predictions, power: Array, trusted: NDArray[np.bool_], parts: Parts
) -> Array:
    """(parts,): median over the frames of the mean square deviation, noise taken off."""
    chosen = trusted if trusted.any() else np.ones_like(trusted)
    squares = parts.means(predicted.deviations[chosen] ** 2) - parts.means(predicted.noise)
    contrast: Array = np.median(squares / power[chosen, np.newaxis], axis=0)
    return np.maximum(contrast, 0)


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
    shares: Array, deviations: Array, usable: NDArray[np.bool_], trusted: NDArray[np.bool_]
) -> Array:
    """(frames, parts): the excess up to which a frame counts as right."""
    bounds = TOLERATED + CERTAIN * deviations
    known = np.where(usable & trusted[:, np.newaxis], shares, np.nan)
    enough = np.isfinite(known).sum(axis=0) >= FEWEST_FRAMES
    if enough.any():
        middle = np.nanmedian(known[:, enough], axis=0)
        width = _MAD * np.nanmedian(np.abs(known[:, enough] - middle), axis=0)
        bounds[:, enough] = np.maximum(bounds[:, enough], middle + CERTAIN * width)
    return bounds
