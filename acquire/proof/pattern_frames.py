"""The frames of one pitch, judged against each other, with their figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acquire.proof.exposures import Exposures
from acquire.proof.kinds import Codes
from acquire.proof.records import FrameProof, figure, placed_proof, plain_proof, rounded
from acquire.proof.units import Unit
from acquire.proof.white_black import LOOKED_AT, WhiteBlack, partitions_of, window_noise
from processing.proof.finding import Finding, Judgement
from processing.proof.kind import Kind
from processing.proof.places import Sighting
from processing.proof.prediction import complements
from processing.proof.references import Reference, contradicted
from processing.proof.registration import movement
from processing.proof.sample_noise import SampleNoise
from processing.proof.showing import judge

FEWEST_PLACES = 50
# Findings of frames that say nothing of what their complement lights.
# Of frames void for what stands on the scene the judgement says nothing more.
VAGUE = {Finding.EXPOSED, Finding.OTHER, Finding.DOUBTFUL}
DARK_THEMSELVES = {Finding.BLANK, Finding.PREVIOUS}


class PatternFrames:
    """The frames of a unit of patterns, as far as they can be looked at.

    Parameters
    ----------
    unit
        Of patterns.
    exposures
        Holds all of its frames.
    codes
        Of the plan.
    references
        White and black that were exposed as these frames were; None where there are none.
    sightings
        What each frame shows by the places that are seen; empty where these are not known.
    """

    def __init__(
        self,
        unit: Unit,
        exposures: Exposures,
        codes: Codes,
        references: WhiteBlack | None,
        sightings: Sequence[Sighting | None] = (),
    ) -> None:
        self._unit, self._exposures, self._codes = unit, exposures, codes
        self._references = references
        self._sightings = sightings or [None] * len(unit.steps)
        self._grids = np.stack([exposures[step].samples.grid for step in unit.steps])
        self._lit = self._looked_at()
        self._pairs = complements(codes.covariance(unit))
        self._noise = self._noise_of_a_sample()

    def contradicted(self) -> set[Reference]:
        """Which of white and black these frames prove wrong."""
        if self._references is None or not self._can_judge:
            return set()
        return contradicted(
            self._grids[:, self._lit],
            self._references.white.grid[self._lit],
            self._references.black.grid[self._lit],
            self._pairs,
            self._noise,
            partitions_of(self._lit),
        )

    def proofs(self) -> list[FrameProof]:
        """What every frame shows."""
        steps = self._unit.steps
        if not self._can_judge:
            proofs = [plain_proof(self._exposures[step], Finding.UNSEEN) for step in steps]
        else:
            proofs = self._figures(judge(self._kind()))
        return [
            proof if sighting is None else self._placed(proof, sighting)
            for proof, sighting in zip(proofs, self._sightings, strict=True)
        ]

    @staticmethod
    def _placed(proof: FrameProof, sighting: Sighting) -> FrameProof:
        """With what is seen at its places, which tells of frames that agree among themselves."""
        told = proof.is_wrong and proof.finding not in VAGUE
        if sighting.is_wrong and not told and not proof.settings:
            proof = proof.model_copy(update={"finding": sighting.finding})
        return placed_proof(proof, sighting)

    @property
    def _void(self) -> NDArray[np.bool_]:
        """Frames that predict nothing, (frames,).

        Of patterns that stand elsewhere those do predict each other of which there are most.
        """
        steps = self._unit.steps
        exposed = np.array([bool(self._exposures[step].contradictions) for step in steps])
        elsewhere = np.array([bool(one and one.is_wrong) for one in self._sightings])
        return exposed | elsewhere if 2 * elsewhere.sum() < len(steps) else exposed

    @property
    def _can_judge(self) -> bool:
        return len(self._unit.steps) >= 2 and int(self._lit.sum()) >= FEWEST_PLACES

    def _noise_of_a_sample(self) -> SampleNoise:
        if self._references is not None:
            return self._references.noise
        return SampleNoise(window_noise(self._exposures[self._unit.steps[0]].samples))

    def _looked_at(self) -> NDArray[np.bool_]:
        """Places that are lit, by white and black or by the frames themselves."""
        samples = [self._exposures[step].samples for step in self._unit.steps]
        saturated = np.any([one.saturated for one in samples], axis=0)
        if self._references is None:
            light = self._grids.mean(axis=0)
        else:
            white, black = self._references.white, self._references.black
            dark, bright = np.quantile(
                self._grids, [0.25, 0.75], axis=0, method="closest_observation"
            )
            # White or black may be wrong in part.
            light = np.maximum(white.grid, bright) - np.minimum(black.grid, dark)
            saturated = white.saturated
        lit: NDArray[np.bool_] = (light > LOOKED_AT * np.percentile(light, 99)) & ~saturated
        return lit

    def _kind(self) -> Kind:
        unit, exposures, lit = self._unit, self._exposures, self._lit
        dark, white = np.zeros(int(lit.sum()), np.float32), None
        if self._references is not None:
            dark = self._references.black.grid[lit]
            white = self._references.white.grid[lit].astype(np.float64) - dark
        frames = self._grids[:, lit] - dark
        before, replaced = np.full_like(frames, np.nan), np.full_like(frames, np.nan)
        index = np.full(len(frames), -1)
        change = np.ones(len(frames))
        place = {step: k for k, step in enumerate(unit.steps)}
        for k, step in enumerate(unit.steps):
            former = exposures.replaced(step)
            if former is not None:
                replaced[k] = former.samples.grid[lit] - dark
            line = exposures.before(step)
            if line is not None:
                index[k] = place.get(line.record.step, -1)
                if exposures.counts(line):
                    before[k] = line.samples.grid[lit] - dark
                change[k] = self._codes.change(step, line.record.pattern)
        noise = self._noise
        return Kind(
            frames=frames,
            before=before,
            before_index=index,
            covariance=self._codes.covariance(unit),
            phases=self._codes.phases(unit),
            change=change,
            partitions=partitions_of(lit),
            white=white,
            noise=SampleNoise(noise.read + noise.shot * float(dark.mean()), noise.shot),
            repeated=np.array([exposures.is_repeated(step) for step in unit.steps]),
            slopes=self._slopes(),
            replaced=replaced,
            void=self._void,
            is_fine=self._codes.is_fine(unit.steps[0]),
        )

    def _slopes(self) -> NDArray[np.float64]:
        """Differences of the mean picture, (4, places), from complements or from white."""
        members = [k for pair in self._pairs for k in pair]
        if not members and self._references is not None:
            slopes = (self._references.white.slopes + self._references.black.slopes) / 2
        else:
            chosen = members or range(len(self._unit.steps))
            every = [self._exposures[self._unit.steps[k]].samples.slopes for k in chosen]
            slopes = np.mean(every, axis=0, dtype=np.float64)
        return np.asarray(slopes[:, self._lit], np.float64)

    def _figures(self, judgements: Sequence[Judgement]) -> list[FrameProof]:
        references, steps = self._references, self._unit.steps
        unlit = None if references is None else figure(references.unlit)
        partner = dict(self._pairs) | {second: first for first, second in self._pairs}
        agree = not any(judgement.is_wrong for judgement in judgements)
        proofs: list[FrameProof] = []
        for k, (step, one) in enumerate(zip(steps, judgements, strict=True)):
            other = partner.get(k)
            moved = None
            if other is not None and other < k:
                moved = proofs[other].moved_px
            elif other is not None and agree:
                moved = self._moved(step, steps[other])
            proofs.append(
                plain_proof(self._exposures[step], one.finding).model_copy(
                    update={
                        "light": figure(one.gain),
                        "change": figure(one.change),
                        "residual": figure(one.residual),
                        "mixed": figure(one.mixed),
                        "additivity": None if other is None else self._additivity(k, other),
                        "moved_px": moved,
                        "unlit": unlit,
                        "shaded": self._shaded(k, other, judgements),
                    }
                )
            )
        return proofs

    def _additivity(self, k: int, other: int) -> float | None:
        if self._references is None:
            return None
        lit, both = self._lit, self._references
        sums = self._grids[k, lit] + self._grids[other, lit]
        whole = both.white.grid[lit] + both.black.grid[lit]
        return figure(float(np.median(sums / np.maximum(whole, 1e-9))) - 1)

    def _shaded(self, k: int, other: int | None, judgements: Sequence[Judgement]) -> float | None:
        """Part of the places that white lights and neither the frame nor its complement does."""
        pair = [judgements[one].finding for one in (k, other) if one is not None]
        if self._references is None or not DARK_THEMSELVES.isdisjoint(pair):
            return None
        if other is None:
            return figure(self._references.shaded(self._grids.max(axis=0)))
        sums = self._grids[k] + self._grids[other] - self._references.black.grid
        return figure(self._references.shaded(sums))

    def _moved(self, step: int, other: int) -> tuple[float, float] | None:
        if self._references is None:
            return None
        both = self._references
        pair = self._exposures[step].samples.window + self._exposures[other].samples.window
        noise = window_noise(self._exposures[step].samples)
        return rounded(movement(both.white.window + both.black.window, pair, 2 * noise))
