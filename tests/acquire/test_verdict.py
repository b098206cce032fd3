"""What the figures of the frames say about a session: drift, shade, saturation, settings."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from acquire.errors import ProofError
from acquire.proof import Recorded, proof_of, read_proofs, verdict
from acquire.sequencer import Outcome
from acquire.session import Session
from processing.proof.finding import Finding
from tests.acquire.captures import Notes, captured, small_bench, small_plan

PLAN = small_plan(
    "[pattern]\npitch_px = [8, 12]\nshifts = [4, 2]\n[references]\nevery_frames = 4\n"
)
NOISE = {"full_well_e": 20_000.0, "read_noise_e": 5.0}


def told(session: Session) -> str:
    return "\n".join(verdict(session, list(Recorded(session).proofs(lambda: None))))


def per_cent(pattern: str, text: str) -> float:
    found = re.search(pattern, text)
    assert found, text
    return float(found.group(1)) / 100


@pytest.mark.parametrize("drift", [-0.2, -0.03, 0.02, 0.2])
def test_an_injected_drift_is_stated_as_it_was(tmp_path: Path, drift: float) -> None:
    session, _ = captured(tmp_path / "s", PLAN, small_bench(drift=drift, **NOISE))
    whites = [step.index for step in PLAN.steps if str(step.pattern) == "white"]
    course = drift * (whites[-1] - whites[0]) / (len(PLAN) - 1)
    stated = per_cent(r"drifted by ([-+.\d]+)% from the first to the last", told(session))
    assert stated == pytest.approx(course, abs=0.002)
    assert "smoothly: no one" in told(session)


def test_a_steady_lamp_does_not_drift(tmp_path: Path) -> None:
    session, _ = captured(tmp_path / "s", PLAN, small_bench(**NOISE))
    assert told(session).splitlines()[1:] == []


def test_without_repeated_white_drift_is_read_from_all_frames_and_that_is_said(
    tmp_path: Path,
) -> None:
    plan = small_plan("[pattern]\npitch_px = [8, 12]\nshifts = [4, 2]\n")
    session, _ = captured(tmp_path / "s", plan, small_bench(drift=0.1, **NOISE))
    assert "by a line through all frames; only repeated white" in told(session)
    assert per_cent(r"drifted by ([-+.\d]+)%", told(session)) == pytest.approx(0.1, abs=0.02)


def test_saturation_that_appears_in_mid_run_has_a_figure_and_a_verdict(tmp_path: Path) -> None:
    session, _ = captured(tmp_path / "s", PLAN, small_bench(drift=0.5, **NOISE))
    proofs = {proof.step: proof.saturated for proof in read_proofs(session.folder).values()}
    whites = [step.index for step in PLAN.steps if str(step.pattern) == "white"]
    parts = [proofs[step] for step in whites]
    # The brightest photosite is at 0.8 of the range at first.
    assert parts[0] == 0
    assert parts == sorted(parts)
    assert parts[-1] > 0.1
    first = min(step for step, part in proofs.items() if part > 0.001)
    assert f"(first at step {first}, not before): expose less." in told(session)


def test_a_part_that_goes_unlit_has_a_figure_a_warning_and_a_verdict(tmp_path: Path) -> None:
    notes = Notes()
    bench = small_bench(shade=0.4, **NOISE)
    session, outcome = captured(tmp_path / "s", PLAN, bench, notes, keep_unproven=True)
    assert outcome is Outcome.COMPLETE
    proofs = read_proofs(session.folder)
    current = {frame.step: proofs[frame.step, frame.attempt] for frame in session.frames}
    patterns = [step for step in current if not PLAN.patterns[step].family.is_reference]
    half = len(PLAN) // 2
    shades = {step: current[step].shaded or 0.0 for step in patterns}
    assert all(shades[step] == 0 for step in patterns if step < half - 8)
    assert all(0.2 < shades[step] < 0.5 for step in patterns if step > half + 8)
    late = [step for step in current if str(PLAN.patterns[step]) == "white" and step > half]
    assert late
    assert all(current[step].finding is Finding.OTHER for step in late)
    assert any("of what white lights is dark" in warning for warning in notes.warnings)
    assert "stands in front of the projector or the camera" in told(session)
    record = proof_of(session)
    assert record is not None
    assert any("stands in front" in sentence for sentence in record.verdict)
    assert record.shaded[-3] == current[len(PLAN) - 3].shaded


@pytest.mark.parametrize("iso", [160, 250, 800])
def test_settings_changed_at_the_camera_stop_the_capture(tmp_path: Path, iso: int) -> None:
    """A third of a stop is the least that a dial can be turned by."""
    notes = Notes()
    with pytest.raises(ProofError, match=f"ISO {iso} instead of 200.*turned the camera's dial"):
        captured(tmp_path / "s", PLAN, small_bench(iso_turned=iso, **NOISE), notes)
    session = Session.open(tmp_path / "s")
    assert len(session.lines) <= len(PLAN) // 2 + 5
    assert f"ISO {iso} instead of 200" in notes.warnings[0]
    mended, outcome = captured(tmp_path / "t", PLAN, small_bench(iso_turned=200, **NOISE))
    assert outcome is Outcome.COMPLETE
    assert mended.lines == mended.frames


def test_settings_that_were_kept_all_the_same_are_told(tmp_path: Path) -> None:
    bench = small_bench(iso_turned=250, **NOISE)
    session, _ = captured(tmp_path / "s", PLAN, bench, keep_unproven=True)
    half = len(PLAN) // 2
    proofs = list(Recorded(session).proofs(lambda: None))
    exposed = {proof.step for proof in proofs if proof.finding is Finding.EXPOSED}
    assert exposed >= set(range(half + 1, len(PLAN)))
    assert all(
        proof.settings == "ISO 250 instead of 200" for proof in proofs if proof.step in exposed
    )
    assert "frames were exposed otherwise than asked" in told(session)
    # Those before are as good as they were.
    assert not any(proof.is_wrong for proof in proofs if proof.step < half - 8)
