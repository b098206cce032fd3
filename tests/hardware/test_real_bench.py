"""The bench that is really there: ``pytest -m hardware --expect-bench BENCH.toml``.

A device that the bench file names and that does not answer is a failure, not a skip.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from acquire.plan_file import parse_plan
from acquire.recording import record
from acquire.rig import Bench, Resumption, find_bench
from acquire.session.verification import problems
from acquire.stack import Stack
from drivers.protocols import Devices
from drivers.raw import decode_raw
from tests.acquire.captures import Notes

pytestmark = pytest.mark.hardware

PLAN = parse_plan(
    "[pattern]\npitch_px = [32]\nshifts = [2, 1]\nspan_pitches = [2, 1]\n", "hardware"
)


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Bench:
    path = request.config.getoption("--expect-bench")
    assert path, "name the bench that is expected: pytest -m hardware --expect-bench BENCH.toml"
    return find_bench(path)


@pytest.fixture
def devices(bench: Bench) -> Iterator[Devices]:
    with bench.open(Resumption(PLAN)) as devices:
        yield devices


def level(devices: Devices, value: int) -> float:
    devices.projector.show(np.full(devices.projector.resolution, value, np.uint8))
    frame = devices.camera.capture(PLAN.camera.settings)
    devices.projector.check()
    assert frame.settings == PLAN.camera.settings
    return float(np.median(decode_raw(frame.data).values))


def test_the_camera_sees_the_projector(devices: Devices) -> None:
    black, white, black_again = (level(devices, value) for value in (0, 255, 0))
    assert white > 1.5 * max(black, black_again), "aim the camera, or expose longer"


def test_a_small_session_is_captured_verified_and_adds_up(bench: Bench, tmp_path: Path) -> None:
    session, _ = record(PLAN, bench, tmp_path / "s", Notes(), threading.Event())
    assert session.complete
    assert [problem for problem in problems(session) if problem] == []
    images = {str(f.pattern): image.values for f, image in Stack(session).images(session.frames)}
    checkers = [values for name, values in images.items() if name.startswith("checker")]
    both, uniform = sum(checkers), images["white"] + images["black"]
    assert np.median(both / uniform) == pytest.approx(1, abs=0.02)
