"""Small captures for the tests of everything that follows a capture."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path

from acquire.bench_file import SimSection
from acquire.pause import Pause
from acquire.plan import Plan, Step
from acquire.plan_file import parse_plan
from acquire.recording import record
from acquire.rig import Bench
from acquire.rig.simulated import simulated_bench
from acquire.sequencer import Outcome
from acquire.session import Session

SMALL_PLAN = "[pattern]\npitch_px = [8, 12]\nshifts = [4, 2]\n"
SMALL_SIM = SimSection(camera_px=(16, 20), projector_px=(48, 64), seed=3)


@dataclass
class Notes:
    """An observer that remembers, and may ask for a stop."""

    stop: threading.Event = field(default_factory=threading.Event)
    stop_after: int | None = None
    steps: list[int] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def frame_kept(self, step: Step, total: int) -> None:
        assert step.index < total
        self.steps.append(step.index)
        if step.index == self.stop_after:
            self.stop.set()

    def warning(self, message: str) -> None:
        self.warnings.append(message)


def small_plan(text: str = SMALL_PLAN) -> Plan:
    return parse_plan(text, "a test's plan")


def small_bench(**changes: object) -> Bench:
    return simulated_bench(SMALL_SIM.model_copy(update=changes))


def captured(
    folder: Path,
    plan: Plan | None = None,
    bench: Bench | None = None,
    notes: Notes | None = None,
    pause: Pause | None = None,
    *,
    keep_unproven: bool = False,
    mend: bool = False,
) -> tuple[Session, Outcome]:
    notes = notes or Notes()
    return record(
        plan or small_plan(),
        bench or small_bench(),
        folder,
        notes,
        notes.stop,
        pause,
        keep_unproven=keep_unproven,
        mend=mend,
    )


def recorded_bytes(folder: Path) -> dict[str, bytes]:
    """Everything in a session that must not depend on interruptions."""
    paths = [*folder.glob("frames/*"), folder / "frames.jsonl", folder / "plan.json"]
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}
