"""A whole session as the lab runs it: real window, real TCP, a camera that sees the window."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquire.session import Session
from acquire.session.verification import problems
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from drivers.sim.ptp_responder.body import d4s
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.server import PtpIpServer
from tests.nursery import Child, Nursery
from tests.processes import lines, wait_for_lines
from tests.screens.desk import PROJECTOR, Desk

PLAN = "[pattern]\npitch_px = [16, 24]\nshifts = [2, 2]\n[projector]\nsettle_s = 0.05\n"


@pytest.fixture
def scene(desk: Desk) -> SimulatedBench:
    return build(SimulationConfig("corner", camera_px=(16, 24), projector_px=desk.projector_px))


@pytest.fixture
def seen(desk: Desk, scene: SimulatedBench) -> Callable[[CameraSettings], tuple[bytes, str]]:
    """What a camera delivers whose scene is lit by what really is on the projector's monitor."""

    def source(settings: CameraSettings) -> tuple[bytes, str]:
        raster = desk.projector_screen(desk.photograph())[..., 0]
        scene.projector.show(np.ascontiguousarray(raster))
        frame = scene.camera.capture(settings)
        return frame.data, frame.media_type

    return source


@pytest.fixture(scope="module")
def nursery(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nursery]:
    nursery = Nursery(tmp_path_factory.mktemp("nursery"))
    yield nursery
    nursery.close()


@pytest.fixture
def start(nursery: Nursery, desk: Desk, tmp_path: Path) -> Callable[[int], Child]:
    """Starts the capture, with a camera at this port."""

    def begin(port: int) -> Child:
        (tmp_path / "plan.toml").write_text(PLAN)
        (tmp_path / "bench.toml").write_text(
            f'kind = "lab"\n[projector]\nmonitor = "{PROJECTOR}"\n'
            f'[camera]\naddress = "ptpip:127.0.0.1:{port}"\n'
        )
        words = ("--bench", str(tmp_path / "bench.toml"), "--out", str(tmp_path / "s"))
        return nursery.start(
            "capture", str(tmp_path / "plan.toml"), *words, environment=desk.environment
        )

    return begin


@pytest.fixture
def camera(seen: Callable[[CameraSettings], tuple[bytes, str]]) -> Iterator[PtpIpServer]:
    with PtpIpServer(Responder(seen)) as server:
        yield server


def assert_sound(folder: Path, scene: SimulatedBench) -> None:
    """Complete, every digest right, and every frame shows its own pattern in the scene."""
    session = Session.open(folder / "s")
    assert session.complete
    assert [problem for problem in problems(session) if problem] == []
    step = 1 / (16383 - 512)
    for frame in session.frames:
        raster = frame.pattern.raster(scene.projector.resolution)
        expected = sum(scene.components(raster, frame.settings).values())
        assert np.abs(decode_raw(session.read(frame)).values - expected).max() <= step


def test_every_frame_shows_its_pattern(
    start: Callable[[int], Child],
    desk: Desk,
    camera: PtpIpServer,
    scene: SimulatedBench,
    tmp_path: Path,
) -> None:
    process = start(camera.address[1])
    output = process.finish()
    assert process.returncode == 0, output
    assert_sound(tmp_path, scene)
    assert not desk.photograph().any()


def test_an_unplugged_projector_stops_cleanly_and_is_gone_on_with(
    start: Callable[[int], Child],
    desk: Desk,
    camera: PtpIpServer,
    scene: SimulatedBench,
    tmp_path: Path,
) -> None:
    process = start(camera.address[1])
    wait_for_lines(process, tmp_path / "s", 3)
    desk.run("xrandr", "--output", PROJECTOR, "--off")
    output = process.finish()
    assert process.returncode == 1
    assert PROJECTOR in output
    assert "Traceback" not in output
    assert not desk.photograph().any()
    kept = lines(tmp_path / "s")
    assert 3 <= kept < 10
    desk.arrange()
    process = start(camera.address[1])
    output = process.finish()
    assert process.returncode == 0, output
    assert_sound(tmp_path, scene)


@pytest.mark.parametrize(
    ("misbehaviour", "survives"),
    [
        pytest.param("busy+3", True, id="busy"),
        pytest.param("lost-event+3", True, id="lost event"),
        pytest.param("cut-object+3", True, id="cut object"),
        pytest.param("unplug+3", False, id="unplugged"),
    ],
)
def test_a_camera_that_fails_loses_no_frame(
    start: Callable[[int], Child],
    seen: Callable[[CameraSettings], tuple[bytes, str]],
    scene: SimulatedBench,
    tmp_path: Path,
    misbehaviour: str,
    survives: bool,
) -> None:
    with PtpIpServer(Responder(seen, misbehaviours=[Misbehaviour.parse(misbehaviour)])) as camera:
        port = camera.address[1]
        process = start(port)
        output = process.finish()
    assert "Traceback" not in output
    assert (process.returncode == 0) is survives, output
    if not survives:
        assert lines(tmp_path / "s") == 3
        with PtpIpServer(Responder(seen), port=port):
            process = start(port)
            output = process.finish()
        assert process.returncode == 0, output
    assert_sound(tmp_path, scene)


def test_a_camera_that_got_another_address_goes_on_but_no_other_camera(
    start: Callable[[int], Child],
    seen: Callable[[CameraSettings], tuple[bytes, str]],
    scene: SimulatedBench,
    tmp_path: Path,
) -> None:
    with PtpIpServer(Responder(seen, misbehaviours=[Misbehaviour.parse("unplug+3")])) as camera:
        first = camera.address[1]
        start(first).finish()
    other = replace(d4s(), info=replace(d4s().info, serial="2"))
    with PtpIpServer(Responder(seen, other), port=first) as camera:
        process = start(camera.address[1])
        output = process.finish()
        assert process.returncode == 1
        assert "was begun with the camera Nikon Corporation D4S 0000" in " ".join(output.split())
        assert "this is Nikon Corporation D4S 2;" in " ".join(output.split())
    assert lines(tmp_path / "s") == 3
    with PtpIpServer(Responder(seen)) as camera:
        assert camera.address[1] != first
        process = start(camera.address[1])
        output = process.finish()
    assert process.returncode == 0, output
    assert_sound(tmp_path, scene)


def test_a_killed_capture_leaves_no_light_and_is_gone_on_with(
    start: Callable[[int], Child],
    desk: Desk,
    camera: PtpIpServer,
    scene: SimulatedBench,
    tmp_path: Path,
) -> None:
    process = start(camera.address[1])
    wait_for_lines(process, tmp_path / "s", 4)
    process.send_signal(signal.SIGKILL)
    process.finish()
    deadline_s = time.monotonic() + 2
    while desk.photograph().any():
        assert time.monotonic() < deadline_s
    process = start(camera.address[1])
    output = process.finish()
    assert process.returncode == 0, output
    assert_sound(tmp_path, scene)
