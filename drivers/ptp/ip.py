"""PTP over TCP: the two connections to a camera, and the only time-outs of this transport."""

from __future__ import annotations

import errno
import selectors
import socket
import time
import uuid
from contextlib import suppress

from drivers.ptp.codes import PacketType
from drivers.ptp.errors import (
    PtpDisconnectedError,
    PtpError,
    PtpProtocolError,
    PtpTimeoutError,
    PtpTransportError,
)
from drivers.ptp.ip_initiator import IpInitiator
from drivers.ptp.packets import (
    INIT_EVENT_ACK,
    PACKET_HEADER_BYTES,
    PROBE_REQUEST,
    PROBE_RESPONSE,
    InitCommandAck,
    InitCommandRequest,
    InitEventRequest,
    InitFail,
    Packet,
    decode_packet,
    decode_packet_header,
)
from drivers.ptp.transaction import Happening, NeedData, ProbeAnswered, Probed, Request

PORT = 15740
CONNECT_TIMEOUT_S = 5.0
SEND_TIMEOUT_S = 10.0

_NAME = "lumisplit"
_BUFFER_BYTES = 1 << 18
_REFUSALS = {
    1: "it knows another computer; pair it with this one in its network menu",
    2: "it is busy with another program or computer; close that one",
}
_UNREACHABLE = {errno.EHOSTUNREACH, errno.ENETUNREACH, errno.EHOSTDOWN, errno.ENETDOWN}


class IpLink:
    """A pair of PTP/IP connections to one camera (see `drivers.ptp.link.Link`).

    Parameters
    ----------
    host, port
        Where the camera listens.
    connect_timeout_s
        For each of the steps until both connections are accepted.

    Attributes
    ----------
    camera_name
        As the camera introduces itself.
    """

    def __init__(
        self, host: str, port: int = PORT, connect_timeout_s: float = CONNECT_TIMEOUT_S
    ) -> None:
        self._address = (host, port)
        self._place = f"{host}:{port}"
        self._connect_timeout_s = connect_timeout_s
        self._buffer = memoryview(bytearray(_BUFFER_BYTES))
        self._connect()

    def send(self, request: Request, into: memoryview | None = None) -> None:
        """Begin a transaction; the camera's data go to `into` if that is given."""
        blocks = self._initiator.send(request, into)
        self._write(self._commands, b"".join(blocks))

    def receive(self, timeout_s: float) -> Happening:
        """What comes next; `PtpTimeoutError` after `timeout_s` of silence.

        The view in a `DataChunk` is good until the next call.
        """
        while isinstance(happening := self.take(), NeedData):
            if not self._read(timeout_s):
                raise PtpTimeoutError(
                    f"the camera at {self._place} has been silent for {timeout_s:g} s; "
                    "is it asleep or switched off?"
                )
        return happening

    def poll_events(self, timeout_s: float) -> None:
        """Wait up to `timeout_s` for something to come, and take it in."""
        self._read(timeout_s)

    def take(self) -> Happening:
        """What has been taken in already; `NeedData` when there is nothing."""
        while isinstance(happening := self._initiator.next_event(), Probed):
            self._write(self._events, PROBE_RESPONSE.encode())
        return happening

    def is_alive(self, timeout_s: float) -> bool:
        """Whether the camera answers a probe; only between transactions.

        Events that come meanwhile are lost.
        """
        self._write(self._events, PROBE_REQUEST.encode())
        until_s = time.monotonic() + timeout_s
        while (left_s := until_s - time.monotonic()) > 0:
            self._read(left_s)
            while not isinstance(happening := self.take(), NeedData):
                if isinstance(happening, ProbeAnswered):
                    return True
        return False

    def recover(self) -> None:
        """Connect anew: amid a packet there is no other way back into step.

        The session is gone and must be opened again.
        """
        self.close()
        self._connect()

    def close(self) -> None:
        """Let both connections go."""
        self._selector.close()
        for connection in (self._events, self._commands):
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    def _connect(self) -> None:
        self._initiator = IpInitiator()
        self._commands = self._dial()
        try:
            # A camera that has been paired knows a computer by this number: the same every time.
            guid = uuid.uuid5(uuid.NAMESPACE_DNS, socket.gethostname()).bytes
            answer = self._greet(self._commands, InitCommandRequest(guid, _NAME).encode())
            if not isinstance(answer, InitCommandAck):
                raise PtpProtocolError(f"{self._place} does not answer as a PTP/IP camera does")
            self._events = self._dial()
        except PtpError:
            self._commands.close()
            raise
        try:
            request = InitEventRequest(answer.connection).encode()
            if self._greet(self._events, request) != INIT_EVENT_ACK:
                raise PtpProtocolError(f"{self._place} does not answer as a PTP/IP camera does")
        except PtpError:
            self._commands.close()
            self._events.close()
            raise
        self.camera_name = answer.name
        self._selector = selectors.DefaultSelector()
        for connection in (self._commands, self._events):
            self._selector.register(connection, selectors.EVENT_READ)

    def _dial(self) -> socket.socket:
        try:
            connection = socket.create_connection(self._address, self._connect_timeout_s)
        except OSError as error:
            raise self._no_connection(error) from None
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        return connection

    def _no_connection(self, error: OSError) -> PtpTransportError:
        if isinstance(error, TimeoutError):
            return PtpTimeoutError(
                f"nothing answers at {self._place} within {self._connect_timeout_s:g} s; "
                "check the cable, the camera's address and that it is awake"
            )
        if isinstance(error, ConnectionRefusedError):
            reason = "no camera listens there; switch its network connection (PTP/IP) on"
        elif isinstance(error, socket.gaierror):
            reason = "the name is not known; use the address that the camera shows in its menu"
        elif error.errno in _UNREACHABLE:
            reason = "there is no way to it; check the cable and both addresses"
        else:
            reason = str(error)
        return PtpDisconnectedError(f"cannot connect to {self._place}: {reason}")

    def _greet(self, connection: socket.socket, request: bytes) -> Packet:
        """Send the first packet of a connection and read the answer."""
        self._write(connection, request)
        connection.settimeout(self._connect_timeout_s)
        length, kind = decode_packet_header(self._read_exactly(connection, PACKET_HEADER_BYTES))
        body = self._read_exactly(connection, length)
        if kind in {PacketType.DATA, PacketType.END_DATA}:
            raise PtpProtocolError(f"{self._place} does not answer as a PTP/IP camera does")
        answer = decode_packet(kind, body)
        if isinstance(answer, InitFail):
            advice = _REFUSALS.get(answer.reason, "switch it off and on again")
            raise PtpTransportError(f"the camera at {self._place} refuses to talk: {advice}")
        return answer

    def _read_exactly(self, connection: socket.socket, count: int) -> bytes:
        data = bytearray()
        try:
            while len(data) < count:
                part = connection.recv(count - len(data))
                if not part:
                    raise self._gone()
                data += part
        except TimeoutError:
            raise PtpTimeoutError(
                f"{self._place} accepts connections but does not greet; is it a PTP/IP camera, "
                "and not in use by another program?"
            ) from None
        except OSError:
            raise self._gone() from None
        return bytes(data)

    def _write(self, connection: socket.socket, data: bytes) -> None:
        try:
            connection.settimeout(SEND_TIMEOUT_S)
            connection.sendall(data)
        except TimeoutError:
            raise PtpTimeoutError(f"the camera at {self._place} takes no more bytes") from None
        except OSError:
            raise self._gone() from None

    def _read(self, timeout_s: float) -> bool:
        """Take in what comes within `timeout_s`; False when nothing did."""
        if self._commands.fileno() < 0:
            raise self._gone()
        ready = self._selector.select(timeout_s)
        for key, _ in ready:
            if key.fileobj is self._commands:
                self._read_commands()
            else:
                self._initiator.receive_event(self._buffer[: self._receive(self._events)])
        return bool(ready)

    def _read_commands(self) -> None:
        window = self._initiator.writable()
        if window is None:
            count = self._receive(self._commands)
            self._initiator.receive_data(self._buffer[:count])
        else:
            self._initiator.wrote(self._receive(self._commands, window))

    def _receive(self, connection: socket.socket, window: memoryview | None = None) -> int:
        try:
            count = connection.recv_into(self._buffer if window is None else window)
        except OSError:
            raise self._gone() from None
        if not count:
            raise self._gone()
        return count

    def _gone(self) -> PtpDisconnectedError:
        return PtpDisconnectedError(
            f"the camera at {self._place} closed the connection: switched off, asleep or "
            "unplugged; wake it and connect again"
        )
