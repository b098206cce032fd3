"""What a frame ought to look like, from where each place lies in the period of its pattern.

The light of a place is e_k = h s_k(q) + noise in every frame of a pitch: s_k = 2c_k − 1, the code
at the place q of the period that it sees, and an amplitude h ≥ 0. On a lattice of places, the
posterior with flat priors is

    P(q) ∝ exp(⟨e, s(q)⟩² / (2 σ² ⟨s(q), s(q)⟩)),    h(q) = ⟨e, s(q)⟩ / ⟨s(q), s(q)⟩,

over the frames that are believed, and Σ P h s_k predicts another one, with the variance
Σ P (h s_k)² − (Σ P h s_k)². Unlike a linear prediction it is certain of most places even where no
complement was captured, and knows of which not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from processing.patterns import Pattern
from processing.proof.prediction import Array

STEPS = 16
# Footprints of camera pixels, in parts of the pitch.
FOOTPRINTS = 0.0, 0.5, 1.0
# Part of h² by which light differs from the nearest place of the lattice.
LATTICE_ERROR = 0.04
# Places that are looked at, evenly spread.
MOST_PLACES = 1500


@dataclass(frozen=True, slots=True)
class Phases:
    """Codes at the places of a period.

    Parameters
    ----------
    signs
        float64, (frames, places): 2c − 1, without and with the blur of footprints.
    """

    signs: Array

    @classmethod
    def of(cls, patterns: Sequence[Pattern]) -> Phases:
        """Of the patterns of one family and pitch."""
        first = patterns[0]
        period = 2 * first.pitch_px
        size = (
            period if first.family.varies_down else 1,
            period if first.family.varies_right else 1,
        )
        codes = [pattern.code(size) for pattern in patterns]
        places = [np.unique(np.arange(STEPS) * side // STEPS) for side in size]
        if min(size) > 1:
            places[1] = places[1][: (len(places[1]) + 1) // 2]  # the other half is the same
        chosen = np.ix_(*places)
        signs = [
            np.stack(
                [_blurred(2 * code - 1, part * first.pitch_px)[chosen].ravel() for code in codes]
            )
            for part in FOOTPRINTS
        ]
        return cls(np.concatenate(signs, axis=1))

    def posterior(self, deviations: Array, noise: Array, believed: NDArray[np.bool_]) -> Posterior:
        """What some frames say of the places.

        Parameters
        ----------
        deviations
            (frames, n): light less that of the mean of white and black.
        noise
            (n,): variance of a frame.
        believed
            bool, (frames,).
        """
        n = deviations.shape[1]
        if not believed.any() or n == 0:
            nothing = np.zeros((0, self.signs.shape[1]))
            return Posterior(self, n, np.s_[:0], nothing, nothing, np.zeros(0))
        part = np.s_[:: -(-n // MOST_PLACES)]
        seen = deviations[believed, part]
        signs = self.signs[believed]
        length = np.maximum(np.sum(signs**2, axis=0), 1e-9)
        heights = np.maximum(seen.T @ signs / length, 0)
        gained = heights**2 * length
        scale = noise[part] + LATTICE_ERROR * np.mean(seen**2, axis=0)
        odds = np.exp((gained - gained.max(axis=1, keepdims=True)) / (2 * scale[:, np.newaxis]))
        odds /= odds.sum(axis=1, keepdims=True)
        first = odds * heights
        return Posterior(self, n, part, first, first * heights, scale / int(believed.sum()))

    def predicted(
        self, deviations: Array, noise: Array, believed: NDArray[np.bool_], k: int
    ) -> tuple[Array, Array]:
        """`Posterior.predicted` of frame k from the believed others."""
        return self.posterior(deviations, noise, believed).predicted(k)


@dataclass(frozen=True, slots=True)
class Posterior:
    """Amplitudes h at the places q of the period, by some frames.

    Parameters
    ----------
    phases
        The codes.
    n
        Number of places of the picture.
    part
        Those that were looked at.
    first, second
        (looked at, places of the period): P h and P h².
    rest
        (looked at,): variance of what is predicted that a lattice and noise leave.
    """

    phases: Phases
    n: int
    part: slice
    first: Array
    second: Array
    rest: Array

    def predicted(self, k: int) -> tuple[Array, Array]:
        """Deviations of frame k that these let expect, and their variance, (n,).

        The variance is infinite at the places that were not looked at.
        """
        expected, variance = np.zeros(self.n), np.full(self.n, np.inf)
        signs = self.phases.signs[k]
        mean = self.first @ signs
        spread = self.second @ signs**2 - mean**2
        expected[self.part] = mean
        variance[self.part] = np.maximum(spread, 0) + self.rest
        return expected, variance


def _blurred(code: Array, width_px: float) -> Array:
    size = [min(max(round(width_px), 1), side) for side in code.shape]
    blurred: Array = uniform_filter(code, size, mode="wrap")
    return blurred
