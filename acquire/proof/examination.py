"""The frames of a session as far as they are known, and what they are found to show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.errors import ProofError
from acquire.plan import Plan
from acquire.proof.records import FrameProof, figure
from acquire.proof.samples import FrameSamples
from acquire.proof.units import FAMILIES, Unit, units_of
from acquire.session import FrameRecord
from processing.noise import noise_deviation
from processing.patterns import Family, Pattern
from processing.prediction import code_covariance, complements
from processing.references import adds_up, at_once, both_show, later_reference
from processing.registration import movement
from processing.showing import (
    COMPUTED_NOISE,
    Finding,
    Judgement,
    Kind,
    block_labels,
    judge,
)

# Parts of the bright level (99th percentile): what is darker is not lit, or not looked at.
UNLIT = 0.01
LOOKED_AT = 0.03
FEWEST_PLACES = 50
LARGEST_PROJECTOR_PX = 2400, 4096
MOST_CODE_PX = 256


@dataclass(frozen=True, slots=True)
class _Line:
    record: FrameRecord
    samples: FrameSamples


class Examination:
    """Judges units of a plan from the samples of their frames.

    Parameters
    ----------
    plan
        What should be shown.
    projector_px
        (height, width) of the projector; None where it is not known.
    """

    def __init__(self, plan: Plan, projector_px: tuple[int, int] | None) -> None:
        self.plan = plan
        self.units = units_of(plan)
        self._projector_px = projector_px or LARGEST_PROJECTOR_PX
        self._lines: dict[int, _Line] = {}
        self._current: dict[int, int] = {}
        self._white: int | None = None
        self._black: int | None = None
        self._covariance: dict[Unit, NDArray[np.float64]] = {}

    def add(self, number: int, record: FrameRecord, samples: FrameSamples) -> None:
        """Take in the exposure of line `number`, from 0, of the session."""
        known = next(iter(self._lines.values()), None)
        if known is not None and known.samples.grid.shape != samples.grid.shape:
            raise ProofError(
                f"Step {record.step}: its picture has another size than those before it. Set the "
                "camera to one size and full raw, and begin a new session."
            )
        self._lines[number] = _Line(record, samples)
        self._current[record.step] = number

    def closing_at(self, step: int) -> tuple[Unit, ...]:
        """The units whose last step this is."""
        return tuple(unit for unit in self.units if unit.closes_at == step)

    def judge(self, unit: Unit) -> tuple[FrameProof, ...]:
        """What every frame of a unit shows, and of the references that they prove wrong."""
        if unit.are_references:
            return self._references(unit)
        return self._patterns(unit)

    def seen_at_once(self, number: int) -> Finding | None:
        """What the exposure of a line shows instead of its pattern, as far as it tells by itself.

        Assumed is that the camera sees at least half the height and half the width of what is
        projected.
        """
        line = self._lines[number]
        step, samples = line.record.step, line.samples
        if self._current[step] == number and self._is_repeated(step):
            return Finding.PREVIOUS if self._noise_of(samples) > COMPUTED_NOISE else None
        pattern = self.plan.patterns[step]
        if pattern.family not in FAMILIES or pattern.pitch_px * 3 > min(self._projector_px):
            return None
        white, black = self._known_references(step)
        if white is None or black is None:
            return None
        lit = self._lit(white, black, LOOKED_AT) & ~white.saturated
        if lit.sum() < FEWEST_PLACES:
            return None
        return at_once(samples.grid[lit], white.grid[lit], black.grid[lit])

    def settle(self, unit: Unit) -> None:
        """The unit is done: rely on its references, forget its patterns."""
        if unit.are_references:
            for step in unit.steps:
                is_white = self.plan.patterns[step].family is Family.WHITE
                if is_white and self._white is None:
                    self._white = step
                if not is_white and self._black is None:
                    self._black = step
            return
        last = max(self._lines, default=-1)
        for step in unit.steps:
            number = self._current.get(step, -1)
            for old in [n for n, line in self._lines.items() if line.record.step == step]:
                if old != last:
                    del self._lines[old]
            if number != last:
                self._current.pop(step, None)

    def _at(self, step: int) -> FrameSamples:
        return self._lines[self._current[step]].samples

    def _is_known(self, step: int | None) -> bool:
        return step is not None and step in self._current

    # References

    def _references(self, unit: Unit) -> tuple[FrameProof, ...]:
        alike = {self.plan.step(step).settings for step in unit.steps}
        whites = [s for s in unit.steps if self.plan.patterns[s].family is Family.WHITE]
        blacks = [s for s in unit.steps if self.plan.patterns[s].family is Family.BLACK]
        first_white = self._white if self._is_known(self._white) else next(iter(whites), None)
        first_black = self._black if self._is_known(self._black) else next(iter(blacks), None)
        if first_white is None or first_black is None or len(alike) > 1:
            return tuple(self._plain(step, Finding.UNSEEN) for step in unit.steps)
        white, black = self._at(first_white), self._at(first_black)
        noise = self._noise_of(white)
        if not both_show(white.grid.ravel(), black.grid.ravel(), noise):
            guilty = {step for step in (first_white, first_black) if step in unit.steps}
            return tuple(
                self._plain(step, Finding.OTHER if step in guilty else Finding.UNSEEN)
                for step in unit.steps
            )
        return tuple(self._reference(step, white, black, noise) for step in unit.steps)

    def _reference(
        self, step: int, white: FrameSamples, black: FrameSamples, noise: float
    ) -> FrameProof:
        is_white = self.plan.patterns[step].family is Family.WHITE
        lit = self._lit(white, black, LOOKED_AT)
        samples = self._at(step)
        finding, light = later_reference(
            samples.grid[lit], white.grid[lit], black.grid[lit], noise, is_white=is_white
        )
        moved = movement(white.window, samples.window, noise) if is_white else None
        return self._plain(step, finding).model_copy(
            update={
                "light": figure(light) if is_white else None,
                "moved_px": _rounded(moved),
                "unlit": figure(1 - float(self._lit(white, black, UNLIT).mean())),
            }
        )

    def _plain(self, step: int, finding: Finding) -> FrameProof:
        line = self._lines[self._current[step]]
        return FrameProof(
            step=step,
            attempt=line.record.attempt,
            finding=finding,
            saturated=float(f"{line.samples.saturated_part:.6g}"),
            camera_time=line.samples.camera_time,
        )

    # Patterns

    def _patterns(self, unit: Unit) -> tuple[FrameProof, ...]:
        white, black = self._known_references(unit.steps[0])
        lit = self._looked_at(unit, white, black)
        if len(unit.steps) < 2 or lit.sum() < FEWEST_PLACES:
            return tuple(self._plain(step, Finding.UNSEEN) for step in unit.steps)
        kind = self._kind(unit, white, black, lit)
        judgements = list(judge(kind))
        proofs = self._figures(unit, kind, judgements, white, black, lit)
        accused = self._accused_references(kind, judgements, white, black, lit)
        return (*proofs, *accused)

    def _known_references(self, like: int) -> tuple[FrameSamples | None, FrameSamples | None]:
        """White and black that were exposed as a step was."""
        settings = self.plan.step(like).settings
        found: list[FrameSamples | None] = []
        for step in (self._white, self._black):
            usable = step is not None and self._is_known(step)
            usable = usable and self.plan.step(step or 0).settings == settings
            found.append(self._at(step) if usable and step is not None else None)
        return found[0], found[1]

    def _lit(self, white: FrameSamples, black: FrameSamples, part: float) -> NDArray[np.bool_]:
        light = white.grid - black.grid
        lit: NDArray[np.bool_] = light > part * float(np.percentile(light, 99))
        return lit

    def _looked_at(
        self, unit: Unit, white: FrameSamples | None, black: FrameSamples | None
    ) -> NDArray[np.bool_]:
        if white is not None and black is not None:
            return self._lit(white, black, LOOKED_AT) & ~white.saturated
        mean = np.mean([self._at(step).grid for step in unit.steps], axis=0)
        saturated = np.any([self._at(step).saturated for step in unit.steps], axis=0)
        lit: NDArray[np.bool_] = (mean > LOOKED_AT * np.percentile(mean, 99)) & ~saturated
        return lit

    def _kind(
        self,
        unit: Unit,
        white: FrameSamples | None,
        black: FrameSamples | None,
        lit: NDArray[np.bool_],
    ) -> Kind:
        frames = np.stack([self._at(step).grid[lit] for step in unit.steps])
        before = np.full_like(frames, np.nan)
        index = np.full(len(frames), -1)
        change = np.ones(len(frames))
        place = {step: k for k, step in enumerate(unit.steps)}
        for k, step in enumerate(unit.steps):
            number = self._current[step] - 1
            line = self._lines.get(number)
            if line is not None:
                index[k] = place.get(line.record.step, -1)
                if self._current.get(line.record.step) == number:
                    before[k] = line.samples.grid[lit]
                change[k] = self._expected_change(step, line.record.pattern)
        dark = np.zeros(int(lit.sum())) if black is None else black.grid[lit].astype(np.float64)
        mean = None if white is None else (white.grid[lit].astype(np.float64) + dark) / 2
        return Kind(
            frames=frames,
            before=before,
            before_index=index,
            covariance=self._covariance_of(unit),
            change=change,
            blocks=block_labels(_places(lit), lit.shape, (4, 4)),
            strips=block_labels(_places(lit), lit.shape, (16, 1)),
            black=dark,
            mean=mean,
            noise=self._noise_of(self._at(unit.steps[0])),
            repeated=np.array([self._is_repeated(step) for step in unit.steps]),
        )

    def _covariance_of(self, unit: Unit) -> NDArray[np.float64]:
        if unit not in self._covariance:
            patterns = [self.plan.patterns[step] for step in unit.steps]
            self._covariance[unit] = code_covariance(self._codes(patterns))
        return self._covariance[unit]

    def _codes(self, patterns: list[Pattern]) -> NDArray[np.float64]:
        """Codes of patterns over whole periods, (patterns, projector pixels)."""
        period = 2 * max(pattern.pitch_px for pattern in patterns)
        first = patterns[0].family
        height = min(period if first.varies_down else 1, self._projector_px[0])
        width = min(period if first.varies_right else 1, self._projector_px[1])
        return np.stack([pattern.code((height, width)).ravel() for pattern in patterns])

    def _expected_change(self, step: int, before: Pattern) -> float:
        """Mean square of 2(c − c') over a stretch of the projector."""
        pattern = self.plan.patterns[step]
        if before.family not in {pattern.family, Family.WHITE, Family.BLACK}:
            return 1.0
        period = 4 * max(pattern.pitch_px, before.pitch_px)
        size = (min(period, self._projector_px[0]), min(period, self._projector_px[1]))
        own, other = pattern.code(size), before.code(size)
        return float(4 * np.mean((own - other) ** 2))

    def _noise_of(self, samples: FrameSamples) -> float:
        window = samples.window
        if min(window.shape) < 3:
            return 0.0
        usable = np.ones(window.shape, bool)
        return noise_deviation(window[..., np.newaxis], usable) ** 2

    def _is_repeated(self, step: int) -> bool:
        """The file is that of the exposure before, although another raster was shown."""
        number = self._current[step]
        before, own = self._lines.get(number - 1), self._lines[number].record
        if before is None or own.raster_sha256 is None:
            return False
        same = before.record.sha256 == own.sha256
        return same and before.record.raster_sha256 != own.raster_sha256

    def _figures(
        self,
        unit: Unit,
        kind: Kind,
        judgements: list[Judgement],
        white: FrameSamples | None,
        black: FrameSamples | None,
        lit: NDArray[np.bool_],
    ) -> list[FrameProof]:
        partner = dict(complements(kind.covariance))
        partner |= {second: first for first, second in partner.items()}
        scale = 1.0
        unlit = None
        if white is not None and black is not None:
            unlit = figure(1 - float(self._lit(white, black, UNLIT).mean()))
            if kind.mean is not None and kind.mean.mean() > 0:
                scale = float(np.median(kind.frames.mean(axis=1)) / kind.mean.mean())
        proofs: list[FrameProof] = []
        for k, (step, one) in enumerate(zip(unit.steps, judgements, strict=True)):
            additivity, moved = None, None
            other = partner.get(k)
            twin = None if other is None or other > k else proofs[other]
            if other is not None and white is not None and black is not None:
                sums = kind.frames[k] + kind.frames[other]
                whole = white.grid[lit] + black.grid[lit]
                additivity = figure(float(np.median(sums / np.maximum(whole, 1e-9))) - 1)
                if twin is not None:
                    moved = twin.moved_px
                elif not any(judgement.is_wrong for judgement in judgements):
                    pair = self._at(step).window + self._at(unit.steps[other]).window
                    moved = movement(white.window + black.window, pair, 2 * kind.noise)
            proofs.append(
                self._plain(step, one.finding).model_copy(
                    update={
                        "light": figure(one.gain * scale),
                        "change": figure(one.change),
                        "residual": figure(one.residual),
                        "additivity": additivity,
                        "moved_px": _rounded(moved),
                        "unlit": unlit,
                    }
                )
            )
        return proofs

    def _accused_references(
        self,
        kind: Kind,
        judgements: list[Judgement],
        white: FrameSamples | None,
        black: FrameSamples | None,
        lit: NDArray[np.bool_],
    ) -> list[FrameProof]:
        """White and black, where many right pairs agree on another sum."""
        if white is None or black is None or self._white is None or self._black is None:
            return []
        pairs = [
            (first, second)
            for first, second in complements(kind.covariance)
            if not (judgements[first].is_wrong or judgements[second].is_wrong)
        ]
        if len(pairs) < 3:
            return []
        mean = kind.frames[[k for pair in pairs for k in pair]].mean(axis=0, dtype=np.float64)
        if adds_up(white.grid[lit], black.grid[lit], mean, kind.noise):
            return []
        return [self._plain(step, Finding.OTHER) for step in (self._white, self._black)]


def _places(lit: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    down, right = np.nonzero(lit)
    return down, right


def _rounded(moved: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if moved is None else (round(moved[0], 3), round(moved[1], 3))
