"""The simulated camera as a real USB device: a FunctionFS gadget around the responder.

Needs root and a USB device controller, such as dummy_hcd's; see `drivers.sim.functionfs`.
"""

from __future__ import annotations

import errno
import os
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from drivers.ptp.codes import ClassRequest, ContainerType, ResponseCode
from drivers.ptp.wire import HEADER_BYTES, Container, Header
from drivers.sim import functionfs
from drivers.sim.ptp_responder.answer import Cut, Output, Raw, Stall, Unplug
from drivers.sim.ptp_responder.responder import Responder

D4S = functionfs.UsbIdentity(0x04B0, 0x0435, "NIKON", "NIKON DSC D4S", "0002049001")

EVENT_POLL_S = 0.02
JOIN_TIMEOUT_S = 2.0
# The kernel copies each piece to memory in one block, which it finds more easily when small.
PIECE_BYTES = 1 << 16
SETUP = 4
_EVENT = struct.Struct("<BBHHHB3x")  # the setup packet, then the kind of the event


class UsbGadget:
    """One simulated camera on the bus.

    Parameters
    ----------
    responder
        The camera.
    endpoints
        Folder with the function's files.
    controller_file
        Where a controller's name plugs the gadget in.

    Attributes
    ----------
    responder
        The camera; another may take its place between two sessions.
    """

    def __init__(self, responder: Responder, endpoints: Path, controller_file: Path) -> None:
        self.responder = responder
        self._controller_file = controller_file
        self._lock = threading.Lock()
        self._control = os.open(endpoints / "ep0", os.O_RDWR)
        os.write(self._control, functionfs.descriptors())
        os.write(self._control, functionfs.strings())
        self._in, self._out, self._interrupt = (
            os.open(endpoints / name, os.O_RDWR) for name in ("ep1", "ep2", "ep3")
        )
        self._is_closing = False
        self._threads = [
            threading.Thread(target=serve, daemon=True)
            for serve in (self._serve_control, self._serve_bulk, self._serve_events)
        ]
        for thread in self._threads:
            thread.start()

    def plug_in(self) -> None:
        """Connect to the machine's first controller."""
        self._controller_file.write_text(functionfs.controller())

    @property
    def is_plugged_in(self) -> bool:
        """Whether the cable is in; the program may have pulled it, or the camera's script."""
        return bool(self._controller_file.read_text().strip())

    def unplug(self) -> None:
        """Disconnect, as pulling the cable does; the camera forgets its session."""
        with suppress(OSError):
            self._controller_file.write_text("\n")
        with self._lock:
            self.responder.reset()

    def close(self) -> None:
        """Unplug and let the function's files go."""
        self._is_closing = True
        self.unplug()
        for thread in self._threads:
            thread.join(JOIN_TIMEOUT_S)
        for file in (self._in, self._out, self._interrupt, self._control):
            os.close(file)

    def _serve_control(self) -> None:
        """Answer the class requests."""
        while not self._is_closing:
            kind, request, value, _, length, event = _EVENT.unpack(os.read(self._control, 12))
            if event != SETUP:
                continue
            with suppress(OSError):
                self._answer(kind, request, value, length)

    def _answer(self, kind: int, request: int, value: int, length: int) -> None:
        is_in = bool(kind & 0x80)
        if request == ClassRequest.GET_DEVICE_STATUS and is_in:
            os.write(self._control, struct.pack("<HH", 4, ResponseCode.OK)[:length])
        elif (
            request in {ClassRequest.DEVICE_RESET, ClassRequest.CANCEL} and not is_in and not value
        ):
            os.read(self._control, length)
            if request == ClassRequest.DEVICE_RESET:
                with self._lock:
                    self.responder.reset()
        elif is_in:  # the wrong direction refuses the request
            os.read(self._control, 0)
        else:
            os.write(self._control, b"")

    def _serve_bulk(self) -> None:
        """Read containers, write what the camera says to them."""
        received = bytearray()
        while not self._is_closing:
            try:
                received += os.read(self._out, PIECE_BYTES)
                for container in _containers(received):
                    with self._lock:
                        outputs = self.responder.handle(container)
                    for output in outputs:
                        self._put(output)
            except OSError:  # unplugged, or not plugged in yet
                received.clear()
                time.sleep(EVENT_POLL_S)

    def _serve_events(self) -> None:
        while not self._is_closing:
            time.sleep(EVENT_POLL_S)
            with self._lock:
                events = self.responder.due_events()
            for event in events:
                with suppress(OSError):
                    os.write(self._interrupt, event.encode())

    def _put(self, output: Output) -> None:
        match output:
            case Container(kind=ContainerType.DATA) as container:
                self._put_data(container, len(container.payload))
            case Container() as container:
                self._put_transfer(container.encode())
            case Cut(container, size):
                self._put_data(container, size)
            case Raw(data):
                self._put_transfer(data)
            case Stall():
                self._halt()
            case Unplug():
                self.unplug()

    def _put_data(self, container: Container, size: int) -> None:
        length = HEADER_BYTES + len(container.payload)
        header = Header(length, container.kind, container.code, container.transaction).encode()
        first = PIECE_BYTES - HEADER_BYTES
        payload = memoryview(container.payload)[:size]
        self._put_transfer(header + payload[:first], is_last=size < first)
        for start in range(first, size, PIECE_BYTES):
            piece = payload[start : start + PIECE_BYTES]
            self._put_transfer(piece, is_last=len(piece) < PIECE_BYTES)
        if size >= first and (size - first) % PIECE_BYTES == 0:
            os.write(self._in, b"")

    def _put_transfer(self, data: bytes | memoryview, is_last: bool = True) -> None:
        """Write; an empty packet ends a transfer that fills its last packet."""
        os.write(self._in, data)
        if is_last and len(data) % functionfs.HIGH_SPEED_PACKET == 0:
            os.write(self._in, b"")

    def _halt(self) -> None:
        """FunctionFS halts an endpoint that is used against its direction."""
        try:
            os.read(self._in, 0)
        except OSError as error:
            if error.errno != errno.EBADMSG:
                raise


@contextmanager
def plugged_in(responder: Responder, identity: functionfs.UsbIdentity = D4S) -> Iterator[UsbGadget]:
    """A simulated camera on the bus of a simulated controller for as long as the block runs."""
    with functionfs.mounted_function(identity) as (endpoints, controller_file):
        gadget = UsbGadget(responder, endpoints, controller_file)
        try:
            gadget.plug_in()
            yield gadget
        finally:
            gadget.close()


def _containers(received: bytearray) -> Iterator[Container]:
    """Take whole containers out of what was received."""
    while len(received) >= HEADER_BYTES:
        length = int.from_bytes(received[:4], "little")
        if length > len(received):
            return
        data = bytes(received[: max(length, HEADER_BYTES)])
        del received[: max(length, HEADER_BYTES)]
        yield Container.decode(data)
