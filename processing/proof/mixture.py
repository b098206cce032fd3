"""How much of the picture before is mixed into a frame.

A projector that was still changing, or an exposure that began too early, gives (1 − s) own + s X
with the picture X before. The residual r of a frame's prediction is then s (X − own), less what a
gain of the lamp (along own and mean) and a movement of the scene (along the slopes of the mean)
explain as well. By least squares, with what is along those taken off X − own, (X − own)⊥,

    s = ⟨r, (X − own)⊥⟩ / |(X − own)⊥|²,   σ_s² = v / |(X − own)⊥|²,

place by place in parts of the variance v of the residual. A small s over a whole frame is found
that leaves no part of it far off: the square of it counts there. Uniform light, white and black, is
not told from the lamp's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.proof.prediction import Array, Predictions

# Share that movement from frame to frame leaves at most in right frames, twice what was seen.
LEAST_SHARE = 0.08
CERTAIN = 7.0
# Part of |X − own|² that must be left for s to be told from gain and movement.
LEAST_LEFT = 0.1
FEWEST_FRAMES = 6
_MAD = 1.4826


@dataclass(frozen=True, slots=True)
class Mixture:
    """The picture before in the frames of a pitch; NaN where it cannot be told.

    Parameters
    ----------
    share, error
        s and σ_s, (frames,).
    """

    share: Array
    error: Array

    def excess(self, trusted: NDArray[np.bool_]) -> Array:
        """By what s exceeds what it may be in a right frame, in σ, (frames,); −∞ where unknown.

        All frames of a pitch bear alike what moves from one of them to the next.
        """
        known = np.isfinite(self.share)
        error = self.error
        alike = np.abs(self.share[known & trusted])
        if alike.size >= FEWEST_FRAMES:
            error = np.maximum(error, _MAD * float(np.median(alike)))
        beyond = (self.share - LEAST_SHARE) / np.maximum(error, 1e-9) - CERTAIN
        return np.where(known, beyond, -np.inf)


def mixture(predicted: Predictions, before: Sequence[Array | None], slopes: Array) -> Mixture:
    """Measure it in every frame.

    Parameters
    ----------
    predicted
        The frames.
    before
        X less black for each frame, (n,), in its light; None where there is none, or where the
        prediction does not hold for any scene.
    slopes
        (4, n), as for `processing.proof.prediction.movements`.
    """
    share, error = np.full((2, len(before)), np.nan)
    for k, picture in enumerate(before):
        if picture is None:
            continue
        weight = 1 / (predicted.noise_gain[k] * predicted.noise)
        own = predicted.expected(k)
        way = picture - predicted.mean - own
        others = np.stack([predicted.mean, own, *slopes])
        normal = np.linalg.pinv((others * weight) @ others.T, rcond=1e-9, hermitian=True)
        across = way - (normal @ ((others * weight) @ way)) @ others
        power = float(across @ (weight * across))
        if power > LEAST_LEFT * float(way @ (weight * way)):
            share[k] = float(across @ (weight * predicted.residuals[k])) / power
            error[k] = power**-0.5
    return Mixture(share, error)
