"""Clocks that jump while a session is captured, told at its end and by verify."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from acquire.cli.main import app
from acquire.proof import camera_clock_jumps, read_proofs
from acquire.proof.records import append_proofs
from acquire.session import Session
from acquire.session.verification import clock_jumps
from tests.acquire.captures import SMALL_PLAN, captured, small_bench
from tests.acquire.faults import Faults, with_faults

JUMP_AT = 7
HOUR_S = 3600.0


def disturbed(folder: Path, camera_s: float = 0.0, host_s: float = 0.0) -> Session:
    """A capture in which a clock is set before a step; the camera's is three hours ahead."""
    faults = Faults(
        # The host tells the end of an exposure, the camera its beginning.
        clock_off_s=lambda n: host_s if n > JUMP_AT else 0.0,
        camera_off_s=lambda n: 3 * HOUR_S + (camera_s if n >= JUMP_AT else 0.0),
    )
    return captured(folder, bench=with_faults(small_bench(), faults))[0]


@pytest.mark.parametrize("jump_s", [-HOUR_S, 12.0])
def test_a_camera_whose_clock_is_set_is_told_from_a_host_whose_clock_is(
    tmp_path: Path, jump_s: float
) -> None:
    camera, host = (
        disturbed(tmp_path / "camera", camera_s=jump_s),
        disturbed(tmp_path / "host", host_s=jump_s),
    )
    (words,) = camera_clock_jumps(camera)
    assert f"The camera's clock jumped by {jump_s:+.0f} s" in words
    assert f"between steps {JUMP_AT - 1} and {JUMP_AT}" in words
    assert not list(clock_jumps(camera))
    (words,) = clock_jumps(host)
    assert f"The computer's clock jumped by {jump_s:+.0f} s" in words
    assert f"between steps {JUMP_AT - 1} and {JUMP_AT}" in words
    assert not list(camera_clock_jumps(host))


def test_both_at_once_are_two_jumps(tmp_path: Path) -> None:
    session = disturbed(tmp_path / "s", camera_s=-HOUR_S, host_s=HOUR_S)
    (camera,), (host,) = camera_clock_jumps(session), clock_jumps(session)
    assert "jumped by -3600 s" in camera
    assert "jumped by +3600 s" in host


def test_a_camera_in_another_time_zone_is_no_jump(tmp_path: Path) -> None:
    session = disturbed(tmp_path / "s")
    assert not list(camera_clock_jumps(session))
    first = read_proofs(session.folder)[0, 0].camera_time
    assert first.startswith("2026:01:01 03:00:0")
    assert first[-3] == "."


def test_files_that_tell_no_time_tell_no_jump(tmp_path: Path) -> None:
    session = disturbed(tmp_path / "s", camera_s=HOUR_S)
    proofs = read_proofs(session.folder).values()
    append_proofs(session.folder, [one.model_copy(update={"camera_time": ""}) for one in proofs])
    assert not list(camera_clock_jumps(session))


def test_capture_and_verify_tell_of_the_clocks(tmp_path: Path) -> None:
    session = disturbed(tmp_path / "s", camera_s=-HOUR_S, host_s=500.0)
    told = CliRunner().invoke(app, ["verify", str(session.folder)]).output
    assert f"The computer's clock jumped by +500 s between steps {JUMP_AT - 1}" in told
    assert "The camera's clock jumped by -3600 s" in told
    plan = tmp_path / "plan.toml"
    plan.write_text(SMALL_PLAN)
    bench = tmp_path / "bench.toml"
    bench.write_text(
        'kind = "sim"\n[sim]\ncamera_px = [16, 20]\nprojector_px = [48, 64]\nseed = 3\n'
    )
    words = ["capture", str(plan), "--bench", str(bench), "--out", str(session.folder)]
    ended = CliRunner().invoke(app, words).output
    assert "note: The computer's clock jumped by +500 s" in ended
    assert "note: The camera's clock jumped by -3600 s" in ended
