"""Real processes, really killed."""

from __future__ import annotations

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from acquire.session import Session
from acquire.session.verification import happenings, problems
from tests import processes
from tests.acquire.captures import recorded_bytes
from tests.processes import PATIENCE_S, finish, lines, wait_for_lines

PLAN = f"[pattern]\npitch_px = {list(range(8, 48, 5))}\n[references]\nevery_frames = 50\n"
BENCH = """kind = "sim"
[sim]
camera_px = [16, 20]
projector_px = [48, 64]
full_well_e = 20000
read_noise_e = 5
late = 0.05
swapped = 0.05
timeouts = 0.05
"""


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    (tmp_path / "plan.toml").write_text(PLAN)
    (tmp_path / "bench.toml").write_text(BENCH)
    return tmp_path


def start(bench: Path, session: Path) -> subprocess.Popen[str]:
    words = ["capture", str(bench / "plan.toml"), "--out", str(session)]
    return processes.start(*words, "--bench", str(bench / "bench.toml"))


def test_killed_again_and_again_every_file_is_as_if_never_killed(bench: Path) -> None:
    whole, killed = bench / "whole", bench / "killed"
    process = start(bench, whole)
    output = finish(process)
    assert process.returncode == 0, output
    chance = random.Random(11)
    kills = 0
    while lines(killed) < lines(whole):
        before = lines(killed)
        process = start(bench, killed)
        wait_for_lines(process, killed, before + chance.randint(1, 60))
        time.sleep(chance.uniform(0, 0.01))
        process.send_signal(signal.SIGKILL)
        finish(process)
        kills += process.returncode == -signal.SIGKILL
        assert lines(killed) > before
    assert kills >= 5
    process = start(bench, killed)
    finish(process)
    assert process.returncode == 0
    assert recorded_bytes(killed) == recorded_bytes(whole)
    assert [problem for problem in problems(Session.open(killed)) if problem] == []
    outcomes = [run.outcome for run in Session.open(killed).record.runs]
    assert outcomes.count("interrupted") == kills
    assert sum("killed" in line for line in happenings(Session.open(killed))) == kills


@pytest.mark.parametrize("signal_number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_after_the_frame_in_flight(bench: Path, signal_number: int) -> None:
    process = start(bench, bench / "s")
    wait_for_lines(process, bench / "s", 5)
    process.send_signal(signal_number)
    output = finish(process)
    assert process.returncode == 130
    assert "goes on from there" in output
    assert "Traceback" not in output
    session = Session.open(bench / "s")
    assert 5 <= len(session.frames) < len(session.plan)
    assert session.record.runs[-1].outcome == "stopped"
    assert [problem for problem in problems(session) if problem] == []
    process = start(bench, bench / "s")
    finish(process)
    assert Session.open(bench / "s").complete


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs a system with mount namespaces")
def test_a_full_disk_stops_cleanly_and_is_gone_on_with(bench: Path) -> None:
    if shutil.which("unshare") is None:
        pytest.skip("needs util-linux's unshare to make a small disk")
    disk = bench / "disk"
    disk.mkdir()
    lumisplit = f"{sys.executable} -m acquire"
    capture = f"{lumisplit} capture {bench}/plan.toml --bench {bench}/bench.toml --out {disk}/s"
    script = f"""
        mount -t tmpfs -o size=80m tmpfs {disk} || exit 77
        {capture} & capture=$!
        until [ "$(wc -l < {disk}/s/frames.jsonl 2>/dev/null || echo 0)" -gt 5 ]; do :; done
        cat /dev/zero > {disk}/ballast 2>/dev/null
        wait $capture; echo "first: $?"
        ls -A {disk}/s/frames | grep -c part
        rm {disk}/ballast
        {lumisplit} verify {disk}/s; echo "verify: $?"
        {capture}; echo "second: $?"
        {lumisplit} verify {disk}/s
    """
    result = subprocess.run(
        ["unshare", "--user", "--map-root-user", "--mount", "bash", "-c", script],
        check=False,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    if result.returncode == 77 or "unshare failed" in result.stderr:
        assert os.environ.get("CI") != "true", result.stderr
        pytest.skip("this system does not let a user make a small disk")
    assert "The disk is full" in result.stderr, result
    assert "Traceback" not in result.stderr
    first, parts, *_ = result.stdout.split("first: ")[1].splitlines()
    assert (first, parts) == ("1", "0")
    assert "verify: 0" in result.stdout
    assert "second: 0" in result.stdout
    assert "complete, every digest is right" in result.stdout
