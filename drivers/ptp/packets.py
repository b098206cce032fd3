"""PTP/IP packets to and from bytes, after CIPA DC-X005; everything is little-endian.

Packets that carry data have no class here: `transaction` streams them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Self, TypeAlias

from drivers.ptp.codes import DataPhase, PacketType
from drivers.ptp.cursor import Cursor
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.wire import MAX_DATA_BYTES, Bytes, decode_parameters, parameters_bytes

PACKET_HEADER_BYTES = 8
PROTOCOL_VERSION = 0x00010000
# The longest packet that carries no data: a greeting with a GUID and a name. The standard ends
# names at 40 units; libgphoto2 takes what comes, and 1 KiB is more than any.
MAX_PACKET_BYTES = 1024

_KINDS = frozenset(PacketType)
_PHASES = frozenset(DataPhase)


def packet_bytes(kind: PacketType, *parts: Bytes) -> bytes:
    """A PTP/IP packet around its body."""
    length = PACKET_HEADER_BYTES + sum(len(part) for part in parts)
    return b"".join((struct.pack("<II", length, kind), *parts))


def decode_packet_header(data: Bytes) -> tuple[int, PacketType]:
    """(length of the body, type) from the 8 bytes that begin a PTP/IP packet."""
    length, kind = struct.unpack("<II", data)
    if kind not in _KINDS:
        raise PtpProtocolError(
            f"a packet of type {kind}, which does not exist: this is not PTP/IP, or out of step"
        )
    carries_data = kind in {PacketType.DATA, PacketType.END_DATA}
    largest = MAX_DATA_BYTES if carries_data else MAX_PACKET_BYTES
    smallest = PACKET_HEADER_BYTES + (4 if carries_data else 0)
    if not smallest <= length <= largest:
        raise PtpProtocolError(f"a {PacketType(kind).name.lower()} packet of {length} bytes")
    return length - PACKET_HEADER_BYTES, PacketType(kind)


@dataclass(frozen=True, slots=True)
class InitCommandRequest:
    """The first packet of the command connection: who calls."""

    kind: ClassVar = PacketType.INIT_COMMAND_REQUEST
    guid: bytes
    name: str
    version: int = PROTOCOL_VERSION

    def encode(self) -> bytes:
        """As it travels."""
        return packet_bytes(self.kind, _greeting(self.guid, self.name, self.version))

    @classmethod
    def decode(cls, body: Cursor) -> InitCommandRequest:
        """From a packet's body."""
        return cls(bytes(body.take(16)), _name(body), body.u32())


@dataclass(frozen=True, slots=True)
class InitCommandAck:
    """The camera's answer: who is there, and the number that ties both connections."""

    kind: ClassVar = PacketType.INIT_COMMAND_ACK
    connection: int
    guid: bytes
    name: str
    version: int = PROTOCOL_VERSION

    def encode(self) -> bytes:
        """As it travels."""
        greeting = _greeting(self.guid, self.name, self.version)
        return packet_bytes(self.kind, struct.pack("<I", self.connection), greeting)

    @classmethod
    def decode(cls, body: Cursor) -> InitCommandAck:
        """From a packet's body."""
        return cls(body.u32(), bytes(body.take(16)), _name(body), body.u32())


@dataclass(frozen=True, slots=True)
class InitEventRequest:
    """The first packet of the event connection."""

    kind: ClassVar = PacketType.INIT_EVENT_REQUEST
    connection: int

    def encode(self) -> bytes:
        """As it travels."""
        return packet_bytes(self.kind, struct.pack("<I", self.connection))

    @classmethod
    def decode(cls, body: Cursor) -> InitEventRequest:
        """From a packet's body."""
        return cls(body.u32())


@dataclass(frozen=True, slots=True)
class InitFail:
    """The camera refuses the connection: 1 rejected, 2 busy, 3 unspecified."""

    kind: ClassVar = PacketType.INIT_FAIL
    reason: int

    def encode(self) -> bytes:
        """As it travels."""
        return packet_bytes(self.kind, struct.pack("<I", self.reason))

    @classmethod
    def decode(cls, body: Cursor) -> InitFail:
        """From a packet's body."""
        return cls(body.u32())


@dataclass(frozen=True, slots=True)
class CommandRequest:
    """An operation over PTP/IP."""

    kind: ClassVar = PacketType.COMMAND_REQUEST
    phase: int
    code: int
    transaction: int
    parameters: tuple[int, ...] = ()

    def encode(self) -> bytes:
        """As it travels."""
        fields = struct.pack("<IHI", self.phase, self.code, self.transaction)
        return packet_bytes(self.kind, fields, parameters_bytes(self.parameters))

    @classmethod
    def decode(cls, body: Cursor) -> CommandRequest:
        """From a packet's body."""
        phase, code, transaction = body.u32(), body.u16(), body.u32()
        if phase not in _PHASES:
            raise PtpProtocolError(f"a command with data phase {phase}, neither 1 nor 2")
        return cls(phase, code, transaction, decode_parameters(body.take(body.left)))


@dataclass(frozen=True, slots=True)
class _Coded:
    """A code, the transaction it belongs to, and parameters: answers and events alike."""

    kind: ClassVar[PacketType]
    code: int
    transaction: int
    parameters: tuple[int, ...] = ()

    def encode(self) -> bytes:
        """As it travels."""
        fields = struct.pack("<HI", self.code, self.transaction)
        return packet_bytes(self.kind, fields, parameters_bytes(self.parameters))

    @classmethod
    def decode(cls, body: Cursor) -> Self:
        """From a packet's body."""
        return cls(body.u16(), body.u32(), decode_parameters(body.take(body.left)))


class CommandResponse(_Coded):
    """The answer to an operation over PTP/IP."""

    __slots__ = ()
    kind: ClassVar = PacketType.COMMAND_RESPONSE


class EventPacket(_Coded):
    """An event over PTP/IP."""

    __slots__ = ()
    kind: ClassVar = PacketType.EVENT


@dataclass(frozen=True, slots=True)
class StartData:
    """The announcement of a data phase; `UNDEFINED_TOTAL` when its length is not known."""

    kind: ClassVar = PacketType.START_DATA
    transaction: int
    total: int

    def encode(self) -> bytes:
        """As it travels."""
        return packet_bytes(self.kind, struct.pack("<IQ", self.transaction, self.total))

    @classmethod
    def decode(cls, body: Cursor) -> StartData:
        """From a packet's body."""
        return cls(body.u32(), body.u64())


@dataclass(frozen=True, slots=True)
class Cancel:
    """The end of a transaction that is given up."""

    kind: ClassVar = PacketType.CANCEL
    transaction: int

    def encode(self) -> bytes:
        """As it travels."""
        return packet_bytes(self.kind, struct.pack("<I", self.transaction))

    @classmethod
    def decode(cls, body: Cursor) -> Cancel:
        """From a packet's body."""
        return cls(body.u32())


@dataclass(frozen=True, slots=True)
class Signal:
    """A packet without a body: event connection accepted, probe, and its answer."""

    kind: PacketType

    def encode(self) -> bytes:
        """As it travels."""
        return packet_bytes(self.kind)


INIT_EVENT_ACK = Signal(PacketType.INIT_EVENT_ACK)
PROBE_REQUEST = Signal(PacketType.PROBE_REQUEST)
PROBE_RESPONSE = Signal(PacketType.PROBE_RESPONSE)

Packet: TypeAlias = (
    InitCommandRequest
    | InitCommandAck
    | InitEventRequest
    | InitFail
    | CommandRequest
    | CommandResponse
    | EventPacket
    | StartData
    | Cancel
    | Signal
)
_SIGNALS = {signal.kind: signal for signal in (INIT_EVENT_ACK, PROBE_REQUEST, PROBE_RESPONSE)}
_DECODERS = {
    packet.kind: packet.decode
    for packet in (
        InitCommandRequest,
        InitCommandAck,
        InitEventRequest,
        InitFail,
        CommandRequest,
        CommandResponse,
        EventPacket,
        StartData,
        Cancel,
    )
}


def decode_packet(kind: PacketType, body: Bytes) -> Packet:
    """Any packet but those that carry data, from its body; more bytes than are due are ignored."""
    signal = _SIGNALS.get(kind)
    if signal is not None:
        return signal
    return _DECODERS[kind](Cursor(body, f"{kind.name.lower()} packet"))


def _greeting(guid: bytes, name: str, version: int) -> bytes:
    if len(guid) != 16:
        raise ValueError(f"a GUID has 16 bytes, not {len(guid)}")
    return guid + (name + "\0").encode("utf-16-le", "replace") + struct.pack("<I", version)


def _name(body: Cursor) -> str:
    """Text up to its NUL, in front of a version of 4 bytes."""
    units = bytearray()
    while True:
        unit = bytes(body.take(2))
        if unit == b"\0\0":
            return units.decode("utf-16-le", "replace")
        units += unit
