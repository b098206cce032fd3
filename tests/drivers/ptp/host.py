"""The driver's USB end talking to the simulated camera in memory, in pieces of any size."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.ptp.codes import ContainerType, Operation, ResponseCode
from drivers.ptp.cursor import Cursor, PropertyValue, value_bytes
from drivers.ptp.properties import PropertyDescription
from drivers.ptp.transaction import DataChunk, Event, NeedData, Request, Response
from drivers.ptp.usb_initiator import UsbInitiator
from drivers.ptp.vendor_events import decode_nikon_events
from drivers.ptp.wire import Container
from drivers.sim.ptp_responder.responder import Responder


@dataclass(frozen=True, slots=True)
class Reply:
    """What came back from one operation."""

    code: int
    parameters: tuple[int, ...]
    data: bytes


class Host:
    """A host that has opened a session.

    Parameters
    ----------
    responder
        The camera.
    piece
        Size of the pieces in which its bytes arrive.
    """

    def __init__(self, responder: Responder, piece: int = 512) -> None:
        self.responder = responder
        self.piece = piece
        self.initiator = UsbInitiator()
        assert self.call(Operation.OPEN_SESSION, 1).code == ResponseCode.OK

    def call(self, code: int, *parameters: int, data: bytes | None = None) -> Reply:
        """One operation, from first byte to last."""
        gathered = bytearray()
        answers: list[Response] = []
        for block in self.initiator.send(Request(code, parameters, data)):
            for output in self.responder.handle(Container.decode(block)):
                assert isinstance(output, Container)
                stream = output.encode()
                for start in range(0, len(stream), self.piece):
                    self.initiator.receive_data(stream[start : start + self.piece])
                    answers += self._take(gathered)
        (answer,) = answers
        return Reply(answer.code, answer.parameters, bytes(gathered))

    def fetch(self, code: int, *parameters: int) -> bytes:
        """The data of an operation that must succeed."""
        reply = self.call(code, *parameters)
        assert reply.code == ResponseCode.OK, hex(reply.code)
        return reply.data

    def describe(self, code: int) -> PropertyDescription:
        """A property's description."""
        return PropertyDescription.decode(self.fetch(Operation.GET_DEVICE_PROP_DESC, code))

    def value(self, code: int) -> PropertyValue:
        """A property's value."""
        data = self.fetch(Operation.GET_DEVICE_PROP_VALUE, code)
        return Cursor(data, "value").value(self.describe(code).kind)

    def set(self, code: int, value: PropertyValue) -> int:
        """Set a property; the response."""
        data = value_bytes(self.describe(code).kind, value)
        return self.call(Operation.SET_DEVICE_PROP_VALUE, code, data=data).code

    def listed_events(self) -> list[Event]:
        """Nikon's list of events without the noise of changed properties."""
        events = decode_nikon_events(self.fetch(0x90C7))
        return [event for event in events if event.code != 0x4006]

    def pushed_events(self) -> list[Event]:
        """What the camera sends by itself."""
        for container in self.responder.due_events():
            assert container.kind is ContainerType.EVENT
            self.initiator.receive_event(container.encode())
        events = []
        while not isinstance(happening := self.initiator.next_event(), NeedData):
            assert isinstance(happening, Event)
            events.append(happening)
        return events

    def _take(self, gathered: bytearray) -> list[Response]:
        """Gather the data that have come; the responses among them."""
        answers = []
        while not isinstance(happening := self.initiator.next_event(), NeedData):
            if isinstance(happening, DataChunk):
                gathered += happening.data
            elif isinstance(happening, Response):
                answers.append(happening)
        return answers
