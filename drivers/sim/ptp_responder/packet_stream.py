"""PTP/IP packets of a host to containers, and containers back to packets, without I/O."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeAlias

from drivers.ptp.codes import ContainerType, DataPhase, PacketType
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.packets import (
    PACKET_HEADER_BYTES,
    CommandRequest,
    CommandResponse,
    EventPacket,
    Packet,
    StartData,
    decode_packet,
    decode_packet_header,
    packet_bytes,
)
from drivers.ptp.wire import Bytes, Container
from drivers.sim.ptp_responder.answer import Cut, Output, Raw

MAX_RECEIVED_BYTES = 1 << 20  # of one packet or one operation's data: hosts only set properties

_CHUNK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class DataPacket:
    """Data of a host for the camera."""

    transaction: int
    payload: bytes
    is_last: bool


Received: TypeAlias = Packet | DataPacket


class PacketStream:
    """Whole packets out of a connection's bytes."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def receive(self, data: Bytes) -> list[Received]:
        """Packets that are whole with these bytes."""
        self._bytes += data
        packets: list[Received] = []
        while len(self._bytes) >= PACKET_HEADER_BYTES:
            length, kind = decode_packet_header(self._bytes[:PACKET_HEADER_BYTES])
            if length > MAX_RECEIVED_BYTES:
                raise PtpProtocolError(f"the host sends a packet of {length} bytes")
            end = PACKET_HEADER_BYTES + length
            if len(self._bytes) < end:
                break
            body = bytes(self._bytes[PACKET_HEADER_BYTES:end])
            del self._bytes[:end]
            if kind in {PacketType.DATA, PacketType.END_DATA}:
                number = int.from_bytes(body[:4], "little")
                packets.append(DataPacket(number, body[4:], kind is PacketType.END_DATA))
            else:
                packets.append(decode_packet(kind, body))
        return packets


class OperationStream:
    """Commands and their data out of the packets of a command connection."""

    def __init__(self) -> None:
        self._command: Container | None = None
        self._data = bytearray()

    def receive(self, packet: Received) -> list[Container]:
        """The containers of an operation that is whole with this packet."""
        match packet:
            case CommandRequest():
                command = Container.with_parameters(
                    ContainerType.COMMAND, packet.code, packet.transaction, packet.parameters
                )
                if packet.phase != DataPhase.OUT:
                    return [command]
                self._command = command
                self._data.clear()
            case DataPacket() if self._is_due(packet.transaction):
                return self._gather(packet)
            case StartData() if self._is_due(packet.transaction):
                pass
            case _:
                raise PtpProtocolError("the host sends a packet that is not due")
        return []

    def _is_due(self, transaction: int) -> bool:
        return self._command is not None and self._command.transaction == transaction

    def _gather(self, packet: DataPacket) -> list[Container]:
        self._data += packet.payload
        if len(self._data) > MAX_RECEIVED_BYTES:
            raise PtpProtocolError(f"the host sends {len(self._data)} bytes of data and more")
        command = self._command
        if command is None or not packet.is_last:
            return []
        self._command = None
        data = bytes(self._data)
        return [
            command,
            Container(ContainerType.DATA, command.code, command.transaction, data),
        ]


def output_packets(output: Output) -> list[Bytes]:
    """What goes out over the command connection; nothing for what TCP cannot do."""
    match output:
        case Raw():
            return [output.data]
        case Cut():
            return _data_packets(output.container, output.size)
        case Container(kind=ContainerType.DATA):
            return _data_packets(output, len(output.payload))
        case Container():
            response = CommandResponse(output.code, output.transaction, output.parameters)
            return [response.encode()]
        case _:
            return []


def event_packet(event: Container) -> bytes:
    """An event as it goes out over the event connection."""
    return EventPacket(event.code, event.transaction, event.parameters).encode()


def _data_packets(container: Container, size: int) -> list[Bytes]:
    """The announcement of a container's data and the first `size` bytes of them."""
    number = struct.pack("<I", container.transaction)
    payload = memoryview(container.payload)
    blocks: list[Bytes] = [StartData(container.transaction, len(payload)).encode()]
    for start in range(0, size, _CHUNK_BYTES):
        chunk = payload[start : min(start + _CHUNK_BYTES, size)]
        blocks += [_data_header(number, len(chunk)), chunk]
    blocks.append(packet_bytes(PacketType.END_DATA, number))
    return blocks


def _data_header(number: bytes, size: int) -> bytes:
    length = PACKET_HEADER_BYTES + len(number) + size
    return struct.pack("<II", length, PacketType.DATA) + number
