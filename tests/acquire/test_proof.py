"""Frames that show something else are found and taken again; the others are left alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.errors import ProofError
from acquire.proof import Recorded, read_proofs, verdict
from acquire.proof.prover import MOST_HOPELESS
from acquire.rig import find_bench
from acquire.sequencer import Outcome
from acquire.session import Session
from acquire.session.verification import problems
from processing.proof.finding import Finding
from tests.acquire.captures import Notes, captured, recorded_bytes, small_bench, small_plan
from tests.acquire.faults import Faults, with_faults
from tests.raws import counts

PLAN = small_plan("[pattern]\npitch_px = [8, 12]\n[references]\nevery_frames = 60\n")
NOISE = {"full_well_e": 2500.0, "read_noise_e": 50.0}  # 2 % of full scale each


def contents(session: Session) -> list[bytes]:
    """Without the times, which tell that others were taken again."""
    return [counts(session.read(frame)) for frame in session.frames]


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Session:
    session, _ = captured(tmp_path_factory.mktemp("clean") / "s", PLAN, small_bench())
    return session


@pytest.mark.parametrize(
    "mishaps",
    [
        pytest.param({"late": 0.06}, id="late"),
        pytest.param({"dropped": 0.06}, id="dropped"),
        pytest.param({"swapped": 0.06}, id="swapped"),
        pytest.param({"torn": 0.06}, id="torn"),
        pytest.param({"late": 0.03, "dropped": 0.03, "swapped": 0.03, "torn": 0.03}, id="all"),
    ],
)
def test_without_noise_every_frame_ends_up_as_on_a_bench_without_mishaps(
    tmp_path: Path, clean: Session, mishaps: dict[str, float]
) -> None:
    session, outcome = captured(tmp_path / "s", PLAN, small_bench(seed=8, **mishaps))
    assert outcome is Outcome.COMPLETE
    assert len(session.lines) > len(session.plan)
    assert contents(session) == contents(clean)


@pytest.mark.parametrize(
    "conditions",
    [
        pytest.param({}, id="no noise"),
        pytest.param(NOISE, id="noise of 2 %"),
        pytest.param(NOISE | {"blur_px": 1.0}, id="blurred"),
        pytest.param(NOISE | {"flicker": 0.1, "drift": 0.2, "ambient": 0.1}, id="unsteady light"),
    ],
)
def test_good_frames_are_left_alone(tmp_path: Path, conditions: dict[str, float]) -> None:
    notes = Notes()
    session, outcome = captured(tmp_path / "s", PLAN, small_bench(**conditions), notes)
    assert outcome is Outcome.COMPLETE
    assert notes.warnings == []
    assert session.lines == session.frames
    proofs = read_proofs(session.folder)
    assert set(proofs) == {(step, 0) for step in range(len(PLAN))}
    assert not any(proof.is_wrong for proof in proofs.values())


def test_interrupted_anywhere_the_retakes_are_the_same(tmp_path: Path) -> None:
    plan = small_plan("[pattern]\npitch_px = [8]\n")
    bench = small_bench(late=0.06, dropped=0.04, swapped=0.04, torn=0.04, **NOISE)
    whole, _ = captured(tmp_path / "whole", plan, bench)
    assert len(whole.lines) > len(plan) + 2
    for kept in range(1, len(whole.lines), 3):
        lines = (tmp_path / "whole" / "frames.jsonl").read_bytes().splitlines(keepends=True)
        folder = tmp_path / f"cut-{kept}"
        (folder / "frames").mkdir(parents=True)
        for name in ("plan.json", "session.json"):
            (folder / name).write_bytes((tmp_path / "whole" / name).read_bytes())
        record = (folder / "session.json").read_text().replace('"complete"', '"running"')
        (folder / "session.json").write_text(record)
        (folder / "frames.jsonl").write_bytes(b"".join(lines[:kept]))
        for line in whole.lines[:kept]:
            (folder / line.file).write_bytes(whole.read(line))
        captured(folder, plan, bench)
        assert recorded_bytes(folder) == recorded_bytes(tmp_path / "whole")


def test_a_replay_of_mishaps_takes_again_what_was_taken_again(tmp_path: Path) -> None:
    captured(tmp_path / "first", PLAN, small_bench(late=0.05, dropped=0.05, **NOISE))
    captured(tmp_path / "again", PLAN, find_bench(f"replay:{tmp_path / 'first'}"))
    assert recorded_bytes(tmp_path / "again") == recorded_bytes(tmp_path / "first")


def test_superseded_frames_stay_and_are_verified(tmp_path: Path) -> None:
    session, _ = captured(tmp_path / "s", PLAN, small_bench(dropped=0.08))
    again = next(line for line in session.lines if line.attempt == 1)
    assert again.file == f"frames/{again.step:06d}-1.dng"
    first = tmp_path / "s" / f"frames/{again.step:06d}.dng"
    assert [problem for problem in problems(Session.open(tmp_path / "s")) if problem] == []
    first.write_bytes(b"x")
    (problem,) = [problem for problem in problems(Session.open(tmp_path / "s")) if problem]
    assert first.name in problem


def test_a_projector_that_stays_dark_stops_the_capture(tmp_path: Path) -> None:
    bench = small_bench(dropped=1.0)
    with pytest.raises(ProofError, match=r"step 0|step 1|Step 1|Step 0"):
        captured(tmp_path / "s", PLAN, bench)
    session = Session.open(tmp_path / "s")
    assert len(session.frames) == 2
    assert session.record.runs[-1].outcome == "failed"


def test_a_first_black_that_showed_a_pattern_is_the_one_that_is_taken_again(
    tmp_path: Path,
) -> None:
    plan = small_plan("[pattern]\npitch_px = [8]\n[references]\nevery_frames = 8\n")
    pattern = plan.projector.raster(plan.patterns[2], (48, 64))
    faults = Faults(shown=lambda number, raster: pattern if number == 1 else raster)
    session, outcome = captured(tmp_path / "s", plan, with_faults(small_bench(**NOISE), faults))
    assert outcome is Outcome.COMPLETE
    assert [line.step for line in session.lines if line.attempt] == [1]


def test_what_is_kept_unproven_is_noted(tmp_path: Path) -> None:
    plan = small_plan("[pattern]\npitch_px = [8]\n")
    bench = small_bench(dropped=0.8, seed=1)
    notes = Notes()
    session, outcome = captured(tmp_path / "s", plan, bench, notes, keep_unproven=True)
    assert outcome is Outcome.COMPLETE
    kept = [proof for proof in read_proofs(session.folder).values() if proof.kept]
    assert kept
    assert {proof.finding for proof in kept} <= set(Finding) - {Finding.OWN, Finding.UNSEEN}


def test_a_recorded_session_is_judged_again(tmp_path: Path) -> None:
    good, _ = captured(tmp_path / "good", PLAN, small_bench(late=0.04, dropped=0.03, **NOISE))
    again = list(Recorded(Session.open(good.folder)).proofs(lambda: None))
    assert [proof.step for proof in again if proof.is_wrong] == []
    assert sorted(proof.step for proof in again) == list(range(len(PLAN)))
    step = next(k for k in range(10, 30) if good.frames[k].attempt == good.frames[k + 1].attempt)
    first, second = good.frames[step], good.frames[step + 1]
    file, other = good.folder / first.file, good.folder / second.file
    content = file.read_bytes(), other.read_bytes()
    file.write_bytes(content[1])
    other.write_bytes(content[0])
    text = (good.folder / "frames.jsonl").read_text()
    text = text.replace(first.sha256, "?").replace(second.sha256, first.sha256)
    (good.folder / "frames.jsonl").write_text(text.replace("?", second.sha256))
    found = list(Recorded(Session.open(good.folder)).proofs(lambda: None))
    assert {step, step + 1} <= {proof.step for proof in found if proof.is_wrong}


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        pytest.param(Faults(dark=lambda n: n >= 20), "projector is off", id="projector dark"),
        pytest.param(Faults(frozen=lambda n: n >= 20), "one file over and over", id="same file"),
    ],
)
def test_what_cannot_be_stops_after_a_few_frames_and_is_mended_afterwards(
    tmp_path: Path, faults: Faults, words: str
) -> None:
    notes = Notes()
    with pytest.raises(ProofError, match=words):
        captured(tmp_path / "s", PLAN, with_faults(small_bench(**NOISE), faults), notes)
    session = Session.open(tmp_path / "s")
    # One more is exposed while the last of them is looked at.
    assert len(session.lines) <= 20 + MOST_HOPELESS + 1
    assert "step 20 " in notes.warnings[0]
    assert words in session.record.runs[-1].reason
    session, outcome = captured(tmp_path / "s", PLAN, small_bench(**NOISE))
    assert outcome is Outcome.COMPLETE
    assert [proof.step for proof in Recorded(session).proofs(lambda: None) if proof.is_wrong] == []


def fates(*wrong: int) -> Faults:
    return Faults(dark=lambda number: number in wrong)


@pytest.mark.parametrize(
    "faults",
    [
        pytest.param(fates(0), id="first white dark"),
        pytest.param(fates(2), id="first frame of a pitch"),
        pytest.param(fates(37), id="last frame of a pitch"),
        pytest.param(fates(62), id="a later white dark"),
        pytest.param(Faults(frozen=lambda number: number == 62), id="a later white swapped"),
        pytest.param(Faults(frozen=lambda number: number == 63), id="a later black swapped"),
        pytest.param(Faults(frozen=lambda number: number == 2), id="first of a pitch swapped"),
        pytest.param(Faults(frozen=lambda number: number == 37), id="last of a pitch swapped"),
    ],
)
def test_a_wrong_frame_is_found_wherever_it_stands(tmp_path: Path, faults: Faults) -> None:
    session, _ = captured(tmp_path / "s", PLAN, with_faults(small_bench(**NOISE), faults))
    again = [line for line in session.lines if session.frames[line.step] != line]
    wrong = [number for number in range(len(PLAN)) if faults.dark(number) or faults.frozen(number)]
    # Where white and black are both dark, either may be wrong.
    assert [line.step for line in again if line.step != 1] == wrong


def test_a_known_movement_is_measured(tmp_path: Path) -> None:
    bench = small_bench(camera_px=(96, 96), projector_px=(192, 256), move_px=0.8, **NOISE)
    plan = small_plan("[pattern]\npitch_px = [12]\n[references]\nevery_frames = 12\n")
    session, _ = captured(tmp_path / "s", plan, bench)
    proofs = list(Recorded(session).proofs(lambda: None))
    whites = [p for p in proofs if str(plan.patterns[p.step]) == "white" and p.moved_px]
    assert len(whites) >= 4
    for proof in whites:
        assert proof.moved_px is not None
        down, right = proof.moved_px
        assert abs(down) <= 0.1
        assert abs(right - 0.8 * proof.step / (len(plan) - 1)) <= 0.1
    assert any(
        "moved by up to 0.8" in line or "moved by up to 0.7" in line
        for line in verdict(session, proofs)
    )


def test_a_session_from_before_a_defect_was_known_is_gone_on_with(tmp_path: Path) -> None:
    captured(tmp_path / "s", PLAN, small_bench(), Notes(stop_after=5))
    path = tmp_path / "s" / "session.json"
    text = path.read_text()
    assert '"torn": 0.0,' in text
    path.write_text(text.replace('"torn": 0.0,', ""))
    session, outcome = captured(tmp_path / "s", PLAN, small_bench())
    assert (outcome, session.complete) == (Outcome.COMPLETE, True)
