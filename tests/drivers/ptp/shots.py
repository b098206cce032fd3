"""A simulated camera on a clock that can be moved, and the host before it."""

from __future__ import annotations

from drivers.protocols import CameraSettings
from drivers.ptp.codes import ContainerType, NikonOperation, ResponseCode
from drivers.ptp.transaction import Event
from drivers.ptp.wire import Container
from drivers.sim.clock import SimulatedClock
from drivers.sim.ptp_responder.answer import Output
from drivers.sim.ptp_responder.body import d4s, plain
from drivers.sim.ptp_responder.darkroom import Darkroom
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from tests.drivers.ptp.host import Host

CAPTURE = NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA
NO_AF, AF = 0xFFFFFFFF, 0xFFFFFFFE
CARD, SDRAM = 0, 1
RAW_FILE = b"raw" * 100
ALL = 0xFFFFFFFF


class Bench:
    """A camera on a clock that can be moved, and the host before it."""

    def __init__(
        self,
        *misbehaviours: str,
        body: str = "d4s",
        card_images: int = 9,
        autofocus_finds: bool = True,
        piece: int = 512,
    ) -> None:
        self.clock = SimulatedClock()
        self.asked: list[CameraSettings] = []
        self.responder = Responder(
            self.shoot,
            d4s() if body == "d4s" else plain(),
            [Misbehaviour.parse(text) for text in misbehaviours],
            self.clock,
            card_images,
            autofocus_finds,
            Darkroom(),
        )
        self.host = Host(self.responder, piece)

    def shoot(self, settings: CameraSettings) -> tuple[bytes, str]:
        self.asked.append(settings)
        return RAW_FILE, "image/x-raw"

    def capture(self, target: int) -> list[Event]:
        """A whole shot; what the host is told of it."""
        assert self.host.call(CAPTURE, NO_AF, target).code == ResponseCode.OK
        self.clock.sleep(1.0)
        return self.host.listed_events()


def outputs(bench: Bench, code: int, *parameters: int) -> list[Output]:
    """What the camera gives its transport in answer to transaction 9."""
    command = Container.with_parameters(ContainerType.COMMAND, code, 9, parameters)
    return bench.responder.handle(command)
