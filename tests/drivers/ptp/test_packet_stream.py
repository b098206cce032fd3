"""The simulated camera's end of PTP/IP: a host's packets however they are split, and its own."""

from __future__ import annotations

import pytest

from drivers.ptp.codes import ContainerType, DataPhase, Operation, PacketType, ResponseCode
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.ip_initiator import IpInitiator
from drivers.ptp.packets import (
    PROBE_REQUEST,
    CommandRequest,
    CommandResponse,
    InitCommandRequest,
    InitEventRequest,
    Packet,
    StartData,
    packet_bytes,
)
from drivers.ptp.transaction import Request
from drivers.ptp.wire import Container
from drivers.sim.ptp_responder.answer import Cut, Output, Raw, Stall
from drivers.sim.ptp_responder.packet_stream import (
    MAX_RECEIVED_BYTES,
    DataPacket,
    OperationStream,
    PacketStream,
    event_packet,
    output_packets,
)

SET = Operation.SET_DEVICE_PROP_VALUE
NUMBER = (7).to_bytes(4, "little")
HOST: list[Packet | DataPacket] = [
    InitCommandRequest(bytes(range(16)), "héllo"),
    InitEventRequest(5),
    PROBE_REQUEST,
    CommandRequest(DataPhase.NONE_OR_IN, Operation.OPEN_SESSION, 0, (1,)),
    CommandRequest(DataPhase.OUT, SET, 7, (0x5007,)),
    StartData(7, 4),
    DataPacket(7, b"ab", is_last=False),
    DataPacket(7, b"cd", is_last=True),
]


def encoded(packet: Packet | DataPacket) -> bytes:
    if isinstance(packet, DataPacket):
        kind = PacketType.END_DATA if packet.is_last else PacketType.DATA
        return packet_bytes(kind, packet.transaction.to_bytes(4, "little"), packet.payload)
    return packet.encode()


def test_packets_are_the_same_however_they_are_split() -> None:
    stream = b"".join(encoded(packet) for packet in HOST)
    for size in range(1, len(stream) + 1):
        packets = PacketStream()
        told = [
            packet
            for start in range(0, len(stream), size)
            for packet in packets.receive(stream[start : start + size])
        ]
        assert told == HOST, size


def test_an_operation_is_told_with_its_data() -> None:
    operations = OperationStream()
    told = [container for packet in HOST[3:] for container in operations.receive(packet)]
    assert told == [
        Container.with_parameters(ContainerType.COMMAND, Operation.OPEN_SESSION, 0, (1,)),
        Container.with_parameters(ContainerType.COMMAND, SET, 7, (0x5007,)),
        Container(ContainerType.DATA, SET, 7, b"abcd"),
    ]


@pytest.mark.parametrize("packet", [HOST[0], HOST[5], HOST[6]], ids=["greeting", "start", "data"])
def test_packets_that_are_not_due_are_refused(packet: Packet | DataPacket) -> None:
    with pytest.raises(PtpProtocolError, match="not due"):
        OperationStream().receive(packet)


def test_a_host_cannot_fill_the_memory() -> None:
    length = (8 + MAX_RECEIVED_BYTES + 1).to_bytes(4, "little")
    with pytest.raises(PtpProtocolError, match="packet of"):
        PacketStream().receive(length + bytes([PacketType.DATA, 0, 0, 0]))
    operations = OperationStream()
    operations.receive(HOST[4])
    half = DataPacket(7, bytes(MAX_RECEIVED_BYTES // 2 + 1), is_last=False)
    operations.receive(half)
    with pytest.raises(PtpProtocolError, match="and more"):
        operations.receive(half)


def test_what_the_host_s_end_sends_is_understood() -> None:
    packets, operations = PacketStream(), OperationStream()
    blocks = IpInitiator().send(Request(SET, (0x5007,), b"\x20\x03"))
    told = [
        container
        for packet in packets.receive(b"".join(blocks))
        for container in operations.receive(packet)
    ]
    assert told == [
        Container.with_parameters(ContainerType.COMMAND, SET, 0, (0x5007,)),
        Container(ContainerType.DATA, SET, 0, b"\x20\x03"),
    ]


DATA = Container(ContainerType.DATA, Operation.GET_OBJECT, 7, b"abcd")
ANNOUNCED = StartData(7, 4).encode()
END = packet_bytes(PacketType.END_DATA, NUMBER)
OUTPUTS: dict[str, tuple[Output, bytes]] = {
    "response": (
        Container.with_parameters(ContainerType.RESPONSE, ResponseCode.OK, 7, (1,)),
        CommandResponse(ResponseCode.OK, 7, (1,)).encode(),
    ),
    "data": (DATA, ANNOUNCED + packet_bytes(PacketType.DATA, NUMBER, b"abcd") + END),
    "cut data": (Cut(DATA, 2), ANNOUNCED + packet_bytes(PacketType.DATA, NUMBER, b"ab") + END),
    "garbage": (Raw(b"?"), b"?"),
    "stall": (Stall(), b""),
}


@pytest.mark.parametrize("name", OUTPUTS)
def test_outputs_as_packets(name: str) -> None:
    output, expected = OUTPUTS[name]
    assert b"".join(output_packets(output)) == expected


def test_an_event_as_a_packet() -> None:
    event = Container.with_parameters(ContainerType.EVENT, 0x4002, 0, (3,))
    assert event_packet(event) == bytes.fromhex("12000000 08000000 0240 00000000 03000000")
