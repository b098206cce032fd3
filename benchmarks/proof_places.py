"""Frames that a geometry profile tells to stand elsewhere, to be others, or to be right.

    python -m benchmarks.proof_places --first 1 --trials 100

Of random sessions (`benchmarks.trials`) every frame is taken as it should be, and again with its
raster moved, turned over, of another pitch or of another family, and each is looked at by itself,
as while capturing. The profile has the true places with an error of 0.2 projector pixels, 15 % of
them unknown. A frame counts as wrong where its picture differs by at least a tenth of its mean
light from that of its own raster; moved rasters that the scene would look as well for if it moved
by half a camera pixel are counted apart.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from acquire.plan import Step
from acquire.proof.placement import Placement
from acquire.proof.samples import FrameSamples, sample_frame
from acquire.proof.units import FAMILIES
from acquire.proof.white_black import WhiteBlack
from acquire.session import Transfer
from benchmarks.trials import PITCHES_PX, Trial, trial
from drivers.protocols import Raster
from drivers.sim.defects import Defects
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from drivers.sim.dng import MEDIA_TYPE
from processing.patterns import Family, Pattern
from processing.proof.finding import Finding

MAP_ERROR_PX, UNKNOWN = 0.2, 0.15
LEAST_DIFFERENT = 0.1
# Mean difference of levels, of 255, by which rasters are alike.
ALIKE = 12.0
KINDS = "moved", "turned", "pitch", "family"
OUTCOMES = "right", "accused", "found", "missed", "not told", "too near", "alike"


class Stand:
    """The bench of a trial without mishaps, and a geometry profile of its scene."""

    def __init__(self, one: Trial) -> None:
        section, self.plan = one.section, one.plan
        values = {name: getattr(section, name) for name in Defects.__dataclass_fields__}
        defects = replace(Defects(**values), late=0, dropped=0, swapped=0, torn=0)
        config = SimulationConfig(
            section.scene, section.seed, section.camera_px, section.projector_px, defects
        )
        self.bench: SimulatedBench = build(config, len(self.plan))
        self.projector_px = section.projector_px
        self.chance = np.random.default_rng(np.random.SeedSequence(one.seed, spawn_key=(23,)))
        places = self.bench.projector_coordinates().copy()
        places += self.chance.normal(0, MAP_ERROR_PX, places.shape)
        places[self.chance.random(places.shape[:2]) < UNKNOWN] = np.nan
        self.placement = Placement(self.plan, places[..., 1], places[..., 0], self.projector_px)

    def samples(self, raster: Raster, step: Step, attempt: int) -> FrameSamples:
        """Of a frame of a raster at the step's place in the run."""
        stage, settings = self.bench.stage, step.settings
        stage.index, stage.attempt = step.index, attempt
        stage.command(raster)
        return sample_frame(self.bench.camera.capture(settings).data, MEDIA_TYPE, Transfer.RAW)

    def light(self, raster: Raster) -> NDArray[np.float64]:
        """The scene under a raster, without noise."""
        stage = self.bench.stage
        return stage.transport.photosites(stage.emitted(raster))

    def raster(self, pattern: Pattern) -> Raster:
        """Of a pattern."""
        return self.plan.projector.raster(pattern, self.projector_px)

    def is_near(self, raster: Raster, own: Raster) -> bool:
        """Whether it is hardly another than one that stands too near for that to be told."""
        most = int(self.placement.known_to_px) + 1
        ways = list(product(range(-most, most + 1), repeat=2))
        signed = raster.astype(np.int16)
        return any(np.abs(signed - np.roll(own, way, (0, 1))).mean() < ALIKE for way in ways)

    def wrong(self, pattern: Pattern, kind: str) -> Raster:
        """A raster that stands elsewhere."""
        own, chance = self.raster(pattern), self.chance
        if kind == "moved":
            shift = [int(chance.integers(-pattern.pitch_px, pattern.pitch_px + 1)) for _ in "yx"]
            return np.roll(own, shift, (0, 1))
        if kind == "turned":
            turned = (0,), (1,), (0, 1)
            return np.ascontiguousarray(np.flip(own, turned[chance.integers(3)]))
        family, pitch_px = pattern.family, pattern.pitch_px
        if kind == "pitch":
            pitch_px = int(chance.choice([one for one in PITCHES_PX if one != pitch_px]))
        else:
            others = sorted(FAMILIES - {family} - _like(family))
            family = others[int(chance.integers(len(others)))]
        return self.raster(Pattern(family, pitch_px))


def _like(family: Family) -> set[Family]:
    """A sinusoid is hardly another pattern than stripes of its pitch."""
    pairs = (
        {Family.STRIPES_COLUMNS, Family.SINUSOID_COLUMNS},
        {Family.STRIPES_ROWS, Family.SINUSOID_ROWS},
    )
    return next((pair for pair in pairs if family in pair), set())


def outcomes(one: Trial) -> Iterator[tuple[str, str]]:
    """What was done to a frame, and what was made of it."""
    stand = Stand(one)
    references: dict[Family, FrameSamples] = {}
    for step in one.plan.steps:
        pattern, raster = step.pattern, stand.raster(step.pattern)
        own = stand.samples(raster, step, 0)
        if pattern.family.is_reference:
            references.setdefault(pattern.family, own)
        elif len(references) == 2:
            known = WhiteBlack.of(references[Family.WHITE], references[Family.BLACK])
            found = stand.placement.sighting(pattern, own, known, None)
            if found is not None:
                unseen = found.finding is Finding.UNSEEN
                right = "not told" if unseen else "accused" if found.is_wrong else "right"
                yield "good", right
            kind = KINDS[step.index % len(KINDS)]
            other = stand.wrong(pattern, kind)
            right_light = stand.light(raster)
            away = np.sqrt(np.mean((stand.light(other) - right_light) ** 2)) / right_light.mean()
            found = stand.placement.sighting(pattern, stand.samples(other, step, 1), known, None)
            if found is not None:
                unseen = found.finding is Finding.UNSEEN
                told = "found" if found.is_wrong else "not told" if unseen else "missed"
                if told != "found":
                    near = stand.is_near(other, raster)
                    told = "too near" if near else "alike" if away < LEAST_DIFFERENT else told
                yield kind, told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--trials", type=int, default=20)
    options = parser.parse_args()
    started = time.process_time()
    trials = [trial(options.first + k, 0.0) for k in range(options.trials)]
    # One after the other on the same scene, whose light transport is computed once.
    trials.sort(key=lambda one: (one.section.scene, one.section.camera_px))
    total: Counter[tuple[str, str]] = Counter()
    for one in trials:
        own = Counter(outcomes(one))
        total += own
        odd = {key: n for key, n in own.items() if key[1] in {"accused", "missed"}}
        if odd:
            print(f"{one}: {odd}", flush=True)
    for kind in ("good", *KINDS):
        counts = [f"{total[kind, name]} {name}" for name in OUTCOMES if total[kind, name]]
        print(f"{kind:8} {', '.join(counts)}")
    print(f"{time.process_time() - started:.0f} s of processor time")


if __name__ == "__main__":
    main()
