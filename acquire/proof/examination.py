"""The frames of a session as far as they are known, and what they are found to show."""

from __future__ import annotations

from acquire.plan import Plan
from acquire.proof.agreement import Agreement
from acquire.proof.exposures import Exposure, Exposures
from acquire.proof.kinds import Codes
from acquire.proof.pattern_frames import FEWEST_PLACES, PatternFrames
from acquire.proof.placement import Placement
from acquire.proof.records import FrameProof, figure, placed_proof, plain_proof, rounded
from acquire.proof.samples import FrameSamples
from acquire.proof.units import FAMILIES, Unit, units_of
from acquire.proof.white_black import LOOKED_AT, WhiteBlack, partitions_of, window_noise
from acquire.session import FrameRecord
from processing.patterns import Family
from processing.proof.finding import Finding
from processing.proof.places import Sighting
from processing.proof.references import Reference, at_once, both_show, is_darker, later_reference
from processing.proof.registration import movement
from processing.proof.showing import COMPUTED_NOISE

# Light that a frame of white has and one of black has not, in parts of the sensor's range.
BRIGHT_FROM = 0.2


class Examination:
    """Judges units of a plan from the samples of their frames.

    Parameters
    ----------
    plan
        What should be shown.
    projector_px
        (height, width) of the projector; None where it is not known.
    placement
        What the camera sees of the projector's raster; None where nobody measured it.
    """

    def __init__(
        self,
        plan: Plan,
        projector_px: tuple[int, int] | None,
        placement: Placement | None = None,
    ) -> None:
        self.plan = plan
        self.units = units_of(plan)
        self._exposures = Exposures()
        self._codes = Codes(plan, projector_px)
        self._placement = placement
        self._agreement = Agreement(plan, self.units, projector_px)
        self._last: dict[int, FrameProof] = {}
        # By file and by the white and black that it was compared with, as long as these are kept.
        self._sightings: dict[tuple[str, ...], Sighting | None] = {}
        self._white: int | None = None
        self._black: int | None = None

    def add(self, number: int, record: FrameRecord, samples: FrameSamples) -> None:
        """Take in the exposure of line `number`, from 0, of the session."""
        self._exposures.add(number, record, samples)

    def closing_at(self, step: int) -> tuple[Unit, ...]:
        """The units whose last step this is."""
        return tuple(unit for unit in self.units if unit.closes_at == step)

    def judge(self, unit: Unit) -> tuple[FrameProof, ...]:
        """What every frame of a unit shows, and of the references that they prove wrong."""
        if unit.are_references:
            return self._references(unit)
        known = self._known_references(unit.steps[0])
        wrong = PatternFrames(unit, self._exposures, self._codes, known).contradicted()
        known = None if wrong else known
        sightings = [self._sighting(self._exposures[step], known) for step in unit.steps]
        frames = PatternFrames(unit, self._exposures, self._codes, known, sightings)
        steps = {Reference.WHITE: self._white, Reference.BLACK: self._black}
        accused = [step for one in sorted(wrong) if (step := steps[one]) is not None]
        own = frames.proofs()
        self._last = {proof.step: proof for proof in own}
        return (*own, *(plain_proof(self._exposures[step], Finding.OTHER) for step in accused))

    def disagreements(self) -> list[str]:
        """Pitches that stand elsewhere than the others say, once all are settled, in words."""
        return self._agreement.in_words()

    def seen_at_once(self, number: int) -> FrameProof | None:
        """The exposure of a line that is certainly wrong by itself; None where it may be right."""
        line = self._exposures.line(number)
        known = self._known_references(line.record.step)
        finding = Finding.EXPOSED if line.contradictions else self._shows_at_once(line, known)
        if finding is not None:
            return plain_proof(line, finding)
        sighting = self._sighting(line, known) if self._exposures.counts(line) else None
        if sighting is None or not sighting.is_wrong:
            return None
        return placed_proof(plain_proof(line, sighting.finding), sighting)

    def _shows_at_once(self, line: Exposure, known: WhiteBlack | None) -> Finding | None:
        """By its file, its light, or where its pattern stands; None where it may be right."""
        step, samples = line.record.step, line.samples
        if self._exposures.counts(line) and self._exposures.is_repeated(step):
            return Finding.PREVIOUS if window_noise(samples) > COMPUTED_NOISE else None
        pattern = self.plan.patterns[step]
        if known is None or pattern.family not in FAMILIES or not self._codes.is_fine(step):
            return None
        lit = known.usable
        if lit.sum() < FEWEST_PLACES:
            return None
        return at_once(samples.grid[lit], known.white.grid[lit], known.black.grid[lit])

    def _sighting(self, line: Exposure, known: WhiteBlack | None) -> Sighting | None:
        """What an exposure shows by the places that its samples see."""
        if self._placement is None or known is None:
            return None
        before = self._exposures.before(line.record.step)
        shown = None if before is None else before.record.pattern
        references = (self._exposures[s] for s in (self._white, self._black) if s is not None)
        key = line.record.file, *(one.record.file for one in references)
        if key not in self._sightings:
            pattern, samples = line.record.pattern, line.samples
            self._sightings[key] = self._placement.sighting(pattern, samples, known, shown)
        return self._sightings[key]

    def settle(self, unit: Unit) -> None:
        """The unit is done: rely on its references, forget its patterns."""
        if not unit.are_references:
            if all(step in self._exposures and step in self._last for step in unit.steps):
                known = self._known_references(unit.steps[0])
                self._agreement.add(unit, self._exposures, known, self._last)
            self._exposures.forget(unit.steps)
            self._sightings.clear()
            return
        for step in unit.steps:
            is_white = self.plan.patterns[step].family is Family.WHITE
            if is_white and self._white is None:
                self._white = step
            if not is_white and self._black is None:
                self._black = step

    def _known_references(self, like: int) -> WhiteBlack | None:
        """White and black that were exposed as a step was."""
        settings = self.plan.step(like).settings
        for step in (self._white, self._black):
            if step is None or step not in self._exposures:
                return None
            if self.plan.step(step).settings != settings:
                return None
        if self._white is None or self._black is None:
            return None
        return WhiteBlack.of(
            self._exposures[self._white].samples, self._exposures[self._black].samples
        )

    def _references(self, unit: Unit) -> tuple[FrameProof, ...]:
        alike = {self.plan.step(step).settings for step in unit.steps}
        firsts = [self._first(unit, Family.WHITE), self._first(unit, Family.BLACK)]
        if None in firsts or len(alike) > 1:
            return tuple(plain_proof(self._exposures[s], Finding.UNSEEN) for s in unit.steps)
        white, black = (self._exposures[step].samples for step in firsts if step is not None)
        both = WhiteBlack.of(white, black)
        if not both_show(white.grid.ravel(), black.grid.ravel(), both.noise):
            # Where both are dark it is likelier white that is wrong, where both are bright black.
            is_dark = float(white.grid.mean()) < BRIGHT_FROM
            again = firsts[1] is not None and self._exposures.is_repeated(firsts[1])
            likelier = firsts[0] if is_dark and not again else firsts[1]
            findings = dict.fromkeys(firsts, Finding.DOUBTFUL) | {likelier: Finding.OTHER}
            return tuple(
                plain_proof(self._exposures[step], findings.get(step, Finding.UNSEEN))
                for step in unit.steps
            )
        first = firsts[1]
        if first is not None and any(self._is_darker(step, both) for step in unit.steps):
            unseen = (plain_proof(self._exposures[s], Finding.UNSEEN) for s in unit.steps)
            others = (proof for proof in unseen if proof.step != first)
            return (*others, plain_proof(self._exposures[first], Finding.OTHER))
        return tuple(self._reference(step, both) for step in unit.steps)

    def _is_darker(self, step: int, both: WhiteBlack) -> bool:
        """Whether a step should show black, and is darker than the first black."""
        lit, frame = both.lit(LOOKED_AT), self._exposures[step].samples.grid
        is_black = self.plan.patterns[step].family is Family.BLACK
        return is_black and is_darker(frame[lit], both.white.grid[lit], both.black.grid[lit])

    def _first(self, unit: Unit, family: Family) -> int | None:
        known = self._white if family is Family.WHITE else self._black
        if known is not None and known in self._exposures:
            return known
        return next((s for s in unit.steps if self.plan.patterns[s].family is family), None)

    def _reference(self, step: int, both: WhiteBlack) -> FrameProof:
        is_white = self.plan.patterns[step].family is Family.WHITE
        lit = both.lit(LOOKED_AT)
        samples = self._exposures[step].samples
        # Saturated places have not all their light.
        certain = lit & ~both.white.saturated & ~samples.saturated
        lit = certain if certain.sum() >= FEWEST_PLACES else lit
        finding, light = later_reference(
            samples.grid[lit],
            both.white.grid[lit],
            both.black.grid[lit],
            both.noise,
            partitions_of(lit),
            is_white=is_white,
        )
        noise = window_noise(both.white)
        moved = movement(both.white.window, samples.window, noise) if is_white else None
        return plain_proof(self._exposures[step], finding).model_copy(
            update={
                "light": figure(light) if is_white else None,
                "moved_px": rounded(moved),
                "unlit": figure(both.unlit),
                "shaded": figure(both.shaded(samples.grid)) if is_white else None,
            }
        )
