# ruff: noqa: ARG002  # pyusb prescribes the parameters
"""A pyusb backend without a bus: real pyusb, and whatever answers bytes at its far end."""

from __future__ import annotations

import array
import errno
import math
import struct
from collections import deque
from types import SimpleNamespace
from typing import Any, Protocol

import usb.backend
import usb.core

from drivers.protocols import Clock
from drivers.ptp.codes import ClassRequest, ContainerType, ResponseCode
from drivers.ptp.wire import HEADER_BYTES, Bytes, Container, Header
from drivers.sim.ptp_responder.answer import Cut, Output, Raw, Stall, Unplug

BULK_IN, BULK_OUT, INTERRUPT_IN = 0x81, 0x02, 0x83


def usb_error(number: int, text: str = "") -> usb.core.USBError:
    return usb.core.USBError(text or errno.errorcode[number], -1, number)


def usb_timeout() -> usb.core.USBTimeoutError:
    return usb.core.USBTimeoutError("timed out", -7, errno.ETIMEDOUT)


class Device(Protocol):
    """A camera in the responder's role."""

    def handle(self, container: Container) -> list[Output]: ...
    def due_events(self) -> list[Container]: ...
    def reset(self) -> None: ...


class Pipe(Protocol):
    """What is at the far end of the cable."""

    packet_bytes: int

    @property
    def is_plugged_in(self) -> bool: ...

    def write(self, data: bytes) -> None: ...
    def read(self, size: int, timeout_s: float) -> Bytes: ...
    def read_event(self, size: int, timeout_s: float) -> bytes: ...
    def control(self, kind: int, request: int, data: array.array[int]) -> int: ...
    def clear_halt(self, endpoint: int) -> None: ...


class Bus(usb.backend.IBackend):  # type: ignore[misc]  # pyusb has no types
    """One device, with one still image interface.

    Attributes
    ----------
    pipe
        The far end; None while nothing is plugged in.
    failures
        Errors that the next tries to claim the interface meet.
    calls
        Transfers that the host asked for, as (endpoint, size).
    """

    def __init__(self, pipe: Pipe | None, vendor: int = 0x04B0, product: int = 0x0435) -> None:
        self.pipe = pipe
        self.ids = vendor, product
        self.failures: list[usb.core.USBError] = []
        self.open_failure: usb.core.USBError | None = None
        self.address = 4
        self.is_claimed = False
        self.strings = {1: "Maker", 2: "D4S", 3: "0000123"}
        self.calls: list[tuple[int, int]] = []

    @property
    def far_end(self) -> Pipe:
        if self.pipe is None:
            raise usb_error(errno.ENODEV)
        return self.pipe

    def enumerate_devices(self) -> list[int]:
        return [self.address] if self.pipe is not None and self.pipe.is_plugged_in else []

    def get_device_descriptor(self, dev: int) -> SimpleNamespace:
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0,
            bDeviceProtocol=0, bMaxPacketSize0=64, idVendor=self.ids[0], idProduct=self.ids[1],
            bcdDevice=0x100, iManufacturer=1, iProduct=2, iSerialNumber=3, bNumConfigurations=1,
            address=dev, bus=1, port_number=1, port_numbers=(1,), speed=3,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: int, config: int) -> SimpleNamespace:
        if config:
            raise IndexError(config)
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=39, bNumInterfaces=1, bConfigurationValue=1,
            iConfiguration=0, bmAttributes=0xC0, bMaxPower=1, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: int, intf: int, alt: int, config: int) -> Any:
        if intf or alt or config:
            raise IndexError((intf, alt, config))
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=3,
            bInterfaceClass=6, bInterfaceSubClass=1, bInterfaceProtocol=1, iInterface=0,
            extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: int, ep: int, intf: int, alt: int, config: int) -> Any:
        address = (BULK_IN, BULK_OUT, INTERRUPT_IN)[ep]
        packet = 64 if address == INTERRUPT_IN else self.far_end.packet_bytes
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=address,
            bmAttributes=3 if address == INTERRUPT_IN else 2, wMaxPacketSize=packet, bInterval=6,
            bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: int) -> int:
        if self.open_failure is not None:
            raise self.open_failure
        if dev not in self.enumerate_devices():
            raise usb_error(errno.ENODEV)
        return dev

    def close_device(self, handle: int) -> None:
        self.is_claimed = False

    def get_configuration(self, handle: int) -> int:
        return 1

    def claim_interface(self, handle: int, intf: int) -> None:
        if self.failures:
            raise self.failures.pop(0)
        self.is_claimed = True

    def release_interface(self, handle: int, intf: int) -> None:
        self.is_claimed = False

    def bulk_write(self, handle: int, ep: int, intf: int, data: Any, timeout: int) -> int:
        self._check(handle)
        self.far_end.write(bytes(data))
        return len(data)

    def bulk_read(self, handle: int, ep: int, intf: int, buff: Any, timeout: int) -> int:
        self._check(handle)
        self.calls.append((ep, len(buff)))
        return _fill(buff, self.far_end.read(len(buff), timeout / 1000))

    def intr_read(self, handle: int, ep: int, intf: int, buff: Any, timeout: int) -> int:
        self._check(handle)
        return _fill(buff, self.far_end.read_event(len(buff), timeout / 1000))

    def clear_halt(self, handle: int, ep: int) -> None:
        self._check(handle)
        self.far_end.clear_halt(ep)

    def ctrl_transfer(
        self, handle: int, kind: int, request: int, value: int, index: int, data: Any, timeout: int
    ) -> int:
        self._check(handle)
        if (kind, request) == (0x80, 6):  # GET_DESCRIPTOR, of a string
            text = (
                self.strings.get(value & 0xFF, "").encode("utf-16-le") if value & 0xFF else b"\t\4"
            )
            return _fill(data, (bytes([2 + len(text), 3]) + text)[: len(data)])
        return self.far_end.control(kind, request, data)

    def _check(self, handle: int) -> None:
        if handle not in self.enumerate_devices():
            raise usb_error(errno.ENODEV)


def _fill(buffer: Any, data: Bytes) -> int:
    memoryview(buffer)[: len(data)] = memoryview(data)
    return len(data)


class ResponderPipe:
    """The simulated camera at the end of the cable, in the bench's own time.

    Parameters
    ----------
    responder, clock
        The camera, and the time that passes while nothing comes.
    packet_bytes
        Size of the bulk packets.
    splits_headers
        Whether the header of data comes in a packet of its own.
    """

    def __init__(
        self,
        responder: Device,
        clock: Clock,
        packet_bytes: int = 512,
        splits_headers: bool = False,
    ) -> None:
        self.packet_bytes = packet_bytes
        self.requests: list[int] = []
        self.cleared: list[int] = []
        self.comes_back_after_s = math.inf
        self._back_s = -math.inf
        self._responder = responder
        self._clock = clock
        self._splits_headers = splits_headers
        self._received = bytearray()
        self._transfers: deque[memoryview] = deque()
        self._is_halted = False
        self._events: deque[bytes] = deque()

    def write(self, data: bytes) -> None:
        self._check()
        self._received += data
        while len(self._received) >= HEADER_BYTES:
            length = int.from_bytes(self._received[:4], "little")
            if len(self._received) < length:
                return
            container = Container.decode(bytes(self._received[:length]))
            del self._received[:length]
            for output in self._responder.handle(container):
                self._queue(output)

    def read(self, size: int, timeout_s: float) -> bytes:
        """One read: as much of a transfer as fits, or its end."""
        self._check()
        if self._is_halted:
            raise usb_error(errno.EPIPE)
        if not self._transfers:
            self._clock.sleep(timeout_s)
            raise usb_timeout()
        transfer = self._transfers[0]
        data, rest = transfer[:size], transfer[size:]
        if rest or (len(data) == size and len(data) % self.packet_bytes == 0):
            self._transfers[0] = rest
        else:
            self._transfers.popleft()
        return bytes(data)

    def read_event(self, size: int, timeout_s: float) -> bytes:
        self._check()
        self._events += [event.encode() for event in self._responder.due_events()]
        if not self._events:
            self._clock.sleep(timeout_s)
            raise usb_timeout()
        return self._events.popleft()[:size]

    def control(self, kind: int, request: int, data: array.array[int]) -> int:
        self._check()
        self.requests.append(request)
        if request == ClassRequest.DEVICE_RESET:
            self._responder.reset()
            self._transfers.clear()
            self._received.clear()
        if request == ClassRequest.GET_DEVICE_STATUS:
            return _fill(data, struct.pack("<HH", 4, ResponseCode.OK))
        return len(data)

    def clear_halt(self, endpoint: int) -> None:
        self.cleared.append(endpoint)
        self._is_halted = False

    def unplug(self) -> None:
        self._responder.reset()
        self._back_s = self._clock.now() + self.comes_back_after_s

    def plug_in(self) -> None:
        self._back_s = self._clock.now()

    @property
    def is_plugged_in(self) -> bool:
        return self._clock.now() >= self._back_s

    def _check(self) -> None:
        if not self.is_plugged_in and not self._transfers:
            raise usb_error(errno.ENODEV)

    def _queue(self, output: Output) -> None:
        match output:
            case Container(kind=ContainerType.DATA) as container:
                self._queue_data(container, container.payload)
            case Cut(container, size):
                self._queue_data(container, container.payload[:size])
            case Container() as container:
                self._transfers.append(memoryview(container.encode()))
            case Raw(data):
                self._transfers.append(memoryview(data))
            case Stall():
                self._is_halted = True
            case Unplug():
                self.unplug()

    def _queue_data(self, container: Container, payload: Bytes) -> None:
        length = HEADER_BYTES + len(container.payload)
        header = Header(length, container.kind, container.code, container.transaction).encode()
        if self._splits_headers:
            self._transfers += [memoryview(header), memoryview(payload)]
        else:
            self._transfers.append(memoryview(header + payload))
