"""The host's end of USB: what it sends, and what it makes of what cameras really send."""

from __future__ import annotations

import tracemalloc

import pytest

from drivers.ptp.codes import UNDEFINED_LENGTH, ContainerType, Operation, ResponseCode
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.transaction import (
    DataChunk,
    DataEnded,
    DataStarted,
    Event,
    Happening,
    NeedData,
    Request,
    Response,
    State,
    Stray,
)
from drivers.ptp.usb_initiator import UsbInitiator
from drivers.ptp.wire import MAX_DATA_BYTES, Header
from tests.drivers.ptp.streams import (
    GET_OBJECT,
    PAYLOAD,
    data,
    event,
    feed,
    happenings,
    response,
    usb_streams,
)

OK = Response(ResponseCode.OK, ())
PACKET = 512


def chunk(payload: bytes) -> DataChunk:
    return DataChunk(memoryview(payload))


def whole(payload: bytes) -> list[Happening]:
    size = len(payload)
    chunks: list[Happening] = [chunk(payload)] if payload else []
    return [DataStarted(size), *chunks, DataEnded(size, whole=True)]


def asked(request: Request = GET_OBJECT, into: bytearray | None = None) -> UsbInitiator:
    initiator = UsbInitiator()
    initiator.send(request, into)
    return initiator


def data_header(length: int, transaction: int = 0) -> bytes:
    return Header(length, ContainerType.DATA, Operation.GET_OBJECT, transaction).encode()


EXPECTED: dict[str, list[Happening]] = {
    "data and response": [*whole(PAYLOAD), OK],
    "no data": [Response(ResponseCode.OK, (1, 2, 3, 4, 5))],
    "empty data": [*whole(b""), OK],
    "stray response first": [Stray(ResponseCode.OK, 77), *whole(PAYLOAD), OK],
    "stray data first": [
        Stray(Operation.GET_OBJECT, 77),
        Stray(ResponseCode.OK, 77),
        *whole(b"new"),
        OK,
    ],
    "event between": [*whole(PAYLOAD), Event(0x4002, (3,)), OK],
    "undefined length": [DataStarted(None), chunk(PAYLOAD)],
    "surplus": [*whole(PAYLOAD), OK, Event(0x4002, (3,)), Stray(ResponseCode.OK, 1)],
}


@pytest.mark.parametrize("name", EXPECTED)
def test_streams_are_told_alike_however_they_are_split(name: str) -> None:
    stream = usb_streams()[name]
    for size in range(1, len(stream) + 1):
        assert feed(UsbInitiator(), stream, [size]) == (EXPECTED[name], False), size


@pytest.mark.parametrize("name", ["data and response", "stray data first", "event between"])
def test_data_land_in_the_callers_buffer_however_they_are_split(name: str) -> None:
    stream = usb_streams()[name]
    payload = b"new" if name == "stray data first" else PAYLOAD
    for size in range(1, len(stream) + 1):
        into = bytearray(len(payload))
        told, raised = feed(UsbInitiator(), stream, [size], into)
        assert not raised
        assert into == payload
        assert told == [each for each in EXPECTED[name] if not isinstance(each, DataChunk)]


def test_operations_are_sent_as_the_standard_has_them() -> None:
    initiator = UsbInitiator()
    assert initiator.send(Request(Operation.OPEN_SESSION, (1,))) == [
        bytes.fromhex("10000000 0100 0210 00000000 01000000")
    ]
    initiator.receive_data(response())
    assert initiator.send(Request(Operation.SET_DEVICE_PROP_VALUE, (0x5007,), b"\x20\x03")) == [
        bytes.fromhex("10000000 0100 1610 01000000 07500000"),
        bytes.fromhex("0e000000 0200 1610 01000000 2003"),
    ]


def test_transactions_count_from_the_session_on() -> None:
    initiator = UsbInitiator()
    numbers = []
    for code in (0x1001, 0x1001, Operation.OPEN_SESSION, 0x1004, 0x1007, Operation.OPEN_SESSION, 1):
        initiator.send(Request(code, (1,)))
        numbers.append(initiator.transaction)
        initiator.receive_data(response(initiator.transaction))
    assert numbers == [0, 0, 0, 1, 2, 0, 1]


def test_a_header_may_travel_alone_in_12_bytes() -> None:
    initiator = asked()
    stream = data(PAYLOAD)
    initiator.receive_data(stream[:12], ended=True)
    initiator.receive_data(stream[12:], ended=True)
    initiator.receive_data(response(), ended=True)
    assert happenings(initiator) == [*whole(PAYLOAD), OK]


def test_an_empty_first_read_and_the_empty_packet_after_full_ones_say_nothing() -> None:
    initiator = asked()
    payload = bytes(2 * PACKET - 12)
    initiator.receive_data(b"", ended=True)
    initiator.receive_data(data(payload))
    initiator.receive_data(b"", ended=True)
    initiator.receive_data(response(), ended=True)
    assert happenings(initiator) == [*whole(payload), OK]


@pytest.mark.parametrize("size", [1, 100, PACKET - 12, 2 * PACKET - 12])
def test_data_of_undefined_length_end_with_a_short_packet(size: int) -> None:
    initiator = asked()
    payload = PAYLOAD.ljust(size, b".")[:size]
    stream = data_header(UNDEFINED_LENGTH) + payload
    for start in range(0, len(stream), PACKET):
        packet = stream[start : start + PACKET]
        initiator.receive_data(packet, ended=len(packet) < PACKET)
    if len(stream) % PACKET == 0:
        initiator.receive_data(b"", ended=True)
    initiator.receive_data(response(), ended=True)
    assert happenings(initiator) == [
        DataStarted(None),
        chunk(payload),
        DataEnded(size, whole=True),
        OK,
    ]


@pytest.mark.parametrize("cut", [1, 100, PACKET - 12], ids=["1", "100", "a full packet"])
def test_an_object_that_is_cut_short_is_told_as_such(cut: int) -> None:
    initiator = asked()
    initiator.receive_data(data_header(12 + 5000) + bytes(cut), ended=(12 + cut) % PACKET != 0)
    if (12 + cut) % PACKET == 0:
        initiator.receive_data(b"", ended=True)
    initiator.receive_data(response(), ended=True)
    assert happenings(initiator) == [
        DataStarted(5000),
        chunk(bytes(cut)),
        DataEnded(cut, whole=False),
        OK,
    ]


def test_after_a_reset_the_late_answer_is_a_stray() -> None:
    initiator = UsbInitiator()
    initiator.send(Request(Operation.OPEN_SESSION, (1,)))
    initiator.receive_data(response())
    initiator.send(GET_OBJECT)
    initiator.reset()
    initiator.send(GET_OBJECT)
    initiator.receive_data(data(b"late", 1) + response(1) + data(b"now", 2) + response(2))
    assert happenings(initiator) == [
        Stray(Operation.GET_OBJECT, 1),
        Stray(ResponseCode.OK, 1),
        *whole(b"now"),
        OK,
    ]


def test_data_of_another_operation_with_the_same_number_are_stray() -> None:
    initiator = asked()
    initiator.receive_data(data(b"thumbnail", 0, Operation.GET_THUMB) + data(b"it") + response())
    assert happenings(initiator) == [Stray(Operation.GET_THUMB, 0), *whole(b"it"), OK]


OUT_OF_STEP = {
    "no such type": bytes.fromhex("0c000000 0500 0120 00000000"),
    "shorter than its header": bytes.fromhex("0b000000 0300 0120 00000000"),
    "more than five parameters": bytes.fromhex("24000000 0300 0120 00000000") + bytes(24),
    "half a parameter": bytes.fromhex("0e000000 0300 0120 00000000") + bytes(2),
    "a command": bytes.fromhex("0c000000 0100 0110 00000000"),
    "data twice": data(b"a") + data(b"b"),
    "more data than can be meant": data_header(MAX_DATA_BYTES + 1),
    "picture data without a header": b"\xff\xd8\xff\xe0" * 4,
}


@pytest.mark.parametrize("name", OUT_OF_STEP)
def test_what_is_not_ptp_breaks_the_conversation_until_reset(name: str) -> None:
    initiator = asked()
    with pytest.raises(PtpProtocolError):
        initiator.receive_data(OUT_OF_STEP[name])
    assert initiator.state is State.BROKEN
    with pytest.raises(PtpProtocolError, match="reset"):
        initiator.receive_data(response())
    with pytest.raises(PtpProtocolError, match="reset"):
        initiator.send(GET_OBJECT)
    initiator.reset()
    initiator.send(GET_OBJECT)
    initiator.receive_data(response())
    assert happenings(initiator) == [OK]


def test_a_transfer_that_ends_within_a_header_is_refused() -> None:
    initiator = asked()
    with pytest.raises(PtpProtocolError, match="after 7 bytes"):
        initiator.receive_data(response()[:7], ended=True)


def test_more_data_than_the_buffer_holds_are_refused_before_they_come() -> None:
    initiator = asked(into=bytearray(99))
    with pytest.raises(PtpProtocolError, match="100 bytes of data announced where 99"):
        initiator.receive_data(data_header(12 + 100))


def test_data_of_undefined_length_do_not_overrun_the_buffer() -> None:
    into = bytearray(99)
    initiator = asked(into=into)
    initiator.receive_data(data_header(UNDEFINED_LENGTH) + bytes(99))
    with pytest.raises(PtpProtocolError):
        initiator.receive_data(b"x")
    assert into == bytes(99)


def test_the_window_is_whole_packets_and_never_past_the_data() -> None:
    into = bytearray(3000)
    initiator = asked(into=into)
    assert initiator.writable(PACKET) is None
    initiator.receive_data(data_header(12 + 3000) + bytes(500))
    window = initiator.writable(PACKET)
    assert window is not None
    assert len(window) == 4 * PACKET
    with pytest.raises(ValueError, match="2501 bytes written where 2500"):
        initiator.wrote(2501)
    window[:] = b"w" * len(window)
    initiator.wrote(len(window))
    assert initiator.writable(PACKET) is None
    rest = 3000 - 500 - 4 * PACKET
    initiator.receive_data(b"r" * rest + response())
    assert into == bytes(500) + b"w" * (4 * PACKET) + b"r" * rest
    assert happenings(initiator) == [DataStarted(3000), DataEnded(3000, whole=True), OK]


@pytest.mark.parametrize("size", range(1, 49))
def test_events_come_in_pieces_of_any_size(size: int) -> None:
    initiator = UsbInitiator()
    stream = event((1,)) + event(()) + event((1, 2, 3))
    for start in range(0, len(stream), size):
        initiator.receive_event(stream[start : start + size])
    told = happenings(initiator)
    assert told == [Event(0x4002, (1,)), Event(0x4002, ()), Event(0x4002, (1, 2, 3))]


def test_what_is_no_event_is_forgotten_and_the_transaction_goes_on() -> None:
    initiator = asked()
    with pytest.raises(PtpProtocolError, match="response among the events"):
        initiator.receive_event(response() + event())
    initiator.receive_event(event())
    initiator.receive_data(response())
    assert happenings(initiator) == [Event(0x4002, (3,)), OK]


def receive_object(size: int, into: bytearray) -> None:
    """Parse an object that a transport reads in blocks of 16 KiB straight into its place."""
    block = 16_384
    first = data_header(12 + size) + bytes(block - 12)
    initiator = asked(into=into)
    initiator.receive_data(first)
    while (window := initiator.writable(PACKET)) is not None:
        initiator.wrote(min(block, len(window)))


def test_twenty_megabytes_are_held_once() -> None:
    into = bytearray(20_000_000)
    tracemalloc.start()
    receive_object(len(into), into)
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 64_000


def test_nothing_new_is_nothing() -> None:
    assert isinstance(UsbInitiator().next_event(), NeedData)
