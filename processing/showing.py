"""Whether frames show what they should, each against its prediction from the others.

Frames that differ somewhere from their predictions by more than noise and model allow
(`processing.mismatch`) are suspects. The one whose being wrong explains most
(`processing.suspicion`) is no longer trusted and everything is predicted anew, until the trusted
frames agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.finding import Finding, Judgement
from processing.mismatch import mismatch
from processing.parts import Parts
from processing.phases import Phases
from processing.prediction import (
    GAIN_BOUNDS,
    Array,
    Predictions,
    Samples,
    complements,
    predict,
)
from processing.sample_noise import SampleNoise, noise_of_pairs
from processing.suspicion import AMBIGUOUS, Shown, Suspicion, suspicion

# Level of a frame relative to the mean of white and black below which it shows no light, and that
# its prediction has at least if it should show some.
DARK_AT = 0.1
DUE_AT_LEAST = 0.3
# Change from the picture before, in parts of what such changes are at the least changing fifth of
# the frames, below which the frame shows that picture; asked only where predictions say nothing.
SAME_AT = 0.15
TYPICAL_PERCENTILE = 20
# A linear prediction that holds less of the contrast is not exact.
EXACT_FROM = 0.97
# A prediction that holds less of the contrast says nothing about a frame.
LEAST_EXPLAINED = 0.3
# One that holds more acquits.
CLEAR_FROM = 0.7
# Part of the places that the picture before takes up where the frame shows nothing else.
WHOLE_AT = 0.6
# Frames without any noise are computed ones, in which equal files prove nothing.
COMPUTED_NOISE = 1e-9

_UNSPECIFIC = {Finding.OTHER, Finding.PARTIAL}


@dataclass(frozen=True, slots=True)
class Kind:
    """Frames of one family and pitch, as samples of n places.

    Parameters
    ----------
    frames
        float32, (frames, n), linear light, that of black taken off where it was captured.
    before
        float32, (frames, n): the picture that was taken before each of them; NaN where none was
        or where it was wrong.
    before_index
        int, (frames,): which of `frames` has the pattern that was shown before; −1 where none
        has.
    covariance
        (frames, frames), of the codes (see `processing.prediction`).
    phases
        Codes over the period.
    change
        (frames,): mean square of 2(c − c') with c' the code of the picture before.
    partitions
        The whole picture, blocks of it, and strips across it, which pictures are drawn in.
    white
        (n,), white less black; None where they were not captured.
    noise
        Of a sample, for kinds without three complementary pairs.
    repeated
        bool, (frames,): the file is that of the exposure before, byte for byte.
    """

    frames: Samples
    before: Samples
    before_index: NDArray[np.int64]
    covariance: Array
    phases: Phases
    change: Array
    partitions: tuple[Parts, ...]
    white: Array | None
    noise: SampleNoise
    repeated: NDArray[np.bool_]


def judge(kind: Kind) -> tuple[Judgement, ...]:
    """Judge every frame of a kind.

    Where a frame and its complement do not agree and nothing tells which of them is wrong, both
    stand accused, the likelier one first.
    """
    court = _Court(kind)
    while court.accuse():
        pass
    return court.judgements()


class _Court:
    def __init__(self, kind: Kind) -> None:
        self.kind = kind
        pairs = complements(kind.covariance)
        self.partner = dict(pairs) | {second: first for first, second in pairs}
        self.noise = noise_of_pairs(kind.frames, pairs) or kind.noise
        computed = self.noise.read <= COMPUTED_NOISE and self.noise.shot <= COMPUTED_NOISE
        self.repeated = kind.repeated & (not computed)
        self.trusted = ~self.repeated
        self.accused: dict[int, Finding] = {}
        self._hear()

    def _hear(self) -> None:
        kind = self.kind
        anchor = None if kind.white is None else kind.white / 2
        linear = predict(kind.frames, kind.covariance, self.trusted, self.noise, anchor)
        self.exact = linear.explained >= EXACT_FROM
        self.predicted = self._by_phases(linear)
        self.seen = mismatch(
            self.predicted, kind.covariance, self.trusted, self.exact, kind.partitions
        )
        self.changes = _changes(kind, self.predicted, self.trusted)
        self.found = [self._finding(k) for k in range(len(kind.frames))]

    def _by_phases(self, linear: Predictions) -> Predictions:
        """The predictions, by phases where the others do not predict a frame exactly."""
        residuals, unexplained = linear.residuals.copy(), linear.unexplained.copy()
        explained, noise_gain = linear.explained.copy(), linear.noise_gain.copy()
        for k in np.flatnonzero(~self.exact):
            believed = self.trusted.copy()
            believed[k] = False
            expected, left = self.kind.phases.predicted(
                linear.deviations, linear.noise, believed, int(k)
            )
            residuals[k] = linear.deviations[k] - expected
            unexplained[k] = left
            power = linear.contrast * float(self.kind.covariance[k, k])
            known = left[np.isfinite(left)] / max(power, 1e-30)
            explained[k] = 1 - float(np.mean(np.minimum(known, 1))) if known.size else 0.0
            noise_gain[k] = 1
        return replace(
            linear,
            residuals=residuals,
            unexplained=unexplained,
            explained=explained,
            noise_gain=noise_gain,
        )

    def accuse(self) -> bool:
        """Trust the most suspicious frame no longer; False where the trusted frames agree."""
        suspects = [
            int(k)
            for k in np.flatnonzero(self.trusted)
            if self.found[k] not in {Finding.OWN, Finding.UNSEEN}
        ]
        if not suspects:
            return False
        cases = {k: self._case(k) for k in suspects}
        # Of a pair that does not agree one is wrong; else right is right if it is the likelier.
        suspects = [k for k in suspects if self.exact[k] or cases[k].evidence > 0]
        if not suspects:
            return False
        first = max(suspects, key=lambda k: cases[k].evidence)
        self.trusted[first] = False
        self.accused[first] = self._named(first, cases[first])
        other = self.partner.get(first, first)
        if other != first and other in cases and not _tells(cases[first], cases[other]):
            self.trusted[other] = False
            self.accused[other] = Finding.DOUBTFUL
        self._hear()
        return True

    def judgements(self) -> tuple[Judgement, ...]:
        """Of every frame; those accused are acquitted where the others clearly predict them."""
        found = [
            Finding.OWN if trusted and finding in _UNSPECIFIC else finding
            for finding, trusted in zip(self.found, self.trusted, strict=True)
        ]
        for k, finding in self.accused.items():
            clear = self.predicted.explained[k] > CLEAR_FROM
            if found[k] is not Finding.OWN or not clear:
                found[k] = finding
        for k in self.accused:
            # It may be its complement that is wrong, and nothing speaks for that one.
            other = self.partner.get(k, k)
            if found[k] in _UNSPECIFIC and found[other] is Finding.UNSEEN:
                found[other] = Finding.DOUBTFUL
        for again in map(int, np.flatnonzero(self.repeated)):
            found[again] = Finding.PREVIOUS
            self.changes[again] = 0.0
        return tuple(self._judgement(k, finding) for k, finding in enumerate(found))

    def _judgement(self, k: int, finding: Finding) -> Judgement:
        return Judgement(
            finding,
            change=float(self.changes[k]),
            level=self._levels(k)[0],
            residual=float(self.seen.share[k]),
            gain=float(self.predicted.gains[k]),
        )

    def _finding(self, k: int) -> Finding:
        level, due = self._levels(k)
        if level < DARK_AT and due > DUE_AT_LEAST:
            return Finding.BLANK
        can_tell = bool(self.seen.can_tell[k])
        if not (self.exact[k] and can_tell):
            usual = self.changes[np.isfinite(self.changes)]
            typical = float(np.percentile(usual, TYPICAL_PERCENTILE)) if usual.size else np.nan
            if self.changes[k] < SAME_AT * typical:
                return Finding.PREVIOUS
        if self.predicted.explained[k] < LEAST_EXPLAINED or not can_tell:
            return Finding.UNSEEN
        return Finding.OTHER if self.seen.places[k].any() else Finding.OWN

    def _levels(self, k: int) -> tuple[float, float]:
        """Light of the frame and of its prediction over that of the mean."""
        whole = float(self.predicted.mean.sum())
        if whole <= 0:
            return float("nan"), float("nan")
        expected = self.predicted.expected(k)
        return float(self.kind.frames[k].sum()) / whole, 1 + float(expected.sum()) / whole

    def _case(self, k: int) -> Suspicion:
        if not self.seen.places[k].any():
            return Suspicion(np.inf, Shown.BEFORE, 1.0)
        others = self.trusted.copy()
        others[[k, self.partner.get(k, k)]] = False
        predicted = self.predicted
        alone = self.kind.phases.predicted(predicted.deviations, predicted.noise, others, k)
        power = float(self.kind.covariance[k, k])
        return suspicion(predicted, self.seen, power, alone, k, self._pictures(k))

    def _pictures(self, k: int) -> Iterator[tuple[Shown, Array]]:
        """What frame k may show, in its light."""
        kind, predicted = self.kind, self.predicted
        before = kind.before[k].astype(np.float64)
        if not np.isnan(before).any():
            yield Shown.BEFORE, before / predicted.gains[k]
        j = int(kind.before_index[k])
        if j >= 0:
            yield Shown.BEFORE, predicted.mean + predicted.expected(j)
        yield Shown.BLACK, np.zeros_like(predicted.mean)
        yield Shown.WHITE, 2 * predicted.mean

    def _named(self, k: int, case: Suspicion) -> Finding:
        if self.found[k] in {Finding.BLANK, Finding.PREVIOUS}:
            return self.found[k]
        part = float(self.seen.places[k].mean())
        whole = part > WHOLE_AT and case.mixed > WHOLE_AT
        if case.shown is Shown.BEFORE and whole:
            return Finding.PREVIOUS
        if case.shown is Shown.ANYTHING or part > WHOLE_AT:
            return Finding.OTHER
        return Finding.PARTIAL


def _tells(first: Suspicion, other: Suspicion) -> bool:
    """Whether the case against the first is clearly the stronger one."""
    return first.evidence - other.evidence >= AMBIGUOUS


def _changes(kind: Kind, predicted: Predictions, trusted: NDArray[np.bool_]) -> Array:
    """Change from the picture before in parts of the expected one; NaN where it is too small.

    The picture before is the one that was taken, or the one that its pattern should have given
    where that is known: what was taken before may have been wrong itself.
    """
    n_frames, n = kind.frames.shape
    noise = float(predicted.noise.mean())
    expected = predicted.contrast * kind.change
    power = _distance(kind.frames, kind.before) - 2 * noise
    pairs = complements(kind.covariance)
    partner = dict(pairs) | {second: first for first, second in pairs}
    for k in range(n_frames):
        j = int(kind.before_index[k])
        if j >= 0 and not trusted[j]:
            power[k] = np.nan
        other = partner.get(j, k)
        if other != k and trusted[other]:
            due = predicted.mean - predicted.deviations[other]
            away = _distance(kind.frames[k : k + 1], due[np.newaxis])[0]
            power[k] = np.fmin(power[k], away - 2 * noise)
    # Six standard deviations of the noise's mean square.
    visible = expected > 6 * 2 * noise * np.sqrt(2 / n) / SAME_AT
    changes: Array = np.where(visible, power / np.maximum(expected, 1e-30), np.nan)
    return changes


def _distance(frames: NDArray[np.floating], others: NDArray[np.floating]) -> Array:
    """Mean square difference of pictures, the others in the light that suits best."""
    first, second = frames.astype(np.float64), others.astype(np.float64)
    scale = np.sum(first * second, axis=1) / np.maximum(np.sum(second**2, axis=1), 1e-30)
    first -= np.clip(scale, *GAIN_BOUNDS)[:, np.newaxis] * second
    power: Array = np.mean(first**2, axis=1)
    return power
