"""Finding cameras and opening one of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.clock import SystemClock
from drivers.errors import CameraError
from drivers.protocols import Clock
from drivers.ptp import ip, usb_port
from drivers.ptp.camera import PtpCamera
from drivers.ptp.link import Link
from drivers.ptp.usb import UsbLink

IP_PREFIX = "ptpip:"


@dataclass(frozen=True, slots=True)
class FoundCamera:
    """A camera on the USB.

    Parameters
    ----------
    address
        Where it is, ``usb:BUS,DEVICE``: what `open_camera` takes. Changes when it is plugged in
        again.
    name, serial_number
        From its descriptors; None when it does not tell or may not be opened.
    vendor, product
        USB ids.
    """

    address: str
    name: str | None
    serial_number: str | None
    vendor: int
    product: int


def list_cameras(backend: Any = None) -> list[FoundCamera]:
    """All cameras on the USB; those on a network cannot be found, only named.

    Parameters
    ----------
    backend
        A pyusb backend; None for the system's libusb.
    """
    return [
        FoundCamera(
            port.address_text,
            port.text("product"),
            port.text("serial_number"),
            port.vendor,
            port.product,
        )
        for port in usb_port.find(backend)
    ]


def open_camera(
    which: str | None = None, clock: Clock | None = None, backend: Any = None
) -> PtpCamera:
    """Open a camera.

    Parameters
    ----------
    which
        ``usb:BUS,DEVICE``, ``ptpip:HOST`` or ``ptpip:HOST:PORT``, or a serial number; None when
        there is only one on the USB.
    clock
        The bench's.
    backend
        A pyusb backend; None for the system's libusb.

    Raises
    ------
    drivers.errors.CameraError
        No such camera, more than one, or it cannot be opened; says what to do.
    """
    clock = SystemClock() if clock is None else clock
    if which is not None and which.startswith(IP_PREFIX):
        host, port = _endpoint(which.removeprefix(IP_PREFIX))
        return PtpCamera(lambda: ip.IpLink(host, port), clock)

    def connect() -> Link:
        return UsbLink(_only_one(usb_port.find(backend), which), clock)

    return PtpCamera(connect, clock)


def _endpoint(text: str) -> tuple[str, int]:
    host, _, port = text.partition(":")
    if not host or not (port or "1").isdigit():
        raise CameraError(f"{IP_PREFIX}{text} is no address; write ptpip:HOST or ptpip:HOST:PORT")
    return host, int(port) if port else ip.PORT


def _only_one(ports: list[usb_port.UsbPort], which: str | None) -> usb_port.UsbPort:
    if which is not None:
        ports = [port for port in ports if which == port.address_text or _has_serial(port, which)]
    if len(ports) == 1:
        return ports[0]
    if ports:
        places = ", ".join(port.address_text for port in ports)
        raise CameraError(f"there are several cameras ({places}): name one or its serial number")
    raise CameraError(
        ("no camera on the USB" if which is None else f"no camera {which} on the USB")
        + "; check that it is on and awake, its cable, and that its USB mode is PTP or MTP"
    )


def _has_serial(port: usb_port.UsbPort, which: str) -> bool:
    """Bodies pad their number with zeros; what is engraved on them has none."""
    serial_number = port.text("serial_number")
    return serial_number is not None and serial_number.lstrip("0") == which.lstrip("0")
