"""Frames that the proof finds, misses and accuses, against what the simulated bench really showed.

    python -m benchmarks.proof

Captures simulated sessions through the sequencer, as `lumisplit capture` does, with frames that are
late, dropped, swapped, torn, or delivered once more with fresh noise. The bench notes for every
exposure which raster was on the scene; a frame is wrong where that is not the raster of its step.
A wrong frame is found if it was taken again, or is noted as wrong where it is in the session; a
good one is accused if either happened to it.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from acquire.bench_file import SimSection
from acquire.plan import Plan, Step
from acquire.plan_file import parse_plan
from acquire.proof import read_proofs
from acquire.recording import record
from acquire.rig.bench import Bench, Resumption, closed_with
from acquire.rig.simulated import simulated_bench
from acquire.session import Session
from drivers.protocols import CameraSettings, Devices, Raster, RawFrame
from drivers.sim.defects import Defects
from drivers.sim.devices import SimulatedBench, SimulationConfig, build

SCENES = ("corner", "groove", "board")
BLURS_PX = (0.0, 1.0)
# Shot noise at full scale and read noise, electrons.
NOISES = {"0.5 %": (40_000.0, 200.0), "2 %": (2_500.0, 50.0)}
PLAN = """[pattern]
pitch_px = [8, 12, 16, 24, 32, 48, 64, 96]
[references]
every_frames = 36
"""
RATE = 0.01
REPEATED_KEY = (7,)


@dataclass(slots=True)
class Witness:
    """A simulated camera that knows which raster each of its files shows."""

    bench: SimulatedBench
    seed: int
    repeated: float
    shows: list[tuple[str, bool]] = field(default_factory=list)
    _last: Raster | None = None

    def capture(self, settings: CameraSettings) -> RawFrame:
        """Expose, and note what befell the exposure and whether it shows what was asked for."""
        stage, wanted = self.bench.stage, self.bench.stage.commanded
        sequence = np.random.SeedSequence((self.seed, stage.index), spawn_key=REPEATED_KEY)
        again = self._last is not None and np.random.default_rng(sequence).random() < self.repeated
        if again:
            stage.command(self._last)
        chance = stage.chance()
        displayed = stage.displayed(chance)
        fate = "torn" if chance.drawn is not None else "good"
        fate = "dropped" if chance.dropped else "late" if chance.late else fate
        if chance.swapped and self._last is not None:
            displayed, fate = self._last, "swapped"
        fate = "repeated" if again and fate == "good" else fate
        frame = self.bench.camera.capture(settings)
        if again:
            stage.command(wanted)
        self._last = displayed.copy()
        self.shows.append((fate, not np.array_equal(displayed, wanted)))
        return frame

    def close(self) -> None:
        """Let the sensor go."""
        self.bench.camera.close()


@dataclass(slots=True)
class Listener:
    """Remembers why frames were taken again."""

    warnings: list[str] = field(default_factory=list)

    def frame_kept(self, step: Step, total: int) -> None:
        """A frame is on the disk."""

    def warning(self, message: str) -> None:
        """A frame is taken again."""
        self.warnings.append(message)


@dataclass(frozen=True, slots=True)
class Condition:
    """A bench, and the probability of each mishap."""

    scene: str
    blur_px: float
    noise: str
    unsteady: bool
    seed: int

    @property
    def section(self) -> SimSection:
        """`[sim]` of a bench file."""
        full_well_e, read_noise_e = NOISES[self.noise]
        lamp = {"drift": 0.1, "flicker": 0.1} if self.unsteady else {}
        mishaps = dict.fromkeys(("late", "dropped", "swapped", "torn"), RATE)
        return SimSection.model_validate(
            {
                "scene": self.scene,
                "blur_px": self.blur_px,
                "full_well_e": full_well_e,
                "read_noise_e": read_noise_e,
                "seed": self.seed,
                **mishaps,
                **lamp,
            }
        )


def conditions(seeds: range) -> Iterator[Condition]:
    """All scenes, blurs and noises, the lamp steady and unsteady; no two see the same chances."""
    for seed, one in product(seeds, enumerate(product(SCENES, BLURS_PX, NOISES, (False, True)))):
        number, (scene, blur_px, noise, unsteady) = one
        yield Condition(scene, blur_px, noise, unsteady, 1000 * seed + number)


def watched(section: SimSection) -> tuple[Bench, list[Witness]]:
    """The bench of a file's section, with witnesses of what it shows."""
    witnesses: list[Witness] = []

    def connect(resumption: Resumption, closing: ExitStack) -> Devices:
        defects = {name: getattr(section, name) for name in Defects.__dataclass_fields__}
        config = SimulationConfig(
            section.scene, section.seed, section.camera_px, section.projector_px, Defects(**defects)
        )
        bench = build(config, len(resumption.plan), resumption.plan.projector.settle_s)
        witnesses.append(Witness(bench, section.seed, RATE))
        return closed_with(Devices(bench.projector, witnesses[-1], bench.clock), closing)

    return replace(simulated_bench(section), _connect=connect), witnesses


def place_of(plan: Plan, step: int) -> str:
    """Reference, or the frame's place among those of its pitch."""
    pattern = plan.patterns[step]
    if pattern.family.is_reference:
        return "reference"
    alike = [k for k, other in enumerate(plan.patterns) if other.pitch_px == pattern.pitch_px]
    return "first" if step == alike[0] else "last" if step == alike[-1] else "inner"


def counted(session: Session, witness: Witness) -> Iterator[tuple[str, str, str]]:
    """(fate, place, found | missed | accused | good) of every exposure."""
    proofs = read_proofs(session.folder)
    for line, (fate, wrong) in zip(session.lines, witness.shows, strict=True):
        proof = proofs.get((line.step, line.attempt))
        noted = session.frames[line.step].attempt > line.attempt
        noted = noted or (proof is not None and proof.is_wrong)
        outcome = ("found" if noted else "missed") if wrong else ("accused" if noted else "good")
        yield fate, place_of(session.plan, line.step), outcome


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=1)
    options = parser.parse_args()
    plan = parse_plan(PLAN, "the benchmark's plan")
    total: Counter[tuple[str, str, str]] = Counter()
    started = time.perf_counter()
    for condition in conditions(range(options.first_seed, options.first_seed + options.seeds)):
        bench, witnesses = watched(condition.section)
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "session"
            notes = Listener()
            session, _ = record(plan, bench, out, notes, threading.Event(), keep_unproven=True)
            found = list(counted(session, witnesses[0]))
            for step, one in enumerate(found):
                if one[2] in {"missed", "accused"}:
                    line = session.lines[step]
                    said = [text for text in notes.warnings if f"step {line.step} " in text]
                    print(f"  step {line.step} ({line.pattern}) {one} {said}", flush=True)
        total.update(found)
        seconds = time.perf_counter() - started
        print(f"{condition}: {_outcomes(Counter(found))}, {seconds:.0f} s", flush=True)
    for heading, index in (("fate", 0), ("place", 1)):
        for name in sorted({key[index] for key in total}):
            own = {key: n for key, n in total.items() if key[index] == name}
            print(f"{heading:6} {name:10} {_outcomes(Counter(own))}")
    print(f"all: {_outcomes(total)}")


def _outcomes(counts: Counter[tuple[str, str, str]]) -> str:
    by: Counter[str] = Counter()
    for key, number in counts.items():
        by[key[2]] += number
    return ", ".join(f"{by[name]} {name}" for name in ("found", "missed", "accused", "good"))


if __name__ == "__main__":
    main()
