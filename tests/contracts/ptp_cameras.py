"""Cameras that speak PTP, for the contract: over pyusb without wires, and over TCP on loopback."""

from __future__ import annotations

from drivers.clock import SystemClock
from drivers.protocols import CameraSettings, Clock
from drivers.ptp.camera import PtpCamera
from drivers.ptp.ip import IpLink
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.server import PtpIpServer
from tests.drivers.ptp.benches import IMAGE_PX, SETTINGS, bench, picture

REFUSED = CameraSettings(exposure_s=0.11, aperture=8.0, iso=200)
BRIEF = CameraSettings(exposure_s=0.02, aperture=8.0, iso=200)


class ServedCamera(PtpCamera):
    """A camera that takes its simulated body with it when it is closed."""

    def __init__(self, server: PtpIpServer, clock: Clock) -> None:
        self._server = server.__enter__()
        super().__init__(lambda: IpLink(*server.address), clock)

    def close(self) -> None:
        super().close()
        self._server.stop()


def ptp_over_usb() -> tuple[PtpCamera, Clock, CameraSettings, CameraSettings, tuple[int, int]]:
    at = bench()
    return at.open(), at.clock, SETTINGS, REFUSED, IMAGE_PX


def ptp_over_ip() -> tuple[PtpCamera, Clock, CameraSettings, CameraSettings, tuple[int, int]]:
    clock = SystemClock()
    camera = ServedCamera(PtpIpServer(Responder(picture)), clock)
    return camera, clock, BRIEF, REFUSED, IMAGE_PX
