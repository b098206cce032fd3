"""``lumisplit bench`` on a real window: the desktop is never projected between two uses."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from acquire.bench_file import LabBench
from acquire.plan_file import parse_plan
from acquire.rig import Resumption
from acquire.rig.lab import lab_bench
from acquire.session import Session
from drivers.clock import SystemClock
from drivers.lamp_commands import LampState
from drivers.protocols import CameraSettings
from drivers.sim.devices import SimulationConfig, build
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.server import PtpIpServer
from tests.acquire.page.pages import Client
from tests.acquire.page.programs import Program
from tests.drivers.projector_ports import Lamp, PjLinkPort
from tests.drivers.serial_device import Device, connected
from tests.screens.desk import PROJECTOR, Desk

PLAN = "[pattern]\npitch_px = [16, 24]\nshifts = [2, 2]\n[projector]\nsettle_s = 0.02\n"
DESKTOP = (48, 80, 160)


@pytest.fixture
def camera(desk: Desk) -> Iterator[PtpIpServer]:
    scene = build(SimulationConfig("corner", camera_px=(16, 24), projector_px=desk.projector_px))

    def source(settings: CameraSettings) -> tuple[bytes, str]:
        raster = desk.projector_screen(desk.photograph())[..., 0]
        scene.projector.show(np.ascontiguousarray(raster))
        frame = scene.camera.capture(settings)
        return frame.data, frame.media_type

    with PtpIpServer(Responder(source)) as server:
        yield server


def start(desk: Desk, folder: Path, port: int) -> Program:
    bench = (
        f'kind = "lab"\n[projector]\nmonitor = "{PROJECTOR}"\n'
        f'[camera]\naddress = "ptpip:127.0.0.1:{port}"\n'
    )
    return Program(folder, PLAN, bench, "bench", environment=desk.environment)


def shows_desktop(desk: Desk) -> bool:
    """Rasters are grey; the desktop of this test is not."""
    screen = desk.projector_screen(desk.photograph())
    return bool((screen == DESKTOP).all(axis=2).any())


@contextmanager
def watched(desk: Desk) -> Iterator[list[bool]]:
    """Photographs of what is projected, one after the other: whether they show the desktop."""
    seen: list[bool] = []
    over = threading.Event()

    def watch() -> None:
        while not over.is_set():
            seen.append(shows_desktop(desk))

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield seen
    finally:
        over.set()
        thread.join()


def captures(viewer: Client, frames: int) -> None:
    viewer.until(
        lambda state: state["activity"] == "capturing" and state["progress"]["done"] >= frames
    )


def test_aiming_and_capturing_in_turn_with_one_window(
    desk: Desk, camera: PtpIpServer, tmp_path: Path
) -> None:
    desk.run("xsetroot", "-solid", "#{:02x}{:02x}{:02x}".format(*DESKTOP))
    assert shows_desktop(desk)
    program = start(desk, tmp_path, camera.address[1])
    viewer = program.viewer()
    viewer.shows("black")
    with watched(desk) as seen:
        viewer.ask(do="start")
        captures(viewer, 3)
        viewer.ask(do="stop")
        viewer.does("aiming")
        assert not desk.projector_screen(desk.photograph()).any()
        viewer.ask(do="show", what="white")
        viewer.shows("white")
        assert desk.projector_screen(desk.photograph()).all()
        viewer.ask(do="start")
        captures(viewer, 4)
        viewer.does("aiming")
        viewer.ask(do="start-new")
        captures(viewer, 2)
        assert viewer.state["session"] == "s-2"
        viewer.ask(do="stop")
        viewer.does("aiming")
    assert len(seen) > 10
    assert not any(seen)
    program.process.send_signal(signal.SIGTERM)
    viewer.does("ended")
    viewer.close()
    output = program.end()
    assert program.process.returncode == 0, output
    assert Session.open(tmp_path / "s").complete
    assert 2 <= len(Session.open(tmp_path / "s-2").frames) < len(Session.open(tmp_path / "s").plan)
    assert shows_desktop(desk)


class HastyClock(SystemClock):
    """A hundred times as fast, for a lamp that cools down for a minute."""

    def now(self) -> float:
        return 100 * super().now()


@pytest.mark.parametrize("captures", [False, True], ids=["only aimed", "captured"])
def test_the_lamp_goes_off_after_captures_only(
    desk: Desk, camera: PtpIpServer, captures: bool
) -> None:
    lamp = Lamp(HastyClock(), goal=LampState.ON)
    plan = parse_plan(PLAN, "a test's plan")
    section = {"commands": "pjlink-serial", "off_afterwards": True, "warm_up_s": 0}
    with connected(Device(PjLinkPort(lamp).answer, b"\r", {})) as device:
        bench = lab_bench(
            LabBench.model_validate(
                {
                    "kind": "lab",
                    "projector": {"monitor": PROJECTOR},
                    "camera": {"address": f"ptpip:127.0.0.1:{camera.address[1]}"},
                    "lamp": section | {"port": device.port},
                }
            )
        )
        assert bench.closes_when_complete
        with bench.held(plan) as held:
            with held.aim(Resumption(plan)) as aiming:
                aiming.projector.show(np.full(desk.projector_px, 255, np.uint8))
            assert not desk.projector_screen(desk.photograph()).any()
            if captures:
                with held.open(Resumption(plan)) as capturing:
                    assert capturing.projector is aiming.projector
                    assert capturing.camera is aiming.camera
            assert lamp.goal is LampState.ON
        assert lamp.goal is (LampState.OFF if captures else LampState.ON)
