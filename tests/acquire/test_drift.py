"""Lamps that drift while a session is captured, and what processing makes of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from acquire.evaluation import evaluate, read_truth
from acquire.pipeline import Options, process
from acquire.report.settings import commands
from acquire.result import Result
from acquire.rig import Bench
from acquire.rig.bench import Resumption
from acquire.session import Session, Transfer
from acquire.session.records import SourceRecord
from drivers.protocols import Devices, Projector, Raster
from processing.frames.drift import Course
from tests.acquire.captures import Notes, captured, small_bench, small_plan
from tests.acquire.test_pipeline import Silent

PLAN = small_plan("[pattern]\npitch_px = [8, 12, 16, 24]\n[references]\nevery_frames = 36\n")
SIM = {"camera_px": (48, 48), "projector_px": (144, 192), "full_well_e": 20_000.0}
NOISY = {**SIM, "read_noise_e": 5.0, "ambient": 0.03, "black_level": 0.01}


def session_of(folder: Path, **changes: object) -> Session:
    return captured(folder, PLAN, small_bench(**{**NOISY, **changes}))[0]


@pytest.fixture(scope="module")
def steady(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return session_of(tmp_path_factory.mktemp("steady") / "s")


@pytest.fixture(scope="module")
def drifted(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return session_of(tmp_path_factory.mktemp("drifted") / "s", drift=-0.13)


def errors(result: Result, truth: Session) -> dict[tuple[str, str], float]:
    shape = result.record.shape
    found = evaluate(result, read_truth(truth.folder / "truth.npz", shape))
    return {(row.truth, row.matching): row.error for row in found.rows}


def text_of(result: Result) -> str:
    return " ".join(result.record.warnings)


def test_a_drift_costs_no_tenth_more_than_none(
    steady: Session, drifted: Session, tmp_path: Path
) -> None:
    """Against the truth of a lamp that stays as it was at the start, without gains.

    What is not direct is told apart pixel by pixel. From one draw of the noise to the next its
    kinds differ by more than a tenth without any drift: only their sum is compared.
    """
    before = errors(process(steady, tmp_path / "0", Options(), Silent()), steady)
    result = process(drifted, tmp_path / "1", Options(), Silent())
    after = errors(result, drifted)
    left = process(drifted, tmp_path / "2", Options(drift_correction=False), Silent())
    plain = errors(left, drifted)
    assert after.keys() == before.keys()
    for key in (key for key in before if key[0] in {"direct", "global"}):
        assert after[key] < 1.1 * before[key], key
    assert plain["direct", "named"] > 1.5 * before["direct", "named"]
    drift = result.record.drift
    assert drift is not None
    assert drift.corrected
    # The whites stand at 0, 38, …, 152 of 153 steps.
    assert drift.white_order == (0, 38, 76, 114, 152)
    assert np.array(drift.gain)[-1] == pytest.approx(1 - 0.13 * 152 / 153, abs=0.002)
    assert "the frames were corrected" in text_of(result)
    assert all(abs(pitch.additivity_error or 0) < 0.003 for pitch in result.record.pitches)
    assert left.record.drift is not None
    assert not left.record.drift.corrected
    assert "were not corrected, as asked" in text_of(left)
    assert any("--no-drift-correction" in command.line for command in commands(left.record))
    assert not any("drift" in command.line for command in commands(result.record))


def test_without_drift_nothing_changes_bit_for_bit(steady: Session, tmp_path: Path) -> None:
    results = [
        process(steady, tmp_path / str(on), Options("iva", drift_correction=on), Silent())
        for on in (True, False)
    ]
    for path in results[0].folder.rglob("*.tiff"):
        other = results[1].folder / path.relative_to(results[0].folder)
        assert path.read_bytes() == other.read_bytes()
    drift = results[0].record.drift
    assert drift is not None
    assert drift.course is Course.STEADY
    assert "drift" not in text_of(results[0])


@dataclass
class Dimming:
    """A projector that loses part of its light at once."""

    inner: Projector
    after: int
    left: float
    shown: int = field(default=0)

    @property
    def resolution(self) -> tuple[int, int]:
        return self.inner.resolution

    def show(self, raster: Raster) -> None:
        self.shown += 1
        gain = self.left if self.shown > self.after else 1.0
        self.inner.show(np.round(gain * raster).astype(np.uint8))

    def check(self) -> None:
        self.inner.check()

    def close(self) -> None:
        self.inner.close()


def dimming_bench(after: int, left: float) -> Bench:
    bench = small_bench(**NOISY)

    @contextmanager
    def opened(resumption: Resumption) -> Iterator[Devices]:
        with bench.open(resumption) as devices:
            yield replace(devices, projector=Dimming(devices.projector, after, left))

    return replace(bench, _connect=lambda plan, closing: closing.enter_context(opened(plan)))


def test_a_lamp_that_jumps_is_flagged_and_not_corrected(tmp_path: Path) -> None:
    session, _ = captured(tmp_path / "s", PLAN, dimming_bench(after=60, left=0.94))
    result = process(session, tmp_path / "r", Options("iva"), Silent())
    drift = result.record.drift
    assert drift is not None
    assert (drift.course, drift.corrected) == (Course.ROUGH, False)
    # Half of the step of 6 %: the line between the neighbours goes halfway.
    assert drift.bend == pytest.approx(0.03, abs=0.003)
    assert "not smoothly" in text_of(result)
    assert max(abs(pitch.additivity_error or 0) for pitch in result.record.pitches) > 0.02


def test_retaken_references_count_where_they_were_taken(tmp_path: Path) -> None:
    """The lamp follows the exposures, those included that were taken again."""
    bench = small_bench(**{**NOISY, "drift": 0.3, "dropped": 0.02, "seed": 39})
    session, _ = captured(tmp_path / "s", PLAN, bench)
    retaken = [frame for frame in session.frames if frame.attempt]
    assert any(frame.pattern.family.is_reference for frame in retaken)
    result = process(session, tmp_path / "r", Options("iva"), Silent())
    drift = result.record.drift
    assert drift is not None
    assert drift.corrected
    gain = 1 + 0.3 * np.array(drift.white_order) / (len(PLAN) - 1)
    assert np.array(drift.gain)[:, 1] == pytest.approx(gain / gain[0], abs=0.003)
    assert all(abs(pitch.additivity_error or 0) < 0.003 for pitch in result.record.pitches)


def test_a_part_of_a_session_is_corrected_as_far_as_references_go(tmp_path: Path) -> None:
    bench = small_bench(**{**NOISY, "drift": 0.2})
    session, _ = captured(tmp_path / "s", PLAN, bench, Notes(stop_after=100))
    result = process(session, tmp_path / "r", Options("iva"), Silent())
    assert result.record.drift is not None
    assert result.record.drift.white_order == (0, 38, 76)
    assert "have no reference after them" in text_of(result)


def test_frames_of_unknown_order_are_not_corrected(drifted: Session, tmp_path: Path) -> None:
    source = SourceRecord(table="t.csv", table_sha256="0" * 64, transfer=Transfer.RAW)
    session = Session.open(drifted.folder)
    session.record = session.record.model_copy(update={"source": source})
    result = process(session, tmp_path / "r", Options("iva", gain_correction=False), Silent())
    assert result.record.drift is not None
    assert not result.record.drift.corrected
    assert "in which order they were taken is not known" in text_of(result)


def test_complements_free_frames_of_unknown_order_from_a_drift(
    drifted: Session, tmp_path: Path
) -> None:
    source = SourceRecord(table="t.csv", table_sha256="0" * 64, transfer=Transfer.RAW)
    session = Session.open(drifted.folder)
    session.record = session.record.model_copy(update={"source": source})
    result = process(session, tmp_path / "r", Options("iva"), Silent())
    assert result.record.drift is None
    assert result.record.exposures is not None
    assert result.record.exposures.corrected
    whites = np.array([one.gain for one in result.record.exposures.white])
    # The room's light does not drift: 3 % of the brightest white, a tenth where it is darker.
    assert whites[-1] == pytest.approx(1 - 0.13 * 152 / 153, abs=0.13 * 0.1)
    assert all(abs(pitch.additivity_error or 0) < 0.006 for pitch in result.record.pitches)
