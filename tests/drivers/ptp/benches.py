"""A PTP camera over real pyusb, a bus without wires and the simulated body, in simulated time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.protocols import CameraSettings
from drivers.ptp.camera import PtpCamera
from drivers.ptp.discovery import open_camera
from drivers.sim.clock import SimulatedClock
from drivers.sim.dng import encode_dng
from drivers.sim.ptp_responder.body import Body
from drivers.sim.ptp_responder.darkroom import Darkroom
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from tests.drivers.ptp.usb_backend import Bus, ResponderPipe

SETTINGS = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
IMAGE_PX = (16, 20)


def picture(settings: CameraSettings) -> tuple[bytes, str]:
    """A small raw file whose tags and values tell the settings."""
    mosaic = np.full(
        (2 * IMAGE_PX[0], 2 * IMAGE_PX[1]), 600 + round(1e4 * settings.exposure_s) % 8000, np.uint16
    )
    return encode_dng(mosaic, settings), "image/x-adobe-dng"


@dataclass(frozen=True, slots=True)
class Bench:
    """Everything of which a test may want to see the inside."""

    clock: SimulatedClock
    responder: Responder
    pipe: ResponderPipe
    bus: Bus

    def number(self, code: int) -> int:
        """A property as it stands on the body."""
        return self.responder._body.properties.number(code)

    def open(self) -> PtpCamera:
        return open_camera(None, self.clock, self.bus)


def bench(
    *misbehaviours: str,
    model: Body | None = None,
    packet_bytes: int = 512,
    splits_headers: bool = False,
    card_images: int = 10,
) -> Bench:
    clock = SimulatedClock()
    responder = Responder(
        picture,
        model,
        [Misbehaviour.parse(text) for text in misbehaviours],
        clock,
        card_images,
        developer=Darkroom(),
    )
    pipe = ResponderPipe(responder, clock, packet_bytes, splits_headers)
    return Bench(clock, responder, pipe, Bus(pipe))
