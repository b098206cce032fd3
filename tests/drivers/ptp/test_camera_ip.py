"""The camera over TCP on loopback against the simulated body; the contract holds for it as well."""

from __future__ import annotations

import pytest

from drivers.clock import SystemClock
from drivers.errors import CameraError, CameraTimeoutError
from drivers.protocols import CameraSettings
from drivers.ptp.camera import PtpCamera
from drivers.ptp.discovery import open_camera
from drivers.sim.clock import SimulatedClock
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.server import PtpIpServer
from tests.drivers.ptp.benches import picture

SETTINGS = CameraSettings(exposure_s=0.02, aperture=8.0, iso=200)
EXPECTED, _ = picture(SETTINGS)


def serve(*wrong: str) -> tuple[PtpIpServer, Responder]:
    responder = Responder(picture, None, [Misbehaviour.parse(text) for text in wrong])
    return PtpIpServer(responder), responder


def open_at(server: PtpIpServer) -> PtpCamera:
    host, port = server.address
    return open_camera(f"ptpip:{host}:{port}", SystemClock())


@pytest.mark.parametrize("wrong", ["cut-object", "stale-answer@1009", "odd-event", "busy@9207*2"])
def test_faults_of_which_the_program_need_not_know(wrong: str) -> None:
    server, responder = serve(wrong)
    with server:
        with open_at(server) as camera:
            for _ in range(2):
                assert camera.capture(SETTINGS).data == EXPECTED
        assert not responder.is_remote
        assert not responder.is_open


def test_after_garbage_the_next_try_succeeds() -> None:
    server, _ = serve("garbage@1009")
    with server, open_at(server) as camera:
        with pytest.raises(CameraTimeoutError):
            camera.capture(SETTINGS)
        assert camera.capture(SETTINGS).data == EXPECTED


def test_a_camera_that_vanishes_stops_the_capture() -> None:
    server, _ = serve("unplug@1009")
    host, port = server.address
    with (
        server,
        open_camera(f"ptpip:{host}:{port}", SimulatedClock()) as camera,
        pytest.raises(CameraError, match="every frame before this one is safe"),
    ):
        camera.capture(SETTINGS)


@pytest.mark.parametrize("text", ["ptpip:", "ptpip:host:port", "ptpip::15740"])
def test_an_address_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(CameraError, match="ptpip:HOST"):
        open_camera(text)
