"""Whether frames show what they should: each against its prediction and against what goes wrong.

A frame f with the prediction m + p is compared with pictures that it may show instead. For the
alternative a, the matched filter

    s = ⟨e − p, a − p⟩ / ⟨a − p, a − p⟩

is 0 where the frame shows its own pattern and 1 where it shows the other; the noise that
prediction and alternative bring into both products is known and taken off. It is evaluated over
the whole frame and in each block of it, which finds frames that are drawn in part; a comparison
in which the two pictures differ by too little to be told apart is not made. What shows none of
the known alternatives is found by its residual.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum

import numpy as np
from numpy.typing import NDArray

from processing.prediction import (
    GAIN_BOUNDS,
    Array,
    Predictions,
    Samples,
    complements,
    pair_noise,
    predict,
)

WRONG_AT = 0.5
# s has a standard deviation of at most 1/11 where the pictures differ by so many times its noise.
LEAST_DIFFERENCE = 16.0
# A block's pictures must differ by this part of its contrast: errors of the prediction grow with
# the contrast, not with the difference.
LEAST_PART = 0.08
# Level of a block relative to its prediction below which it counts as not lit.
BLANK_AT = 0.35
# Level of a frame relative to the mean of white and black below which it shows no light, and that
# its prediction has at least if it should show some.
DARK_AT = 0.1
DUE_AT_LEAST = 0.3
# Change from the picture before, in parts of what such changes are at the least changing fifth of
# the frames, below which the frame shows that picture.
SAME_AT = 0.15
TYPICAL_PERCENTILE = 20
# Residual, in parts of the contrast, above which a frame with a perfect prediction is wrong.
OTHER_AT = 0.35
# A prediction that holds less of the contrast says nothing about a frame, one that holds less
# than the second number nothing about its blocks.
LEAST_EXPLAINED = 0.5
EXPLAINS_BLOCKS = 0.97
LEAST_NOISE = 1e-10
COMPUTED_NOISE = 1e-9


class Finding(StrEnum):
    """What a frame is found to show.

    ``doubtful`` frames do not agree with their complement, which looks wrong itself; ``unseen``
    ones have a pattern too faint or too unpredictable to be told from others.
    """

    OWN = "own"
    PREVIOUS = "previous"
    BLANK = "blank"
    PARTIAL = "partial"
    OTHER = "other"
    DOUBTFUL = "doubtful"
    UNSEEN = "unseen"


class Certainty(IntEnum):
    """How specific the evidence against a frame is.

    A wrong frame makes its complement look wrong too; the one whose error has a known form is it.
    """

    NONE = 0
    PARTNER = 1
    RESIDUAL = 2
    PARTS = 3
    WHOLE = 4


@dataclass(frozen=True, slots=True)
class Judgement:
    """A frame against its prediction.

    Parameters
    ----------
    finding
        What it shows; ``unseen`` where its pattern is too faint or unpredictable to be told.
    change
        Mean square of the difference from the picture before, noise taken off, in parts of what
        their codes let expect: 0 where both show the same. NaN where there is none before.
    level
        Light of the frame over that of the mean of white and black, black taken off.
    residual
        Mean square of what the prediction leaves, in parts of the contrast, noise taken off.
    gain
        Lamp and exposure relative to the typical frame of the kind.
    certainty
        How specific the evidence is, 0 for none; orders the frames of a kind.
    """

    finding: Finding
    change: float
    level: float
    residual: float
    gain: float
    certainty: int

    @property
    def is_wrong(self) -> bool:
        """The frame shows something else than its pattern."""
        return self.finding not in {Finding.OWN, Finding.UNSEEN}


@dataclass(frozen=True, slots=True)
class Kind:
    """Frames of one family and pitch, as samples of n places.

    Parameters
    ----------
    frames
        float32, (frames, n), linear light.
    before
        float32, (frames, n): the picture that was taken before each of them; NaN where none was
        or where it was wrong.
    before_index
        int, (frames,): which of `frames` has the pattern that was shown before; −1 where none
        has.
    covariance
        (frames, frames), of the codes (see `processing.prediction`).
    change
        (frames,): mean square of 2(c − c') with c' the code of the picture before.
    blocks
        int, (n,): the block, 0, 1 …, that a place lies in.
    strips
        int, (n,): the same for strips across the picture, which pictures are drawn in.
    black
        (n,), light with the projector black; 0 where it was not captured.
    mean
        (n,), half of white and black; None where they were not captured.
    noise
        Variance of a sample's noise, for kinds without three complementary pairs.
    repeated
        bool, (frames,): the file is that of the exposure before, byte for byte.
    """

    frames: Samples
    before: Samples
    before_index: NDArray[np.int64]
    covariance: Array
    change: Array
    blocks: NDArray[np.int64]
    strips: NDArray[np.int64]
    black: Array
    mean: Array | None
    noise: float
    repeated: NDArray[np.bool_]


def judge(kind: Kind) -> tuple[Judgement, ...]:
    """Judge every frame of a kind.

    The frame for whose error there is most evidence is no longer trusted and everything is
    predicted anew, until the frames agree. Where a frame and its complement do not add up to
    white and neither shows a known mishap, both stand accused, the likelier one first.
    """
    measured = pair_noise(kind.frames, kind.covariance)
    noise = max(kind.noise if measured is None else measured, LEAST_NOISE)
    partner = dict(complements(kind.covariance))
    partner |= {second: first for first, second in partner.items()}
    # Frames without any noise are computed ones, in which equal files prove nothing.
    repeated = kind.repeated & (noise > COMPUTED_NOISE)
    trusted = ~repeated
    accused: dict[int, Judgement] = {}
    while True:
        found = list(_hearing(kind, trusted, noise))
        suspects = [int(k) for k in np.flatnonzero(trusted) if found[k].is_wrong]
        if not suspects:
            for again in map(int, np.flatnonzero(repeated)):
                found[again] = replace(
                    found[again], finding=Finding.PREVIOUS, change=0.0, certainty=Certainty.WHOLE
                )
            for k, judgement in accused.items():
                if found[k].certainty < judgement.certainty:
                    found[k] = judgement
            return tuple(found)
        most = max(found[k].certainty for k in suspects)
        worst = [k for k in suspects if found[k].certainty == most]
        first = worst[0]
        if len(worst) > 1:
            alone = _alone(kind, trusted, noise)
            first = max(worst, key=lambda k: float(alone[k]))
        trusted[first] = False
        other = partner.get(first)
        if most < Certainty.WHOLE:
            accused[first] = found[first]
            if other is not None and trusted[other]:
                trusted[other] = False
                accused[other] = replace(
                    found[other], finding=Finding.DOUBTFUL, certainty=Certainty.PARTNER
                )


def _hearing(kind: Kind, trusted: NDArray[np.bool_], noise: float) -> tuple[Judgement, ...]:
    predicted = predict(kind.frames, kind.covariance, trusted, noise, kind.mean)
    changes = _changes(kind, predicted, trusted)
    return tuple(_judged(kind, predicted, k, changes) for k in range(len(kind.frames)))


def _alone(kind: Kind, trusted: NDArray[np.bool_], noise: float) -> Array:
    """Residual of each frame when its complement has no say: tells which of the two is wrong."""
    covariance = kind.covariance.copy()
    for first, second in complements(covariance):
        covariance[first, second] = covariance[second, first] = 0
    predicted = predict(kind.frames, covariance, trusted, noise, kind.mean)
    power: Array = np.mean(predicted.residuals**2, axis=1)
    return power


def _changes(kind: Kind, predicted: Predictions, trusted: NDArray[np.bool_]) -> Array:
    """Change from the picture before in parts of the expected one; NaN where it is too small.

    The picture before is the one that was taken, or the one that its pattern should have given
    where that is known: what was taken before may have been wrong itself.
    """
    n_frames, n = kind.frames.shape
    expected = predicted.contrast * kind.change
    power = _distance(kind.frames, kind.before) - 2 * predicted.noise
    partner = dict(complements(kind.covariance))
    partner |= {second: first for first, second in partner.items()}
    for k in range(n_frames):
        j = int(kind.before_index[k])
        if j >= 0 and not trusted[j]:
            power[k] = np.nan
        other = partner.get(j, k)
        if other != k and trusted[other]:
            due = predicted.mean - predicted.deviations[other]
            away = _distance(kind.frames[k : k + 1], due[np.newaxis])[0]
            power[k] = np.fmin(power[k], away - 2 * predicted.noise)
    # Six standard deviations of the noise's mean square.
    visible = expected > 6 * 2 * predicted.noise * np.sqrt(2 / n) / SAME_AT
    changes: Array = np.where(visible, power / np.maximum(expected, 1e-30), np.nan)
    return changes


def _distance(frames: NDArray[np.floating], others: NDArray[np.floating]) -> Array:
    """Mean square difference of pictures, the others in the light that suits best."""
    first, second = frames.astype(np.float64), others.astype(np.float64)
    scale = np.sum(first * second, axis=1) / np.maximum(np.sum(second**2, axis=1), 1e-30)
    first -= np.clip(scale, *GAIN_BOUNDS)[:, np.newaxis] * second
    power: Array = np.mean(first**2, axis=1)
    return power


def _judged(kind: Kind, predicted: Predictions, k: int, changes: Array) -> Judgement:
    residual = predicted.residuals[k]
    n, noise = len(residual), predicted.noise
    spread = noise * float(np.sum(predicted.weights[k] ** 2))
    contrast = predicted.contrast * float(kind.covariance[k, k])
    left = float(residual @ residual) / n - noise - spread
    share = left / contrast if contrast > 0 else 0.0
    level, due, levels = _levels(kind, predicted, k)
    usual = changes[np.isfinite(changes)]
    typical = float(np.percentile(usual, TYPICAL_PERCENTILE)) if usual.size else np.nan
    visible = contrast > LEAST_DIFFERENCE * noise / np.sqrt(n)
    finding, certainty = Finding.OWN, Certainty.NONE
    if level < DARK_AT and due > DUE_AT_LEAST:
        finding, certainty = Finding.BLANK, Certainty.WHOLE
    elif changes[k] < SAME_AT * typical:
        finding, certainty = Finding.PREVIOUS, Certainty.WHOLE
    elif not visible or predicted.explained[k] < LEAST_EXPLAINED:
        finding = Finding.UNSEEN
    elif np.any(levels < BLANK_AT) or _shows_before(kind, predicted, k, spread):
        finding, certainty = Finding.PARTIAL, Certainty.PARTS
    elif share > OTHER_AT + 1.5 * (1 - float(predicted.explained[k])):
        finding, certainty = Finding.OTHER, Certainty.RESIDUAL
    return Judgement(finding, float(changes[k]), level, share, float(predicted.gains[k]), certainty)


def _levels(kind: Kind, predicted: Predictions, k: int) -> tuple[float, float, Array]:
    """Light of the frame and of its prediction over that of the mean; of its blocks over that due.

    Blocks in which no light is due, or whose prediction is not exact, are NaN.
    """
    grey = np.bincount(kind.blocks, predicted.mean - kind.black)
    seen = np.bincount(kind.blocks, kind.frames[k] - kind.black)
    expected = predicted.deviations[k] - predicted.residuals[k]
    due = grey + np.bincount(kind.blocks, expected)
    enough = due > np.maximum(0.25 * grey, 0.02 * grey.sum() / len(grey))
    enough &= grey > 40 * np.sqrt(predicted.noise * np.bincount(kind.blocks))
    enough &= predicted.explained[k] > EXPLAINS_BLOCKS
    levels = np.full(len(grey), np.nan)
    levels[enough] = seen[enough] / due[enough]
    whole = float(grey.sum())
    if whole <= 0:
        return float("nan"), float("nan"), levels
    return float(seen.sum()) / whole, float(due.sum()) / whole, levels


def _shows_before(kind: Kind, predicted: Predictions, k: int, spread: float) -> bool:
    """Whether any part of the frame shows the picture before."""
    found = _picture_before(kind, predicted, k)
    if found is None or predicted.explained[k] < EXPLAINS_BLOCKS:
        return False
    parts = (_shares(labels, predicted, k, spread, *found) for labels in (kind.blocks, kind.strips))
    return any(bool(np.any(shares > WRONG_AT)) for shares in parts)


def _picture_before(
    kind: Kind, predicted: Predictions, k: int
) -> tuple[Array, float, float] | None:
    """The picture before, its noise, and what of it the frame's prediction shares."""
    j = int(kind.before_index[k])
    before = kind.before[k].astype(np.float64)
    if not np.isnan(before).any():
        shared = predicted.noise * float(predicted.weights[k, j]) if j >= 0 else 0.0
        return before, predicted.noise, shared
    if j >= 0 and predicted.explained[j] > EXPLAINS_BLOCKS:
        before = predicted.mean + predicted.deviations[j] - predicted.residuals[j]
        return before, predicted.noise * float(np.sum(predicted.weights[j] ** 2)), 0.0
    return None


def _shares(
    labels: NDArray[np.int64],
    predicted: Predictions,
    k: int,
    spread: float,
    before: Array,
    own: float,
    shared: float,
) -> Array:
    """Matched filter against the picture before in every part; NaN where it cannot be told."""
    sizes = np.bincount(labels)
    residual = predicted.residuals[k]
    expected = predicted.deviations[k] - residual
    way = before - predicted.mean - expected
    along = np.bincount(labels, residual * way) - sizes * (spread - shared)
    length = np.bincount(labels, way * way)
    length = length - sizes * (own - 2 * shared + spread)
    power = np.bincount(labels, expected**2)
    least = np.maximum(LEAST_DIFFERENCE * predicted.noise * np.sqrt(sizes), LEAST_PART * power)
    shares: Array = np.where(length > least, along / np.maximum(length, 1e-30), np.nan)
    return shares


def block_labels(
    places: tuple[NDArray[np.int64], NDArray[np.int64]],
    shape: tuple[int, int],
    counts: tuple[int, int],
) -> NDArray[np.int64]:
    """Block of each place (row, column) when an image of `shape` is cut into (down, right)."""
    down, right = (places[axis] * counts[axis] // shape[axis] for axis in (0, 1))
    labels: NDArray[np.int64] = down * counts[1] + right
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)
