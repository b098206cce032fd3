"""Spoiled bytes for everything that reads bytes of a camera or a host.

Shared by the property tests and by ``scripts/fuzz_ptp``.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from drivers.ptp.codes import (
    CanonRecord,
    ContainerType,
    DataType,
    Format,
    NikonOperation,
    Operation,
    Property,
    ResponseCode,
)
from drivers.ptp.cursor import array_bytes
from drivers.ptp.datasets import DeviceInfo, ObjectInfo, StorageInfo, decode_handles
from drivers.ptp.errors import PtpError, PtpProtocolError
from drivers.ptp.ip_initiator import IpInitiator
from drivers.ptp.packets import (
    PROBE_REQUEST,
    CommandResponse,
    EventPacket,
    InitCommandRequest,
    InitEventRequest,
)
from drivers.ptp.properties import PropertyDescription
from drivers.ptp.transaction import Event, Request, Response, State
from drivers.ptp.usb_initiator import UsbInitiator
from drivers.ptp.vendor_events import (
    decode_canon_records,
    decode_nikon_events,
    encode_canon_record,
    encode_nikon_events,
)
from drivers.ptp.wire import Container
from drivers.sim.clock import SimulatedClock
from drivers.sim.ptp_responder.body import d4s
from drivers.sim.ptp_responder.darkroom import Darkroom
from drivers.sim.ptp_responder.packet_stream import OperationStream, PacketStream
from drivers.sim.ptp_responder.responder import Responder
from tests.drivers.ptp.streams import (
    GET_OBJECT,
    PAYLOAD,
    Initiator,
    check_data_phases,
    event,
    feed,
    happenings,
    ip_streams,
    response,
    usb_streams,
)

# Numbers at which parsers break: ends of ranges, header sizes, types and codes of the protocol.
_ODD_NUMBERS = (
    *(0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 16, 20, 24, 32, 33, 255, 256, 0x1009),
    *(0x2001, 0x4002, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 0x40000000, 0x40000001, 0x7FFFFFFF),
    *(0x80000000, 0xFFFFFFFE, 0xFFFFFFFF),
)


@dataclass(frozen=True, slots=True)
class Reader:
    """Something that reads bytes of a camera: what it takes, and valid examples of it."""

    read: Callable[[bytes, random.Random], object]
    examples: tuple[bytes, ...]


def _split(rng: random.Random, length: int) -> list[int]:
    ways = ([1], [length + 1], [rng.randint(1, 16)], [rng.randint(1, 600) for _ in range(5)])
    return list(rng.choice(ways))


def _read_through(make: type[Initiator]) -> Callable[[bytes, random.Random], None]:
    def read(stream: bytes, rng: random.Random) -> None:
        into = bytearray(len(PAYLOAD)) if rng.random() < 0.3 else None
        sizes = _split(rng, len(stream))
        told, raised = feed(make(), stream, sizes, into)
        if into is None:
            check_data_phases(told)
            assert (told, raised) == feed(make(), stream, [len(stream) + 1])
        _read_in_transfers(make(), stream, rng)
        if raised:
            raise PtpProtocolError("refused as it may be")

    return read


def _read_in_transfers(initiator: Initiator, stream: bytes, rng: random.Random) -> None:
    """The same with ends of transfers anywhere, and a second try after a reset."""
    initiator.send(GET_OBJECT)
    try:
        for start in range(0, len(stream), 64):
            initiator.receive_data(stream[start : start + 64], ended=rng.random() < 0.3)
    except PtpProtocolError:
        initiator.reset()
        initiator.send(GET_OBJECT)
        answer = (
            response(initiator.transaction)
            if isinstance(initiator, UsbInitiator)
            else CommandResponse(ResponseCode.OK, initiator.transaction).encode()
        )
        initiator.receive_data(answer)
        assert happenings(initiator) == [Response(ResponseCode.OK, ())]


def _read_events(make: type[Initiator]) -> Callable[[bytes, random.Random], None]:
    def read(stream: bytes, rng: random.Random) -> None:
        initiator = make()
        size = rng.randint(1, 40)
        for start in range(0, len(stream), size):
            try:
                initiator.receive_event(stream[start : start + size])
            except PtpProtocolError:
                assert initiator.state is State.READY

    return read


def _decoded(decode: Callable[[bytes], object]) -> Callable[[bytes, random.Random], None]:
    def read(stream: bytes, rng: random.Random) -> None:
        del rng
        decode(stream)

    return read


def _canon_examples() -> tuple[bytes, ...]:
    def numbers(*values: int) -> bytes:
        return b"".join(value.to_bytes(4, "little") for value in values)

    end = encode_canon_record(CanonRecord.END, b"")
    name = b"IMG_0001.CR2\0"
    records = (
        (CanonRecord.PROPERTY_VALUE, numbers(0xD102, 0x38)),
        (CanonRecord.PROPERTY_CHOICES, numbers(0xD103, 3, 3, 0x48, 0x50, 0x58)),
        (CanonRecord.OBJECT_ADDED, numbers(7, 1, 0xB103, 0, 0, 999, 0, 0) + name),
        (CanonRecord.REQUEST_OBJECT_TRANSFER, numbers(7, 0xB103, 0, 999, 0) + name),
    )
    return tuple(encode_canon_record(kind, body) + end for kind, body in records)


class _HostileHost:
    """A responder that hears every container of a run; its memory must not grow with it."""

    def __init__(self) -> None:
        self._clock = SimulatedClock()
        self._responder = Responder(
            source=lambda _: (PAYLOAD, "image/x-raw"),
            clock=self._clock,
            card_images=3,
            developer=Darkroom(),
        )

    def read(self, stream: bytes, rng: random.Random) -> None:
        """Hand one container over; the answer is data at most, then a response."""
        self._responder.handle(
            Container.with_parameters(ContainerType.COMMAND, Operation.OPEN_SESSION, 0, (1,))
        )
        if rng.random() < 0.8:
            stream = len(stream).to_bytes(4, "little") + stream[4:]
        container = Container.decode(stream)
        outputs = self._responder.handle(container)
        kinds = [output.kind for output in outputs if isinstance(output, Container)]
        assert kinds in (
            [],
            [ContainerType.RESPONSE],
            [ContainerType.DATA, ContainerType.RESPONSE],
        )
        if rng.random() < 0.1:
            self._clock.sleep(1.0)
            self._responder.due_events()


def _read_packets(stream: bytes, rng: random.Random) -> None:
    packets, operations = PacketStream(), OperationStream()
    size = rng.randint(1, 80)
    for start in range(0, len(stream), size):
        for packet in packets.receive(stream[start : start + size]):
            if not isinstance(packet, InitCommandRequest | InitEventRequest):
                operations.receive(packet)


def _commands() -> tuple[bytes, ...]:
    calls = (
        (Operation.GET_DEVICE_INFO, ()),
        (Operation.OPEN_SESSION, (1,)),
        (Operation.GET_OBJECT_HANDLES, (0xFFFFFFFF, 0, 0)),
        (Operation.GET_PARTIAL_OBJECT, (3, 5, 100)),
        (Operation.SET_DEVICE_PROP_VALUE, (Property.F_NUMBER,)),
        (Operation.INITIATE_CAPTURE, (0, 0)),
        (Operation.DELETE_OBJECT, (0xFFFFFFFF,)),
        (NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA, (0xFFFFFFFF, 0)),
        (NikonOperation.GET_EVENT, ()),
        (NikonOperation.START_LIVE_VIEW, ()),
    )
    commands = [
        Container.with_parameters(ContainerType.COMMAND, code, 5, parameters).encode()
        for code, parameters in calls
    ]
    value = Container(ContainerType.DATA, Operation.SET_DEVICE_PROP_VALUE, 5, b"\x20\x03")
    return (*commands, value.encode())


def readers() -> dict[str, Reader]:
    """Everything that reads bytes, with valid examples."""
    body = d4s()
    descriptions = tuple(d.encode() for d in body.descriptions.values())
    object_info = ObjectInfo(0x10001, Format.UNDEFINED, 12345, "DSC_0001.NEF", "20260101T000000")
    greetings = InitCommandRequest(bytes(16), "host").encode() + InitEventRequest(1).encode()
    command_stream = b"".join(IpInitiator().send(Request(0x1016, (0x5007,), b"\x20\x03")))
    events = EventPacket(0x4002, 0, (3,)).encode() + PROBE_REQUEST.encode()
    return {
        "bulk-in endpoint": Reader(_read_through(UsbInitiator), tuple(usb_streams().values())),
        "command connection": Reader(_read_through(IpInitiator), tuple(ip_streams().values())),
        "interrupt endpoint": Reader(_read_events(UsbInitiator), (event() * 3, event(()))),
        "event connection": Reader(_read_events(IpInitiator), (events * 2,)),
        "device info": Reader(_decoded(DeviceInfo.decode), (body.info.encode(),)),
        "storage info": Reader(
            _decoded(StorageInfo.decode), (StorageInfo(4, 3, 0, 1 << 35, 5, 9, "CARD").encode(),)
        ),
        "object info": Reader(_decoded(ObjectInfo.decode), (object_info.encode(),)),
        "handles": Reader(
            _decoded(decode_handles), (array_bytes(DataType.UINT32, tuple(range(40))),)
        ),
        "property description": Reader(_decoded(PropertyDescription.decode), descriptions),
        "Nikon's events": Reader(
            _decoded(decode_nikon_events),
            (encode_nikon_events([Event(0xC101, (0,)), Event(0x400D, (0,))]),),
        ),
        "Canon's records": Reader(_decoded(decode_canon_records), _canon_examples()),
        "responder": Reader(_HostileHost().read, _commands()),
        "responder's packets": Reader(_read_packets, (greetings, command_stream * 2)),
    }


def spoiled(example: bytes, rng: random.Random) -> bytes:
    """An example after one to four changes of the kinds that break parsers."""
    stream = bytearray(example)
    for _ in range(rng.randint(1, 4)):
        rng.choice(_CHANGES)(stream, rng)
    return bytes(stream)


def _set_number(stream: bytearray, rng: random.Random) -> None:
    width = rng.choice((1, 2, 4, 8))
    start = rng.randrange(max(1, len(stream) - width + 1))
    number = rng.choice(_ODD_NUMBERS) & ((1 << 8 * width) - 1)
    stream[start : start + width] = number.to_bytes(width, "little")


def _flip(stream: bytearray, rng: random.Random) -> None:
    if stream:
        stream[rng.randrange(len(stream))] ^= 1 << rng.randrange(8)


def _cut_off(stream: bytearray, rng: random.Random) -> None:
    del stream[rng.randint(0, len(stream)) :]


def _remove(stream: bytearray, rng: random.Random) -> None:
    start = rng.randint(0, len(stream))
    del stream[start : start + rng.randint(1, 16)]


def _insert(stream: bytearray, rng: random.Random) -> None:
    start = rng.randint(0, len(stream))
    stream[start:start] = rng.randbytes(rng.randint(1, 16))


def _repeat(stream: bytearray, rng: random.Random) -> None:
    start = rng.randint(0, len(stream))
    part = bytes(stream[start : start + rng.randint(1, 64)])
    stream[start:start] = part


_CHANGES = (_set_number, _set_number, _flip, _cut_off, _remove, _insert, _repeat)


def attempt(reader: Reader, rng: random.Random) -> bool:
    """Spoil an example and have it read; True when it was refused, as it may be.

    Anything raised but the package's own error goes through to the caller.
    """
    stream = spoiled(rng.choice(reader.examples), rng)
    try:
        reader.read(stream, rng)
    except PtpError:
        return True
    return False
