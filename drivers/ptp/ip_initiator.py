"""The host's end of a pair of PTP/IP connections, without I/O."""

from __future__ import annotations

import struct

from drivers.ptp.codes import UNDEFINED_TOTAL, DataPhase, PacketType
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.packets import (
    PACKET_HEADER_BYTES,
    Cancel,
    CommandRequest,
    CommandResponse,
    EventPacket,
    StartData,
    decode_packet,
    decode_packet_header,
    packet_bytes,
)
from drivers.ptp.transaction import (
    Conversation,
    Event,
    Part,
    ProbeAnswered,
    Probed,
    Request,
    State,
    Step,
    Stray,
)
from drivers.ptp.wire import Bytes

_CARRIES_DATA = frozenset({PacketType.DATA, PacketType.END_DATA})
_AMONG_EVENTS = frozenset({PacketType.EVENT, PacketType.PROBE_REQUEST, PacketType.PROBE_RESPONSE})
_STEPS = {
    (State.ASKED, PacketType.START_DATA): Step.BEGIN_DATA,
    (State.ASKED, PacketType.COMMAND_RESPONSE): Step.ANSWER,
    (State.RECEIVING, PacketType.DATA): Step.TAKE_DATA,
    (State.RECEIVING, PacketType.END_DATA): Step.TAKE_LAST_DATA,
    (State.RECEIVING, PacketType.CANCEL): Step.CUT_DATA,
    (State.RECEIVING, PacketType.COMMAND_RESPONSE): Step.CUT_DATA_AND_ANSWER,
    (State.DATA_OVER, PacketType.COMMAND_RESPONSE): Step.ANSWER,
}


class IpInitiator(Conversation):
    """The host's end of a pair of PTP/IP connections, after both have been accepted."""

    def __init__(self) -> None:
        super().__init__()
        self._head = bytearray()
        self._part = Part.HEAD
        self._left = 0
        self._is_last = False
        self._event_head = bytearray()

    def send(self, request: Request, into: bytearray | memoryview | None = None) -> list[bytes]:
        """The packets that start a transaction; parameters as in `UsbInitiator.send`."""
        self._begin(request, into)
        number = self._transaction
        phase = DataPhase.NONE_OR_IN if request.data is None else DataPhase.OUT
        command = CommandRequest(phase, request.code, number, request.parameters).encode()
        if request.data is None:
            return [command]
        last = packet_bytes(PacketType.END_DATA, struct.pack("<I", number), request.data)
        return [command, StartData(number, len(request.data)).encode(), last]

    def receive_data(self, data: Bytes, ended: bool = False) -> None:
        """Bytes of the command connection, in pieces of any size; `ended` has no meaning here."""
        del ended
        self._check()
        view = memoryview(data).cast("B")
        while view:
            view = self._take_head(view) if self._part is Part.HEAD else self._take_data(view)

    def writable(self, multiple: int = 1) -> memoryview | None:
        """Where the next bytes of the command connection may be read to; see `UsbInitiator`."""
        return self._window(self._left, multiple) if self._part is Part.DATA else None

    def wrote(self, count: int, ended: bool = False) -> None:
        """`count` bytes were read into what `writable` offered."""
        del ended
        if self._part is not Part.DATA or not 0 <= count <= self._left:
            raise ValueError(f"{count} bytes written where {self._left} are due")
        self._size += count
        self._pass(count)

    def receive_event(self, data: Bytes) -> None:
        """Bytes of the event connection; what is no event is forgotten and raises once."""
        self._event_head += data
        while len(self._event_head) >= PACKET_HEADER_BYTES:
            try:
                left, kind = decode_packet_header(self._event_head[:PACKET_HEADER_BYTES])
                if kind not in _AMONG_EVENTS:
                    raise PtpProtocolError(f"a {kind.name.lower()} packet among the events")
                end = PACKET_HEADER_BYTES + left
                if len(self._event_head) < end:
                    return
                body = bytes(self._event_head[PACKET_HEADER_BYTES:end])
                del self._event_head[:end]
                self._tell(kind, body)
            except PtpProtocolError:
                self._event_head.clear()
                raise

    def reset(self) -> None:
        """Forget the transaction under way and all bytes; numbers go on."""
        self._forget()
        self._head.clear()
        self._event_head.clear()
        self._part = Part.HEAD
        self._left = 0

    def _take_head(self, view: memoryview) -> memoryview:
        """Gather a packet up to where its data begin."""
        due = PACKET_HEADER_BYTES
        if len(self._head) >= PACKET_HEADER_BYTES:
            due = self._due()
        count = due - len(self._head)
        self._head += view[:count]
        if len(self._head) == PACKET_HEADER_BYTES:
            due = self._due()
        if len(self._head) == due:
            self._finish_head()
        return view[count:]

    def _due(self) -> int:
        """Bytes of the packet in hand that are gathered before it is looked at."""
        try:
            left, kind = decode_packet_header(self._head[:PACKET_HEADER_BYTES])
        except PtpProtocolError as error:
            self._fail(str(error))
        if kind in _CARRIES_DATA:
            left = 4
        return PACKET_HEADER_BYTES + left

    def _finish_head(self) -> None:
        left, kind = decode_packet_header(self._head[:PACKET_HEADER_BYTES])
        body = bytes(self._head[PACKET_HEADER_BYTES:])
        self._head.clear()
        if kind in _CARRIES_DATA:
            self._begin_packet(kind, int.from_bytes(body, "little"), left - 4)
            return
        try:
            self._tell(kind, body)
        except PtpProtocolError as error:
            self._fail(str(error))

    def _begin_packet(self, kind: PacketType, transaction: int, left: int) -> None:
        """A packet with data: the transaction's own or another's."""
        self._left = left
        if self._is_own(transaction):
            step = _STEPS.get((self._state, kind))
            if step is None:
                self._fail(f"a {kind.name.lower()} packet where none is due")
            self._part = Part.DATA
            self._is_last = step is Step.TAKE_LAST_DATA
            # `wrote` must not have to look: what a packet claims fits what was announced.
            room = self._room()
            if self._size + left > room:
                self._fail(f"{self._size + left} bytes of data where {room} were expected")
        else:
            self._part = Part.SKIPPED
            self._events.append(Stray(kind, transaction))
        self._pass(0)

    def _tell(self, kind: PacketType, body: bytes) -> None:
        """A packet without data."""
        packet = decode_packet(kind, body)
        match packet:
            case EventPacket():
                self._events.append(Event(packet.code, packet.parameters))
            case CommandResponse() | StartData() | Cancel():
                self._advance(packet)
            case _ if kind is PacketType.PROBE_REQUEST:
                self._events.append(Probed())
            case _ if kind is PacketType.PROBE_RESPONSE:
                self._events.append(ProbeAnswered())
            case _:
                raise PtpProtocolError(f"a {kind.name.lower()} packet after the greeting")

    def _advance(self, packet: CommandResponse | StartData | Cancel) -> None:
        if not self._is_own(packet.transaction):
            code = packet.code if isinstance(packet, CommandResponse) else packet.kind
            self._events.append(Stray(code, packet.transaction))
            return
        step = _STEPS.get((self._state, packet.kind))
        if step is None:
            raise PtpProtocolError(f"a {packet.kind.name.lower()} packet where none is due")
        if step in {Step.CUT_DATA, Step.CUT_DATA_AND_ANSWER}:
            self._end_data()
        if isinstance(packet, StartData):
            self._start_data(None if packet.total == UNDEFINED_TOTAL else packet.total)
        elif isinstance(packet, CommandResponse):
            self._answer(packet.code, packet.parameters)

    def _take_data(self, view: memoryview) -> memoryview:
        count = min(self._left, len(view))
        if self._part is Part.DATA:
            self._take(view[:count])
        self._pass(count)
        return view[count:]

    def _pass(self, count: int) -> None:
        """`count` bytes of the packet's data are behind us."""
        self._left -= count
        if not self._left:
            if self._part is Part.DATA and self._is_last:
                self._end_data()
            self._part = Part.HEAD
