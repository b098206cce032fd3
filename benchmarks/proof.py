"""Frames that the proof finds, misses and accuses, against what the simulated bench really showed.

    python -m benchmarks.proof --first 1 --trials 100 [--rate 0.01]

Captures random sessions (`benchmarks.trials`) through the sequencer, as `lumisplit capture` does,
with frames that show something else (`benchmarks.mishaps`). The bench notes for every exposure
which raster was on the scene; a frame is wrong where that is not the raster of its step. A wrong
frame is found if it was taken again, or is noted as wrong where it is in the session; a good one is
accused if either happened to it. Wrong frames whose picture differs so little that a perfect
observer could not tell (visibility below 5 standard deviations) are counted apart.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from acquire.plan import Plan, Step
from acquire.proof import read_proofs
from acquire.recording import record
from acquire.session import Session
from benchmarks.mishaps import Witness, watched
from benchmarks.trials import Trial, trial
from processing.proof.finding import Finding

LEAST_VISIBLE = 5.0
OUTCOMES = ("found", "missed", "missed unseen", "invisible", "accused", "good", "good unseen")


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
class Count:
    """An exposure of a session: what befell it, where it stands, and what was made of it."""

    fate: str
    place: str
    outcome: str
    visibility: float
    error: float
    step: int


def place_of(plan: Plan, step: int) -> str:
    """Reference, or the frame's place among those of its pitch."""
    pattern = plan.patterns[step]
    if pattern.family.is_reference:
        return "reference"
    alike = [k for k, other in enumerate(plan.patterns) if other.pitch_px == pattern.pitch_px]
    return "first" if step == alike[0] else "last" if step == alike[-1] else "inner"


def counted(session: Session, witness: Witness) -> Iterator[Count]:
    """What became of every exposure."""
    proofs = read_proofs(session.folder)
    for line, shown in zip(session.lines, witness.shows, strict=True):
        proof = proofs.get((line.step, line.attempt))
        noted = session.frames[line.step].attempt > line.attempt
        noted = noted or (proof is not None and proof.is_wrong)
        unseen = proof is None or proof.finding is Finding.UNSEEN
        if not shown.is_wrong:
            outcome = "accused" if noted else "good unseen" if unseen else "good"
        elif noted:
            outcome = "found"
        elif shown.visibility < LEAST_VISIBLE:
            outcome = "invisible"
        else:
            outcome = "missed unseen" if unseen else "missed"
        place = place_of(session.plan, line.step)
        yield Count(shown.fate, place, outcome, shown.visibility, shown.error, line.step)


def told(one: Trial) -> tuple[str, list[Count]]:
    """Capture a trial; a text of what went wrong, and the counts."""
    started = time.perf_counter()
    bench, witnesses = watched(one.section, one.rate)
    with tempfile.TemporaryDirectory() as folder:
        notes = Listener()
        out = Path(folder) / "session"
        session, _ = record(one.plan, bench, out, notes, threading.Event(), keep_unproven=True)
        counts = list(counted(session, witnesses[0]))
        text = [f"{one}: {summed(counts)}, {time.perf_counter() - started:.1f} s"]
        for count, line in zip(counts, session.lines, strict=True):
            if count.outcome.startswith(("missed", "accused")):
                said = [note for note in notes.warnings if f"step {line.step} " in note]
                text.append(
                    f"    {count.outcome}: step {line.step}-{line.attempt} ({line.pattern}) "
                    f"{count.fate}, {count.place}, visibility {count.visibility:.0f}, error "
                    f"{count.error:.3f} {said}"
                )
    return "\n".join(text), counts


def summed(counts: list[Count]) -> str:
    """Numbers of the outcomes."""
    by = Counter(count.outcome for count in counts)
    return ", ".join(f"{by[name]} {name}" for name in OUTCOMES if by[name])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rate", type=float, help="late, dropped and swapped frames alone, each")
    options = parser.parse_args()
    started = time.perf_counter()
    total: list[Count] = []
    seeds = range(options.first, options.first + options.trials)
    trials = [trial(seed, options.rate) for seed in seeds]
    # One after the other on the same scene, whose light transport is computed once.
    trials.sort(key=lambda one: (one.section.scene, one.section.camera_px))
    with ProcessPoolExecutor(options.workers) as pool:
        for text, counts in pool.map(told, trials):
            print(text, flush=True)
            total += counts
    for name in ("fate", "place"):
        for value in sorted({getattr(count, name) for count in total}):
            own = [count for count in total if getattr(count, name) == value]
            print(f"{name:6} {value:10} {summed(own)}")
    print(f"all: {summed(total)}; {time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
