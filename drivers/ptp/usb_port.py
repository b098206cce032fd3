"""Still image interfaces on the USB: where the cameras are, before anything is claimed."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import usb.core
import usb.util

from drivers.errors import CameraError
from drivers.ptp import usb_advice
from drivers.ptp.errors import PtpTransportError

STILL_IMAGE = (6, 1, 1)  # class, subclass, protocol


@dataclass(frozen=True, slots=True)
class UsbPort:
    """A still image interface on the bus.

    Parameters
    ----------
    bus, address, vendor, product
        Of the device.
    device
        pyusb's object.
    interface
        Number of the interface.
    bulk_in, bulk_out, interrupt_in
        Endpoint addresses from the descriptors; a camera without events has no `interrupt_in`.
    packet_bytes
        Size of the bulk pipes' packets.
    event_bytes
        Size of the interrupt pipe's packets.
    """

    bus: int
    address: int
    vendor: int
    product: int
    device: Any
    interface: int
    bulk_in: int
    bulk_out: int
    interrupt_in: int | None
    packet_bytes: int
    event_bytes: int

    @property
    def address_text(self) -> str:
        """The place on the bus, as gphoto2 writes it."""
        return f"usb:{self.bus:03d},{self.address:03d}"

    def text(self, descriptor: str) -> str | None:
        """A string of the device, ``product`` or ``serial_number``; None when it tells none."""
        try:
            text: str | None = getattr(self.device, descriptor)
        except (usb.core.USBError, ValueError, NotImplementedError):
            return None
        finally:
            usb.util.dispose_resources(self.device)
        return text


def find(backend: Any = None) -> list[UsbPort]:
    """All still image interfaces, in the order of the bus.

    Parameters
    ----------
    backend
        A pyusb backend; None for the system's libusb.
    """
    try:
        devices = list(usb.core.find(find_all=True, backend=backend) or [])
    except usb.core.NoBackendError as error:
        raise CameraError(usb_advice.no_libusb()) from error
    except usb.core.USBError as error:
        raise PtpTransportError(f"the USB cannot be searched: {error}") from error
    ports = itertools.chain.from_iterable(_ports(device) for device in devices)
    return sorted(ports, key=lambda port: (port.bus, port.address, port.interface))


def _ports(device: Any) -> Iterator[UsbPort]:
    try:
        interfaces = [interface for configuration in device for interface in configuration]
    except usb.core.USBError:  # gone since it was listed
        return
    for interface in interfaces:
        kind = interface.bInterfaceClass, interface.bInterfaceSubClass, interface.bInterfaceProtocol
        port = _port(device, interface) if kind == STILL_IMAGE else None
        if port is not None:
            yield port


def _port(device: Any, interface: Any) -> UsbPort | None:
    found: dict[tuple[int, int], Any] = {}
    for endpoint in interface:
        kind = usb.util.endpoint_type(endpoint.bmAttributes)
        direction = usb.util.endpoint_direction(endpoint.bEndpointAddress)
        found.setdefault((kind, direction), endpoint)
    bulk_in = found.get((usb.util.ENDPOINT_TYPE_BULK, usb.util.ENDPOINT_IN))
    bulk_out = found.get((usb.util.ENDPOINT_TYPE_BULK, usb.util.ENDPOINT_OUT))
    interrupt_in = found.get((usb.util.ENDPOINT_TYPE_INTR, usb.util.ENDPOINT_IN))
    if bulk_in is None or bulk_out is None:
        return None
    return UsbPort(
        bus=device.bus or 0,
        address=device.address or 0,
        vendor=device.idVendor,
        product=device.idProduct,
        device=device,
        interface=interface.bInterfaceNumber,
        bulk_in=bulk_in.bEndpointAddress,
        bulk_out=bulk_out.bEndpointAddress,
        interrupt_in=None if interrupt_in is None else interrupt_in.bEndpointAddress,
        packet_bytes=bulk_out.wMaxPacketSize & 0x7FF,
        event_bytes=64 if interrupt_in is None else interrupt_in.wMaxPacketSize & 0x7FF,
    )
