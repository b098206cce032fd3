"""The host's end of PTP/IP: what it sends, and what it makes of packets however they are split."""

from __future__ import annotations

import tracemalloc

import pytest

from drivers.ptp.codes import UNDEFINED_TOTAL, Operation, PacketType, ResponseCode
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.ip_initiator import IpInitiator
from drivers.ptp.packets import (
    INIT_EVENT_ACK,
    MAX_PACKET_BYTES,
    PROBE_REQUEST,
    PROBE_RESPONSE,
    CommandResponse,
    EventPacket,
    StartData,
    packet_bytes,
)
from drivers.ptp.transaction import (
    DataChunk,
    DataEnded,
    DataStarted,
    Event,
    Happening,
    ProbeAnswered,
    Probed,
    Request,
    Response,
    State,
    Stray,
)
from drivers.ptp.wire import MAX_DATA_BYTES
from tests.drivers.ptp.streams import GET_OBJECT, PAYLOAD, feed, happenings, ip_streams, packets

OK = Response(ResponseCode.OK, ())
DONE = CommandResponse(ResponseCode.OK, 0).encode()


def whole(payload: bytes, total: int | None) -> list[Happening]:
    chunks: list[Happening] = [DataChunk(memoryview(payload))] if payload else []
    return [DataStarted(total), *chunks, DataEnded(len(payload), whole=True)]


EXPECTED: dict[str, list[Happening]] = {
    "data and response": [*whole(PAYLOAD, len(PAYLOAD)), OK],
    "no data": [Response(ResponseCode.OK, (1, 2, 3, 4, 5))],
    "empty data": [*whole(b"", 0), OK],
    "stray data first": [
        Stray(PacketType.START_DATA, 77),
        Stray(PacketType.DATA, 77),
        Stray(PacketType.END_DATA, 77),
        Stray(ResponseCode.OK, 77),
        *whole(b"new", 3),
        OK,
    ],
    "event and probe between": [
        *whole(PAYLOAD, len(PAYLOAD)),
        Event(0x4002, (3,)),
        Probed(),
        ProbeAnswered(),
        OK,
    ],
    "undefined total": [*whole(PAYLOAD, None), OK],
    "cancelled": [DataStarted(9), DataEnded(0, whole=False), OK],
    "answer amid the data": [DataStarted(9), DataEnded(0, whole=False), OK],
}


@pytest.mark.parametrize("name", EXPECTED)
def test_streams_are_told_alike_however_they_are_split(name: str) -> None:
    stream = ip_streams()[name]
    for size in range(1, len(stream) + 1):
        assert feed(IpInitiator(), stream, [size]) == (EXPECTED[name], False), size


@pytest.mark.parametrize("name", ["data and response", "event and probe between"])
def test_data_land_in_the_callers_buffer_however_they_are_split(name: str) -> None:
    stream = ip_streams()[name]
    for size in range(1, len(stream) + 1):
        into = bytearray(len(PAYLOAD))
        told, raised = feed(IpInitiator(), stream, [size], into)
        assert not raised
        assert into == PAYLOAD
        assert told == [each for each in EXPECTED[name] if not isinstance(each, DataChunk)]


def test_operations_are_sent_as_the_standard_has_them() -> None:
    initiator = IpInitiator()
    assert initiator.send(Request(Operation.OPEN_SESSION, (1,))) == [
        bytes.fromhex("16000000 06000000 01000000 0210 00000000 01000000")
    ]
    initiator.receive_data(DONE)
    assert initiator.send(Request(Operation.SET_DEVICE_PROP_VALUE, (0x5007,), b"\x20\x03")) == [
        bytes.fromhex("16000000 06000000 02000000 1610 01000000 07500000"),
        bytes.fromhex("14000000 09000000 01000000 0200000000000000"),
        bytes.fromhex("0e000000 0c000000 01000000 2003"),
    ]


def number(value: int) -> bytes:
    return value.to_bytes(4, "little")


OUT_OF_STEP = {
    "no such type": number(8) + number(15),
    "not PTP/IP": b"HTTP/1.1 200 OK\r\n",
    "shorter than its header": number(7) + number(7),
    "a response without end": number(MAX_PACKET_BYTES + 1) + number(7),
    "a response cut short": number(9) + number(7) + b"\0",
    "more data than can be meant": StartData(0, MAX_DATA_BYTES + 1).encode(),
    "data without announcement": packet_bytes(PacketType.DATA, number(0), b"data"),
    "more data than announced": StartData(0, 3).encode()
    + packet_bytes(PacketType.DATA, number(0), b"data"),
    "announced twice": StartData(0, 3).encode() * 2,
    "data after the end": packets(b"data") + packet_bytes(PacketType.DATA, number(0), b"data"),
    "a greeting amid": INIT_EVENT_ACK.encode(),
    "six parameters": packet_bytes(PacketType.COMMAND_RESPONSE, bytes(6 + 24)),
}


@pytest.mark.parametrize("name", OUT_OF_STEP)
def test_what_is_not_ptp_breaks_the_conversation_until_reset(name: str) -> None:
    initiator = IpInitiator()
    initiator.send(GET_OBJECT)
    with pytest.raises(PtpProtocolError):
        initiator.receive_data(OUT_OF_STEP[name])
    assert initiator.state is State.BROKEN
    with pytest.raises(PtpProtocolError, match="reset"):
        initiator.receive_data(DONE)
    initiator.reset()
    initiator.send(GET_OBJECT)
    initiator.receive_data(DONE)
    assert happenings(initiator) == [OK]


def test_an_undefined_total_does_not_overrun_the_buffer() -> None:
    into = bytearray(len(PAYLOAD) - 1)
    initiator = IpInitiator()
    initiator.send(GET_OBJECT, into)
    with pytest.raises(PtpProtocolError, match="were expected"):
        initiator.receive_data(packets(PAYLOAD, total=UNDEFINED_TOTAL))


@pytest.mark.parametrize("size", range(1, 50))
def test_events_come_in_pieces_of_any_size(size: int) -> None:
    initiator = IpInitiator()
    stream = b"".join(
        (
            EventPacket(0x4002, 0, (3,)).encode(),
            PROBE_REQUEST.encode(),
            PROBE_RESPONSE.encode(),
            EventPacket(0x400D, 9).encode(),
        )
    )
    for start in range(0, len(stream), size):
        initiator.receive_event(stream[start : start + size])
    assert happenings(initiator) == [
        Event(0x4002, (3,)),
        Probed(),
        ProbeAnswered(),
        Event(0x400D, ()),
    ]


def test_what_is_no_event_is_forgotten_and_the_transaction_goes_on() -> None:
    initiator = IpInitiator()
    initiator.send(GET_OBJECT)
    with pytest.raises(PtpProtocolError, match="among the events"):
        initiator.receive_event(DONE)
    initiator.receive_event(EventPacket(0x4002, 0, (3,)).encode())
    initiator.receive_data(DONE)
    assert happenings(initiator) == [Event(0x4002, (3,)), OK]


def test_twenty_megabytes_are_held_once() -> None:
    size, block = 20_000_000, 1 << 20
    into = bytearray(size)
    initiator = IpInitiator()
    initiator.send(GET_OBJECT, into)
    tracemalloc.start()
    initiator.receive_data(StartData(0, size).encode())
    for start in range(0, size, block):
        length = min(block, size - start)
        initiator.receive_data(number(12 + length) + number(PacketType.DATA) + number(0))
        while (window := initiator.writable()) is not None:
            initiator.wrote(min(65_536, len(window)))
    initiator.receive_data(packet_bytes(PacketType.END_DATA, number(0)) + DONE)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert happenings(initiator) == [DataStarted(size), DataEnded(size, whole=True), OK]
    assert peak_bytes < 64_000
