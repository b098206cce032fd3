"""The simulated camera on TCP: one host at a time, one after another."""

from __future__ import annotations

import selectors
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType

from drivers.errors import CameraError
from drivers.ptp.codes import PacketType
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.ip import PORT
from drivers.ptp.packets import (
    INIT_EVENT_ACK,
    PROBE_RESPONSE,
    InitCommandAck,
    InitCommandRequest,
    InitEventRequest,
    InitFail,
    Signal,
)
from drivers.ptp.wire import Bytes
from drivers.sim.ptp_responder.answer import Unplug
from drivers.sim.ptp_responder.packet_stream import (
    OperationStream,
    PacketStream,
    Received,
    event_packet,
    output_packets,
)
from drivers.sim.ptp_responder.responder import Responder

LOOPBACK = "127.0.0.1"

_GUID = b"lumisplit camera"
_NAME = "simulated D4S"
_POLL_S = 0.02  # between two looks at the events that are due
_SEND_TIMEOUT_S = 10.0
_BUFFER_BYTES = 1 << 16
_BUSY = 2  # reason of a refused connection


class _Peer:
    """One connection of a host, of which only its first packet tells what it is for."""

    def __init__(self, connection: socket.socket) -> None:
        self.socket = connection
        self.packets = PacketStream()
        self.operations: OperationStream | None = None

    def write(self, *blocks: Bytes) -> None:
        """Send all of it."""
        for block in blocks:
            self.socket.sendall(block)


class PtpIpServer:
    """A responder behind a TCP port, in a thread of its own (use it with ``with``).

    Parameters
    ----------
    responder
        The camera.
    host, port
        Where it listens; port 0 takes a free one.
    event_port
        A second port that takes connections as well, None for none; taken only if it is free.

    Attributes
    ----------
    address
        (host, port) where it listens.
    """

    def __init__(
        self,
        responder: Responder,
        host: str = LOOPBACK,
        port: int = 0,
        event_port: int | None = None,
    ) -> None:
        self._responder = responder
        self._selector = selectors.DefaultSelector()
        self._listeners = [_listen(host, port)]
        self.address: tuple[str, int] = self._listeners[0].getsockname()[:2]
        if event_port is not None:
            with suppress(CameraError):
                self._listeners.append(_listen(host, event_port))
        for listener in self._listeners:
            self._selector.register(listener, selectors.EVENT_READ)
        self._peers: dict[socket.socket, _Peer] = {}
        self._commands: _Peer | None = None
        self._events: _Peer | None = None
        self._connection = 0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self.serve, name="ptp-ip-server", daemon=True)

    def __enter__(self) -> PtpIpServer:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()
        self._thread.join()

    @property
    def is_plugged_in(self) -> bool:
        """Whether hosts can connect; False after the camera was unplugged."""
        return bool(self._listeners)

    def stop(self) -> None:
        """Ask `serve` to end."""
        self._stopping.set()

    def serve(self) -> None:
        """Serve hosts until `stop`, or until the camera is unplugged."""
        try:
            while not self._stopping.is_set() and self.is_plugged_in:
                for key, _ in self._selector.select(_POLL_S):
                    if isinstance(key.fileobj, socket.socket):
                        self._take_from(key.fileobj)
                self._send_events()
        finally:
            self._unplug()
            self._selector.close()

    def _take_from(self, ready: socket.socket) -> None:
        if ready in self._listeners:
            self._accept(ready)
        elif ready in self._peers:
            self._serve(self._peers[ready])

    def _accept(self, listener: socket.socket) -> None:
        with suppress(OSError):
            connection, _ = listener.accept()
            connection.settimeout(_SEND_TIMEOUT_S)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._peers[connection] = _Peer(connection)
            self._selector.register(connection, selectors.EVENT_READ)

    def _serve(self, peer: _Peer) -> None:
        """Take what came; a host that breaks the rules or goes away loses both connections."""
        try:
            data = peer.socket.recv(_BUFFER_BYTES)
            if not data:
                self._drop(peer)
                return
            for packet in peer.packets.receive(data):
                self._take(peer, packet)
        except (PtpProtocolError, OSError):
            self._drop(peer)

    def _take(self, peer: _Peer, packet: Received) -> None:
        match packet:
            case InitCommandRequest():
                self._greet(peer)
            case InitEventRequest():
                self._join(peer, packet.connection)
            case Signal(kind=PacketType.PROBE_REQUEST):
                peer.write(PROBE_RESPONSE.encode())
            case _ if peer.operations is None:
                raise PtpProtocolError("the host sends an operation before its greeting")
            case _:
                self._operate(peer, peer.operations, packet)

    def _greet(self, peer: _Peer) -> None:
        if self._commands is not None:
            peer.write(InitFail(_BUSY).encode())
            raise PtpProtocolError("another host is connected")
        self._commands = peer
        peer.operations = OperationStream()
        self._connection += 1
        self._responder.reset()
        peer.write(InitCommandAck(self._connection, _GUID, _NAME).encode())

    def _join(self, peer: _Peer, connection: int) -> None:
        if self._commands is None or self._events is not None or connection != self._connection:
            peer.write(InitFail(_BUSY).encode())
            raise PtpProtocolError("no command connection of this number waits for its events")
        self._events = peer
        peer.write(INIT_EVENT_ACK.encode())

    def _operate(self, peer: _Peer, operations: OperationStream, packet: Received) -> None:
        for container in operations.receive(packet):
            for output in self._responder.handle(container):
                if isinstance(output, Unplug):
                    self._unplug()
                    return
                peer.write(*output_packets(output))

    def _send_events(self) -> None:
        if self._events is None:
            return
        try:
            for event in self._responder.due_events():
                self._events.write(event_packet(event))
        except OSError:
            self._drop(self._events)

    def _drop(self, peer: _Peer) -> None:
        """Close a connection, and its fellow with it."""
        closing = [peer]
        if peer in {self._commands, self._events}:
            closing = [each for each in (self._commands, self._events) if each is not None]
            self._commands = self._events = None
            self._responder.reset()
        for each in closing:
            self._close(each)

    def _close(self, peer: _Peer) -> None:
        if self._peers.pop(peer.socket, None) is not None:
            self._selector.unregister(peer.socket)
        peer.socket.close()

    def _unplug(self) -> None:
        for peer in tuple(self._peers.values()):
            self._close(peer)
        self._commands = self._events = None
        self._responder.reset()
        for listener in self._listeners:
            self._selector.unregister(listener)
            listener.close()
        self._listeners.clear()


def serve_ptpip(
    responder: Responder,
    host: str = LOOPBACK,
    port: int = PORT,
    listening: Callable[[str, int], None] = lambda _host, _port: None,
) -> None:
    """Serve a simulated camera over PTP/IP until it is unplugged or the program interrupted.

    Parameters
    ----------
    responder
        The camera.
    host, port
        Where it listens: only this computer unless another address is given; port 0 takes a
        free one.
    listening
        Called with host and port once hosts can connect.
    """
    # libgphoto2 up to 2.5.30 calls for events at 15740 when it is told another port, unless it is
    # told both as PORT:PORT.
    server = PtpIpServer(responder, host, port, None if port in {0, PORT} else PORT)
    listening(*server.address)
    server.serve()


def _listen(host: str, port: int) -> socket.socket:
    try:
        return socket.create_server((host, port), backlog=8)
    except OSError as error:
        raise CameraError(
            f"the simulated camera cannot listen at {host}:{port}: {error.strerror or error}; "
            "choose a free port, and an address of this computer"
        ) from None
