"""Clocks that jump while a session is captured, told at its end and by verify."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acquire.cli.main import app
from acquire.proof import camera_clock_jumps, read_proofs
from acquire.proof.records import append_proofs
from acquire.session import Session
from tests.acquire.captures import SMALL_PLAN, captured

JUMP_AT = 7


@pytest.fixture
def session(tmp_path: Path) -> Session:
    return captured(tmp_path / "s")[0]


def with_camera_clock(session: Session, jump_s: float) -> None:
    """Write the times that a camera would have told, its clock set at a step."""
    proofs = read_proofs(session.folder)
    told = []
    for line in session.lines:
        assert line.monotonic_s is not None
        ahead_s = 3 * 3600 + (jump_s if line.step >= JUMP_AT else 0.0)
        moment = datetime.fromtimestamp(1.7e9 + line.monotonic_s + ahead_s, UTC)
        proof = proofs[line.step, line.attempt]
        told.append(proof.model_copy(update={"camera_time": f"{moment:%Y:%m:%d %H:%M:%S}"}))
    append_proofs(session.folder, told)


@pytest.mark.parametrize("jump_s", [-3600.0, 12.0])
def test_a_camera_whose_clock_is_set_is_told(session: Session, jump_s: float) -> None:
    with_camera_clock(session, jump_s)
    (words,) = camera_clock_jumps(session)
    assert f"between steps {JUMP_AT - 1} and {JUMP_AT}" in words
    # Whole seconds are told, of two exposures.
    said_s = float(words.split("by ")[1].split(" s ")[0])
    assert said_s == pytest.approx(jump_s, abs=2)


def test_a_camera_in_another_time_zone_is_no_jump(session: Session) -> None:
    with_camera_clock(session, 0.0)
    assert not list(camera_clock_jumps(session))


def test_files_that_tell_no_time_tell_no_jump(session: Session) -> None:
    assert not list(camera_clock_jumps(session))


def test_capture_and_verify_tell_of_the_clocks(session: Session, tmp_path: Path) -> None:
    with_camera_clock(session, -3600.0)
    lines = session.folder / "frames.jsonl"
    later = [
        line.model_copy(update={"finished_s": (line.finished_s or 0) + 500.0 * (line.step > 3)})
        for line in session.lines
    ]
    lines.write_bytes(b"".join(line.to_line() for line in later))
    told = CliRunner().invoke(app, ["verify", str(session.folder)]).output
    assert "The computer's clock jumped by +500 s between steps 3 and 4" in told
    assert "The camera's clock jumped by -" in told
    plan = tmp_path / "plan.toml"
    plan.write_text(SMALL_PLAN)
    bench = tmp_path / "bench.toml"
    bench.write_text(
        'kind = "sim"\n[sim]\ncamera_px = [16, 20]\nprojector_px = [48, 64]\nseed = 3\n'
    )
    words = ["capture", str(plan), "--bench", str(bench), "--out", str(session.folder)]
    ended = CliRunner().invoke(app, words).output
    assert "note: The computer's clock jumped by +500 s" in ended
    assert "note: The camera's clock jumped by -" in ended
