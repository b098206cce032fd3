"""Which of several frames that do not agree is the wrong one, and what it shows.

A wrong frame makes its complement, and others that it predicts, look wrong too. For every suspect
two explanations of what it shows in the places in question are compared by their likelihood,
normal and place by place:

- it is right: e ~ N(a, v + u + εC), with the prediction a from all trusted frames but its
  complement, which leaves the variance u of the local contrast C (`processing.proof.phases`), and
  in the lamp's light that suits this best;
- it shows the picture X, or a mixture of it with its own: f − own ~ N(s (X − own), 2 v + w + εC),
  with its own picture as its complement, or all others, let expect it, w what they leave open, and
  s in [0, 1] fitted; or all of it, f ~ N(X, 2 v + εC); X is the picture before, black, white or,
  then whole, that of another pattern; or anything: e ~ N(0, v + 2 C).

The frame whose being wrong explains most is it. Of a pair alone, without other frames that say
anything, the mixture still tells: the complement of a wrong frame lies on the other side of its
own picture, s < 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from processing.proof.gains import fitted_gain
from processing.proof.prediction import Array

# Part of the contrast by which pictures of the same pattern differ at least: movement, drift.
MODEL_ERROR = 0.02
# Logarithm of the prior of anything, and of another pattern, against the known mishaps, a place.
ANYTHING, ANOTHER = -0.5, -0.2
LEAST_MIXED = 0.15
# Difference of two suspects' evidence, a place, below which it is not said which one is wrong.
AMBIGUOUS = 0.1


class Shown(StrEnum):
    """What a wrong frame shows where it is wrong."""

    BEFORE = "before"
    BLACK = "black"
    WHITE = "white"
    ANOTHER = "another"
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


@dataclass(frozen=True, slots=True)
class Suspect:
    """A frame at the places in question, (n,) each.

    Parameters
    ----------
    noise
        Variance of a frame.
    contrast
        C, local, of its pattern.
    deviations
        e, in its usual light.
    own, left
        e − a, in the light that suits a best, and the variance u.
    light
        Of the frame, less black, in its usual light.
    due, open
        Its own picture if it is wrong, less black, and the variance that this leaves.
    """

    noise: Array
    contrast: Array
    deviations: Array
    own: Array
    left: Array
    light: Array
    due: Array
    open: Array


def suspicion(suspect: Suspect, pictures: Iterator[tuple[Shown, Array]]) -> Suspicion:
    """The case against a frame.

    Parameters
    ----------
    suspect
        The frame.
    pictures
        What it may show, less black, (n,) each.
    """
    noise, contrast = suspect.noise, suspect.contrast
    model = MODEL_ERROR * contrast
    right = _likelihood(suspect.own, noise + np.minimum(suspect.left, contrast) + model)
    anything = _likelihood(suspect.deviations, noise + 2 * contrast)
    best = Suspicion(ANYTHING + anything - right, Shown.ANYTHING, 1.0)
    residual = suspect.light - suspect.due
    variance = 2 * noise + np.minimum(suspect.open, contrast) + model
    for shown, picture in pictures:
        # The whole of it, whatever the frame should show.
        gain = fitted_gain(suspect.light, picture, variance)
        wrong = _likelihood(suspect.light - gain * picture, 2 * noise + model)
        wrong += ANOTHER if shown is Shown.ANOTHER else 0
        best = max(best, Suspicion(wrong - right, shown, 1.0), key=_weight)
        way = picture - suspect.due
        mixed = _share(residual, way / variance, way)
        if mixed >= LEAST_MIXED and shown is not Shown.ANOTHER:
            wrong = _likelihood(residual - mixed * way, variance)
            best = max(best, Suspicion(wrong - right, shown, mixed), key=_weight)
    return best


def _weight(one: Suspicion) -> float:
    return one.evidence


def _share(residual: Array, weighted: Array, way: Array) -> float:
    """Part of a way that a residual goes, by weighted least squares, in [0, 1]."""
    power = max(float(way @ weighted), 1e-30)
    return float(np.clip((residual @ weighted) / power, 0, 1))


def _likelihood(residual: Array, variance: Array) -> float:
    """Mean logarithm of a normal density, without its constant."""
    safe = np.maximum(variance, 1e-30)
    return float(-0.5 * np.mean(residual**2 / safe + np.log(safe)))
