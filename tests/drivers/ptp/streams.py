"""Byte streams that a camera may send after GetObject, and feeding them to an initiator."""

from __future__ import annotations

from drivers.ptp.codes import (
    UNDEFINED_LENGTH,
    UNDEFINED_TOTAL,
    ContainerType,
    Operation,
    PacketType,
    ResponseCode,
)
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.ip_initiator import IpInitiator
from drivers.ptp.packets import (
    PROBE_REQUEST,
    PROBE_RESPONSE,
    Cancel,
    CommandResponse,
    EventPacket,
    StartData,
    packet_bytes,
)
from drivers.ptp.transaction import (
    DataChunk,
    DataEnded,
    DataStarted,
    Happening,
    NeedData,
    Request,
    State,
)
from drivers.ptp.usb_initiator import UsbInitiator
from drivers.ptp.wire import Container, Header

Initiator = UsbInitiator | IpInitiator
PAYLOAD = bytes(range(256)) + b"tail" * 11
GET_OBJECT = Request(Operation.GET_OBJECT, (3,))


def data(payload: bytes, transaction: int = 0, code: int = Operation.GET_OBJECT) -> bytes:
    """A data container."""
    return Container(ContainerType.DATA, code, transaction, payload).encode()


def response(transaction: int = 0, parameters: tuple[int, ...] = ()) -> bytes:
    """A response container that says OK."""
    return Container.with_parameters(
        ContainerType.RESPONSE, ResponseCode.OK, transaction, parameters
    ).encode()


def event(parameters: tuple[int, ...] = (3,)) -> bytes:
    """An event container: an object was added."""
    return Container.with_parameters(ContainerType.EVENT, 0x4002, 0, parameters).encode()


def packets(payload: bytes, transaction: int = 0, total: int | None = None) -> bytes:
    """The data phase of PTP/IP, in three packets."""
    number = transaction.to_bytes(4, "little")
    half = len(payload) // 2
    announced = len(payload) if total is None else total
    return b"".join(
        (
            StartData(transaction, announced).encode(),
            packet_bytes(PacketType.DATA, number, payload[:half]),
            packet_bytes(PacketType.END_DATA, number, payload[half:]),
        )
    )


def usb_streams() -> dict[str, bytes]:
    """What may come through a bulk-in endpoint after GetObject was sent as transaction 0."""
    undefined = Header(UNDEFINED_LENGTH, ContainerType.DATA, Operation.GET_OBJECT, 0).encode()
    return {
        "data and response": data(PAYLOAD) + response(),
        "no data": response(parameters=(1, 2, 3, 4, 5)),
        "empty data": data(b"") + response(),
        "stray response first": response(77) + data(PAYLOAD) + response(),
        "stray data first": data(b"old", 77) + response(77) + data(b"new") + response(),
        "event between": data(PAYLOAD) + event() + response(),
        "undefined length": undefined + PAYLOAD,
        "surplus": data(PAYLOAD) + response() + event() + response(1),
    }


def ip_streams() -> dict[str, bytes]:
    """What may come through a command connection after GetObject was sent as transaction 0."""
    done = CommandResponse(ResponseCode.OK, 0).encode()
    return {
        "data and response": packets(PAYLOAD) + done,
        "no data": CommandResponse(ResponseCode.OK, 0, (1, 2, 3, 4, 5)).encode(),
        "empty data": packets(b"") + done,
        "stray data first": packets(b"old", 77)
        + CommandResponse(ResponseCode.OK, 77).encode()
        + packets(b"new")
        + done,
        "event and probe between": packets(PAYLOAD)
        + EventPacket(0x4002, 0, (3,)).encode()
        + PROBE_REQUEST.encode()
        + PROBE_RESPONSE.encode()
        + done,
        "undefined total": packets(PAYLOAD, total=UNDEFINED_TOTAL) + done,
        "cancelled": StartData(0, 9).encode() + Cancel(0).encode() + done,
        "answer amid the data": StartData(0, 9).encode() + done,
    }


def happenings(initiator: Initiator) -> list[Happening]:
    """All that the initiator has to tell, chunks joined into one."""
    told: list[Happening] = []
    chunks: list[bytes] = []
    while not isinstance(happening := initiator.next_event(), NeedData):
        if isinstance(happening, DataChunk):
            chunks.append(bytes(happening.data))
            continue
        if chunks:
            told.append(DataChunk(memoryview(b"".join(chunks))))
            chunks.clear()
        told.append(happening)
    return [*told, DataChunk(memoryview(b"".join(chunks)))] if chunks else told


def feed(
    initiator: Initiator, stream: bytes, sizes: list[int], into: bytearray | None = None
) -> tuple[list[Happening], bool]:
    """Feed a stream in pieces of the given sizes, over and over; (events, whether it raised).

    With `into` the pieces go through `writable` wherever it offers room.
    """
    initiator.send(GET_OBJECT, into)
    at = turn = 0
    told: list[Happening] = []
    try:
        while at < len(stream):
            piece = stream[at : at + sizes[turn % len(sizes)]]
            turn += 1
            window = initiator.writable()
            if window is None:
                initiator.receive_data(piece)
            else:
                piece = piece[: len(window)]
                window[: len(piece)] = piece
                initiator.wrote(len(piece))
            at += len(piece)
            told += happenings(initiator)
    except PtpProtocolError:
        assert initiator.state is State.BROKEN
        return joined(told + happenings(initiator)), True
    return joined(told), False


def joined(told: list[Happening]) -> list[Happening]:
    """The same with neighbouring chunks joined."""
    out: list[Happening] = []
    for happening in told:
        last = out[-1] if out else None
        if isinstance(happening, DataChunk) and isinstance(last, DataChunk):
            out[-1] = DataChunk(memoryview(bytes(last.data) + bytes(happening.data)))
        else:
            out.append(happening)
    return out


def check_data_phases(told: list[Happening]) -> None:
    """What is told of data agrees with itself."""
    total: int | None = None
    size = 0
    for happening in told:
        match happening:
            case DataStarted(announced):
                total, size = announced, 0
            case DataChunk(chunk):
                size += len(chunk)
            case DataEnded(ended_after, whole):
                assert ended_after == size
                assert whole == (total is None or size == total)
            case _:
                pass
