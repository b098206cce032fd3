from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from acquire.bench_file import LabBench, read_bench
from drivers.xserver import XServer
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


def scaled(desk: Desk, red: float, green: float, blue: float) -> None:
    """Scale the projector's gamma ramps, as night lights do."""
    with desk.at_hand():
        server = XServer()
        try:
            ramp = server.gamma_ramp(PROJECTOR)
            first, second, third = (
                tuple(round(factor * value) for value in channel)
                for factor, channel in zip((red, green, blue), ramp, strict=True)
            )
            server.set_gamma_ramp(PROJECTOR, (first, second, third))
        finally:
            server.close()


@pytest.mark.parametrize(
    ("factors", "verdict"),
    [
        pytest.param((1.0, 1.0, 1.0), "good", id="as the server starts"),
        pytest.param((0.6, 0.6, 0.6), "good", id="dimmed"),
        pytest.param((1.0, 0.99, 0.97), "good", id="display profile"),
        # redshift's table of black bodies has (1, 0.8254, 0.6504) at 4000 K.
        pytest.param((1.0, 0.8254, 0.6504), "bad", id="night light at 4000 K"),
    ],
)
def test_a_colour_cast_of_the_gamma_ramps_is_bad(
    desk: Desk, factors: tuple[float, float, float], verdict: str
) -> None:
    scaled(desk, *factors)
    colours = findings(desk)["colours"]
    assert colours["verdict"] == verdict
    assert (PROJECTOR in colours["text"]) == (verdict == "bad")


def test_a_gamma_of_one_colour_is_a_cast_too(desk: Desk) -> None:
    desk.run("xrandr", "--output", PROJECTOR, "--gamma", "1:1:0.6")
    assert findings(desk)["colours"]["verdict"] == "bad"
