"""Which of several frames that do not agree is the wrong one, and what it shows.

A wrong frame makes its complement, and others that it predicts, look wrong too. For every suspect
two explanations of what it shows in the places in question are compared by their likelihood,
normal and place by place:

- it is right: e ~ N(a, v + u + εC), with the prediction a from all trusted frames but its
  complement, which leaves the variance u of the local contrast C (`processing.phases`);
- it shows the picture X, or a mixture of it with its own: r ~ N(s (X − own), 2 v + εC), with
  own predicted from all others and s in [0, 1] fitted; X is the picture before, black or white; or
  anything: e ~ N(0, v + 2 C).

The frame whose being wrong explains most is it. Of a pair alone, without other frames that say
anything, the mixture still tells: the complement of a wrong frame lies on the other side of its
own picture, s < 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from processing.mismatch import Mismatch
from processing.prediction import Array, Predictions

# Part of the contrast by which pictures of the same pattern differ at least: movement, drift.
MODEL_ERROR = 0.02
# Logarithm of the prior of anything, against the known mishaps, a place.
ANYTHING = -0.5
LEAST_MIXED = 0.15
# Difference of two suspects' evidence, a place, below which it is not said which one is wrong.
AMBIGUOUS = 0.1


class Shown(StrEnum):
    """What a wrong frame shows where it is wrong."""

    BEFORE = "before"
    BLACK = "black"
    WHITE = "white"
    ANYTHING = "anything"


@dataclass(frozen=True, slots=True)
class Suspicion:
    """The case against a frame.

    Parameters
    ----------
    evidence
        Logarithm of the likelihood of being wrong over that of being right, mean over the places.
    shown
        What it shows there most likely.
    mixed
        s, the part of that picture in it.
    """

    evidence: float
    shown: Shown
    mixed: float


def suspicion(
    predicted: Predictions,
    seen: Mismatch,
    power: float,
    alone: tuple[Array, Array],
    k: int,
    pictures: Iterator[tuple[Shown, Array]],
) -> Suspicion:
    """The case against frame k.

    Parameters
    ----------
    predicted, seen
        Of all frames.
    power
        Mean square of 2c − 1 of its pattern.
    alone
        What the trusted others without its complement let expect of it, and the variance, (n,).
    pictures
        What it may show, less black, (n,) each.
    """
    where = seen.places[k] & np.isfinite(alone[1])
    if not where.any():
        where = seen.places[k]
    contrast = seen.contrast[where] * power
    noise = predicted.noise[where]
    own = predicted.deviations[k, where]
    left = np.minimum(alone[1][where], contrast)
    right = _likelihood(own - alone[0][where], noise + left + MODEL_ERROR * contrast)
    best = Suspicion(ANYTHING + _likelihood(own, noise + 2 * contrast) - right, Shown.ANYTHING, 1.0)
    residual = predicted.residuals[k, where]
    expected = predicted.mean[where] + predicted.expected(k)[where]
    for shown, picture in pictures:
        way = picture[where] - expected
        mixed = float(np.clip((residual @ way) / max(float(way @ way), 1e-30), 0, 1))
        if mixed < LEAST_MIXED:
            continue
        wrong = _likelihood(residual - mixed * way, 2 * noise + MODEL_ERROR * contrast)
        if wrong - right > best.evidence:
            best = Suspicion(wrong - right, shown, mixed)
    return best


def _likelihood(residual: Array, variance: Array) -> float:
    """Mean logarithm of a normal density, without its constant."""
    safe = np.maximum(variance, 1e-30)
    return float(-0.5 * np.mean(residual**2 / safe + np.log(safe)))
