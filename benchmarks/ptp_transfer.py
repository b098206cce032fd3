"""Time and memory of fetching a 20 MB object with the driver, against a bare pyusb read loop.

    python -m benchmarks.ptp_transfer

Both read from the same simulated device behind pyusb's backend interface, in this process: its
bulk pipe delivers at the pace of USB 2.0 (`BYTES_PER_S`, after which it has the next bytes). The
bare loop sends the same command and reads until the response has come, no more. Times alternate
and their medians are compared; the memory is the peak of Python's allocations above the start.
"""

from __future__ import annotations

import array
import statistics
import struct
import time
import tracemalloc
from collections.abc import Callable

import usb.core

from drivers.clock import SystemClock
from drivers.ptp import objects
from drivers.ptp.codes import ContainerType, Operation, ResponseCode
from drivers.ptp.datasets import ObjectInfo
from drivers.ptp.session import PtpSession
from drivers.ptp.usb import UsbLink
from drivers.ptp.usb_port import find
from drivers.ptp.wire import HEADER_BYTES, Bytes, Container, Header
from tests.drivers.ptp.usb_backend import BULK_IN, BULK_OUT, Bus, usb_timeout

OBJECT_BYTES = 20_000_000
BYTES_PER_S = 40e6
READ_BYTES = 1 << 20
PAIRS = 15
HANDLE = 1
MAX_RATIO = 1.02
MAX_COPIES = 1.2  # the object and one read's buffers


class PacedPipe:
    """A device with one object, whose bytes become ready at a fixed pace."""

    packet_bytes = 512
    is_plugged_in = True

    def __init__(self, content: bytes) -> None:
        self._content = memoryview(content)
        self._head = b""
        self._rest = memoryview(b"")
        self._response = Container(ContainerType.RESPONSE, ResponseCode.OK, 0)
        self._ready_s = 0.0

    def write(self, data: bytes) -> None:
        """Take a command; what answers it lies ready."""
        command = Container.decode(data)
        payload = self._content
        if command.code == Operation.GET_PARTIAL_OBJECT:
            _, offset, length = command.parameters
            payload = payload[offset : offset + length]
        kind, length = ContainerType.DATA, HEADER_BYTES + len(payload)
        self._head = Header(length, kind, command.code, command.transaction).encode()
        self._rest = payload
        self._response = Container(ContainerType.RESPONSE, ResponseCode.OK, command.transaction)
        self._ready_s = time.perf_counter()

    def read(self, size: int, timeout_s: float) -> Bytes:  # noqa: ARG002
        """As much of the data as fits, then the response; nothing is held twice."""
        if self._head or self._rest:
            room = size - len(self._head)
            part = b"".join((self._head, self._rest[:room])) if self._head else self._rest[:room]
            self._head, self._rest = b"", self._rest[room:]
        else:
            part = self._response.encode()
        self._ready_s += len(part) / BYTES_PER_S
        while time.perf_counter() < self._ready_s:
            pass
        return part

    def read_event(self, size: int, timeout_s: float) -> bytes:  # noqa: ARG002
        """There are no events."""
        raise usb_timeout()

    def control(self, kind: int, request: int, data: array.array[int]) -> int:  # noqa: ARG002
        """Every request is taken."""
        return len(data)

    def clear_halt(self, endpoint: int) -> None:
        """It never halts."""


def bare_loop(bus: Bus) -> int:
    """Nothing but pyusb: a command, reads of 1 MiB that are thrown away, the response."""
    device = usb.core.find(backend=bus)
    device.write(BULK_OUT, struct.pack("<IHHII", 16, 1, Operation.GET_OBJECT, 7, HANDLE))
    received = 0
    while received < HEADER_BYTES + OBJECT_BYTES:
        received += len(device.read(BULK_IN, READ_BYTES))
    device.read(BULK_IN, READ_BYTES)
    return received - HEADER_BYTES


def driver(session: PtpSession, operations: frozenset[int]) -> int:
    """What the camera does to fetch a picture."""
    about = ObjectInfo(storage=1, object_format=0x3000, size=OBJECT_BYTES, filename="a.nef")
    return len(objects.download(session, HANDLE, about, operations).data)


def seconds(action: Callable[[], int]) -> float:
    """Time of one transfer, which must be whole."""
    started_s = time.perf_counter()
    assert action() == OBJECT_BYTES
    return time.perf_counter() - started_s


def peak_bytes(action: Callable[[], int]) -> int:
    """Memory that one transfer takes at most."""
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def compare(name: str, bus: Bus, session: PtpSession, operations: frozenset[int]) -> None:
    """Print and judge one way of fetching."""

    def driven() -> int:
        return driver(session, operations)

    pairs = [(seconds(lambda: bare_loop(bus)), seconds(driven)) for _ in range(PAIRS)]
    bare_s, driver_s = (statistics.median(times) for times in zip(*pairs, strict=True))
    ratio = statistics.median(with_driver / bare for bare, with_driver in pairs)
    copies = peak_bytes(driven) / OBJECT_BYTES
    print(
        f"{name}: bare {bare_s:.4f} s, driver {driver_s:.4f} s, ratio {ratio:.4f}, "
        f"peak {copies:.2f} copies of the object"
    )
    assert ratio < MAX_RATIO
    assert copies < MAX_COPIES


def main() -> None:
    bus = Bus(PacedPipe(bytes(OBJECT_BYTES)))
    link = UsbLink(find(bus)[0])
    session = PtpSession(link, SystemClock())
    compare("in one transfer, as from Nikon's memory", bus, session, frozenset())
    compare("in parts, as from a card", bus, session, frozenset({Operation.GET_PARTIAL_OBJECT}))
    link.close()


if __name__ == "__main__":
    main()
