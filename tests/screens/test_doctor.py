from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from acquire.bench_file import LabBench, read_bench
from tests.screens.desk import OPERATOR, PROJECTOR, Desk


def findings(desk: Desk, *words: str) -> dict[str, dict[str, str]]:
    done = subprocess.run(
        [sys.executable, "-m", "acquire", "doctor", "--json", *words],
        check=False,
        capture_output=True,
        text=True,
        env=desk.environment,
    )
    return {finding["subject"]: finding for finding in json.loads(done.stdout)}


def test_two_monitors_are_well_and_make_a_bench(desk: Desk, tmp_path: Path) -> None:
    found = findings(desk, "--write-bench", str(tmp_path / "bench.toml"))
    assert found["projector"]["verdict"] == "good"
    assert found["projector"]["text"].startswith(PROJECTOR)
    bench = read_bench(tmp_path / "bench.toml")
    assert isinstance(bench, LabBench)
    assert bench.projector.monitor == PROJECTOR


def test_mirrored_displays_are_bad_and_the_mend_is_named(desk: Desk) -> None:
    desk.run("xrandr", "--output", PROJECTOR, "--same-as", OPERATOR)
    projector = findings(desk)["projector"]
    assert projector["verdict"] == "bad"
    assert "mirrored" in projector["text"]
    assert "xrandr" in projector["text"]


def test_a_missing_projector_is_bad(desk: Desk) -> None:
    desk.run("xrandr", "--output", PROJECTOR, "--off")
    projector = findings(desk)["projector"]
    assert projector["verdict"] == "bad"
    assert "no second monitor" in projector["text"]
