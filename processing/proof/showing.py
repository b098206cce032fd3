"""Whether frames show what they should, each against its prediction from the others.

Frames that differ somewhere from their predictions by more than noise and model allow
(`processing.proof.mismatch`) are suspects. The one whose being wrong explains most
(`processing.proof.suspicion`) is no longer trusted and everything is predicted anew, until the
trusted frames agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.proof.finding import Finding, Judgement
from processing.proof.gains import fitted_gain
from processing.proof.kind import DARK_AT, Kind
from processing.proof.likeness import Before, changes, distance
from processing.proof.mismatch import mismatch
from processing.proof.mixture import mixture
from processing.proof.phases import Posterior
from processing.proof.prediction import (
    EXACT_FROM,
    Array,
    Predictions,
    complements,
    movements,
    predict,
)
from processing.proof.sample_noise import noise_of_pairs
from processing.proof.suspicion import AMBIGUOUS, Shown, Suspect, Suspicion, suspicion

# Level relative to the mean of white and black that a prediction has at least if its frame should
# show some light.
DUE_AT_LEAST = 0.3
# Change from the picture before, in parts of what such changes are at the least changing fifth of
# the frames, below which the frame shows that picture; asked only where predictions say nothing.
SAME_AT = 0.15
TYPICAL_PERCENTILE = 20
# Of fewer changes from pictures of the same pitch nothing is typical; their patterns tell it.
FEWEST_CHANGES = 5
# A prediction that holds less of the contrast says nothing about a frame.
LEAST_EXPLAINED = 0.3
# One that holds more acquits.
CLEAR_FROM = 0.7
# Part of the places that the picture before takes up where the frame shows nothing else.
WHOLE_AT = 0.6
# Frames without any noise are computed ones, in which equal files prove nothing.
COMPUTED_NOISE = 1e-9
# Difference of two exposures of one pattern, in parts of the contrast, that show the same.
ALIKE_AT = 0.1

# Frames without complements, of which any two predict the third.
NO_MORE_THAN_IT_TAKES = 3

_UNSPECIFIC = {Finding.OTHER, Finding.PARTIAL}


def judge(kind: Kind) -> tuple[Judgement, ...]:
    """Judge every frame of a kind.

    Where a frame and its complement do not agree and nothing tells which of them is wrong, both
    stand accused, the likelier one first.
    """
    court = _Court(kind)
    while court.accuse() or court.accuse_mixed():
        pass
    return court.judgements()


@dataclass(frozen=True, slots=True)
class _Alone:
    """What the trusted others without its complement say of a frame, (n,) each.

    `deviations` are the frame's own, in the light that suits `expected` best; `left` is the
    variance about it, infinite where nobody looked.
    """

    expected: Array
    left: Array
    deviations: Array
    gain: float


class _Court:
    def __init__(self, kind: Kind) -> None:
        self.kind = kind
        pairs = complements(kind.covariance)
        self.partner = dict(pairs) | {second: first for first, second in pairs}
        self.noise = noise_of_pairs(kind.frames, pairs) or kind.noise
        computed = self.noise.read <= COMPUTED_NOISE and self.noise.shot <= COMPUTED_NOISE
        self.repeated = kind.repeated & (not computed)
        dark = kind.dark & ~self.repeated
        self.trusted = ~self.repeated & ~dark & ~kind.void
        self.accused = {int(k): Finding.EXPOSED for k in np.flatnonzero(kind.void)}
        self.accused |= {int(k): Finding.BLANK for k in np.flatnonzero(dark)}
        self.mixed: set[int] = set()
        self._hear()

    def _hear(self) -> None:
        kind = self.kind
        anchor = None if kind.white is None else kind.white / 2
        linear = predict(
            kind.frames, kind.covariance, self.trusted, self.noise, anchor, kind.slopes
        )
        self.exact = linear.explained >= EXACT_FROM
        self.linear = linear
        self.by_others: dict[int, _Alone] = {}
        # Frames that are not trusted are all told by the same others.
        self.posteriors: dict[bytes, Posterior] = {}
        self.predicted = self._by_phases(linear)
        self.seen = mismatch(
            self.predicted, kind.covariance, self.trusted, self.exact, kind.partitions
        )
        self.changes = changes(
            self.predicted,
            self.trusted,
            Before(kind.frames, kind.before, kind.before_index, kind.covariance, kind.change),
        )
        self.confirmed = self._confirmed()
        before = [self._before(k) for k in range(len(kind.frames))]
        self.mixture = mixture(self.predicted, before, kind.slopes)
        self.found = [self._finding(k) for k in range(len(kind.frames))]

    def _alone(self, k: int) -> _Alone:
        """What the others say of frame k, reckoned once between two accusations."""
        if k not in self.by_others:
            others = self.trusted.copy()
            others[[k, self.partner.get(k, k)]] = False
            linear = self.linear
            key = others.tobytes()
            if key not in self.posteriors:
                phases = self.kind.phases
                self.posteriors[key] = phases.posterior(linear.deviations, linear.noise, others)
            expected, left = self.posteriors[key].predicted(k)
            light = linear.mean + linear.deviations[k]
            gain = fitted_gain(light, linear.mean + expected, left + linear.noise)
            self.by_others[k] = _Alone(expected, left, light / gain - linear.mean, gain)
        return self.by_others[k]

    def _by_phases(self, linear: Predictions) -> Predictions:
        """The predictions, by phases where the others do not predict a frame exactly."""
        deviations, residuals = linear.deviations.copy(), linear.residuals.copy()
        unexplained, gains = linear.unexplained.copy(), linear.gains.copy()
        explained, noise_gain = linear.explained.copy(), linear.noise_gain.copy()
        moved, told = linear.moved.copy(), np.zeros(residuals.shape[1], bool)
        for k in map(int, np.flatnonzero(~self.exact)):
            alone = self._alone(k)
            looked_at = np.isfinite(alone.left)
            deviations[k], unexplained[k] = alone.deviations, alone.left
            gains[k] *= alone.gain
            residuals[k] = alone.deviations - alone.expected
            power = linear.contrast * float(self.kind.covariance[k, k])
            known = alone.left[looked_at] / max(power, 1e-30)
            explained[k] = 1 - float(np.mean(np.minimum(known, 1))) if known.size else 0.0
            noise_gain[k] = 1
            told |= looked_at
        inexact = np.flatnonzero(~self.exact)
        moved[inexact] = 0
        places = np.ix_(inexact, told)
        moved[places] = movements(residuals[places], self.kind.slopes[:, told])
        residuals[inexact] -= moved[inexact]
        return replace(
            linear,
            deviations=deviations,
            residuals=residuals,
            moved=moved,
            gains=gains,
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
        # Where complements do not agree both are suspect, though one alone may be over its bound.
        off = self.exact & self.seen.places.any(axis=1)
        disputed = [self.partner[k] for k in suspects if off[k] and k in self.partner]
        suspects += [k for k in disputed if self.trusted[k] and k not in suspects]
        cases = {k: self._case(k) for k in suspects}
        # Of a pair that does not agree one is wrong; else right is right if it is the likelier.
        suspects = [k for k in suspects if self.exact[k] or cases[k].evidence > 0]
        if not suspects:
            return False
        # What looks the same when it is taken again is no mishap of one exposure.
        suspects = [k for k in suspects if not self.confirmed[k]] or suspects
        first = max(suspects, key=lambda k: cases[k].evidence)
        self.trusted[first] = False
        self.accused[first] = self._named(first, cases[first])
        other = self.partner.get(first, first)
        told = self.confirmed[other] and not self.confirmed[first]
        if other in cases and not told and not _tells(cases[first], cases[other]):
            beyond = self.mixture.excess(self.trusted)
            told = max(beyond[first], beyond[other]) > 0
            if told and beyond[other] > beyond[first]:
                first, other = other, first
        if other in set(cases) - {first} and not (told or _tells(cases[first], cases[other])):
            self.trusted[other] = False
            self.accused[other] = Finding.DOUBTFUL
        self._hear()
        return True

    def accuse_mixed(self) -> bool:
        """Trust the frame no longer that has most of the picture before; False where none has."""
        beyond = self.mixture.excess(self.trusted)
        can_tell = self.seen.can_tell & (self.predicted.explained > LEAST_EXPLAINED)
        beyond[~(self.trusted & can_tell)] = -np.inf
        worst = int(np.argmax(beyond))
        if beyond[worst] <= 0:
            return False
        self.trusted[worst] = False
        self.mixed.add(worst)
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
            # Two complements that did not agree are not both right.
            other = self.partner.get(k)
            clear &= other is None or not self.trusted[other]
            if found[k] is not Finding.OWN or not clear:
                found[k] = finding
        for k in self.mixed:
            found[k] = Finding.PARTIAL
        for k in self.accused:
            # It may be its complement that is wrong, and nothing speaks for that one.
            other = self.partner.get(k, k)
            unheard = found[other] is Finding.UNSEEN and not self.confirmed[other]
            if found[k] in _UNSPECIFIC and unheard:
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
            mixed=float(self.mixture.share[k]),
        )

    def _before(self, k: int) -> Array | None:
        """The picture before frame k, in its light; None where nothing exact predicts the frame."""
        if not self.exact[k]:
            return None
        j = int(self.kind.before_index[k])
        if j >= 0:
            return self.predicted.mean + self.predicted.expected(j)
        before = self.kind.before[k] / self.predicted.gains[k]
        return None if np.isnan(before).any() else before

    def _confirmed(self) -> NDArray[np.bool_]:
        """Whether a frame shows what the exposure showed that it replaces, (frames,)."""
        left = distance(self.kind.frames, self.kind.replaced) - 2 * self.predicted.noise.mean()
        bound = ALIKE_AT * self.predicted.contrast * np.diag(self.kind.covariance)
        return np.asarray(left < bound, bool)

    def _finding(self, k: int) -> Finding:
        level, due = self._levels(k)
        if level < DARK_AT and due > DUE_AT_LEAST:
            return Finding.BLANK
        can_tell = bool(self.seen.can_tell[k])
        if not can_tell or self.predicted.explained[k] < CLEAR_FROM:
            usual = self.changes[np.isfinite(self.changes) & (self.kind.before_index >= 0)]
            known = usual.size >= FEWEST_CHANGES
            typical = float(np.percentile(usual, TYPICAL_PERCENTILE)) if known else 1.0
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
        where = self._in_question(k)
        if not where.any():
            return Suspicion(np.inf, Shown.BEFORE, 1.0)
        alone, predicted = self._alone(k), self.predicted
        looked_at = np.isfinite(alone.left)
        if (where & looked_at).any():
            where = where & looked_at
        power = float(self.kind.covariance[k, k])
        due, unsure = predicted.mean + predicted.expected(k), np.zeros_like(alone.left)
        other = self.partner.get(k)
        if other is not None and self.trusted[other]:
            due = predicted.mean - self._alone(other).deviations
        elif not self.exact[k]:
            unsure = alone.left
        own, left = alone.deviations - alone.expected, alone.left
        usual = float(np.median(predicted.gains[self.trusted]))
        light = self.kind.frames[k] / usual
        if other is None and self.exact[k]:
            # All others predict it whatever the scene is, if more agree than it takes to do so.
            own, left = predicted.residuals[k], np.zeros_like(alone.left)
            if self.trusted.sum() <= NO_MORE_THAN_IT_TAKES:
                own, left = light - predicted.mean, np.full_like(alone.left, np.inf)
        suspect = Suspect(
            noise=predicted.noise[where],
            contrast=self.seen.contrast[where] * power,
            deviations=(light - predicted.mean)[where],
            own=own[where],
            left=left[where],
            light=light[where],
            due=due[where],
            open=unsure[where],
        )
        return suspicion(suspect, self._pictures(k, usual, where))

    def _in_question(self, k: int) -> NDArray[np.bool_]:
        """Places where frame k, or else its complement, is off its prediction, (n,)."""
        own = self.seen.places[k]
        other = self.seen.places[self.partner.get(k, k)]
        return np.asarray(own if own.any() else other, bool)

    def _pictures(
        self, k: int, usual: float, where: NDArray[np.bool_]
    ) -> Iterator[tuple[Shown, Array]]:
        """What frame k may show in some places, in its light."""
        kind, predicted = self.kind, self.predicted
        before = kind.before[k, where].astype(np.float64)
        if not np.isnan(before).any():
            yield Shown.BEFORE, before / usual
        mean = predicted.mean[where]
        j = int(kind.before_index[k])
        if j >= 0:
            yield Shown.BEFORE, mean + predicted.expected(j)[where]
        yield Shown.BLACK, np.zeros_like(mean)
        yield Shown.WHITE, 2 * mean
        for other in range(len(kind.frames)):
            if other not in {j, k} and self.trusted[other]:
                yield Shown.ANOTHER, mean + predicted.deviations[other, where]

    def _named(self, k: int, case: Suspicion) -> Finding:
        if self.found[k] in {Finding.BLANK, Finding.PREVIOUS}:
            return self.found[k]
        part = float(self._in_question(k).mean())
        whole = part > WHOLE_AT and case.mixed > WHOLE_AT
        if case.shown is Shown.BEFORE and whole:
            return Finding.PREVIOUS
        if case.shown in {Shown.ANYTHING, Shown.ANOTHER} or part > WHOLE_AT:
            return Finding.OTHER
        return Finding.PARTIAL


def _tells(first: Suspicion, other: Suspicion) -> bool:
    """Whether the case against the first is clearly the stronger one."""
    return first.evidence - other.evidence >= AMBIGUOUS
