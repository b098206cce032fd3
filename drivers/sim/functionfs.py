"""A still image USB device on a Linux gadget controller: configfs folders and FunctionFS files.

After the kernel's Documentation/usb/gadget_configfs.rst and Documentation/usb/functionfs.rst;
the structures are those of linux/usb/functionfs.h and of chapter 9 of USB 2.0. Needs root and a
USB device controller; `dummy_hcd` is one that is plugged into the same machine.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

CONTROLLERS = Path("/sys/class/udc")
GADGETS = Path("/sys/kernel/config/usb_gadget")
STILL_IMAGE = (6, 1, 1)  # class, subclass, protocol
FULL_SPEED_PACKET, HIGH_SPEED_PACKET, EVENT_PACKET = 64, 512, 64
_BULK_IN, _BULK_OUT, _INTERRUPT_IN = 0x81, 0x02, 0x83
_BULK, _INTERRUPT = 2, 3
_DESCRIPTORS_MAGIC, _STRINGS_MAGIC = 3, 2
_HAS_FULL_AND_HIGH_SPEED = 1 | 2
_LANGUAGE = 0x409


@dataclass(frozen=True, slots=True)
class UsbIdentity:
    """What the device says of itself before any PTP: ids (16 bits each) and strings."""

    vendor: int
    product: int
    manufacturer: str
    name: str
    serial_number: str


def descriptors() -> bytes:
    """Interface and endpoints for full and high speed, as FunctionFS takes them on ``ep0``."""
    full = _speed(FULL_SPEED_PACKET, event_interval=10)
    high = _speed(HIGH_SPEED_PACKET, event_interval=6)
    body = struct.pack("<II", 4, 4) + full + high
    header = struct.pack("<III", _DESCRIPTORS_MAGIC, 12 + len(body), _HAS_FULL_AND_HIGH_SPEED)
    return header + body


def strings() -> bytes:
    """The interface's name, as FunctionFS takes it on ``ep0``."""
    body = struct.pack("<H", _LANGUAGE) + b"PTP\0"
    return struct.pack("<IIII", _STRINGS_MAGIC, 16 + len(body), 1, 1) + body


def _speed(packet: int, event_interval: int) -> bytes:
    interface = struct.pack("<9B", 9, 4, 0, 0, 3, *STILL_IMAGE, 1)
    endpoints = (
        (_BULK_IN, _BULK, packet, 0),
        (_BULK_OUT, _BULK, packet, 0),
        (_INTERRUPT_IN, _INTERRUPT, EVENT_PACKET, event_interval),
    )
    return interface + b"".join(struct.pack("<4BHB", 7, 5, *endpoint) for endpoint in endpoints)


@contextlib.contextmanager
def mounted_function(identity: UsbIdentity, name: str = "lumisplit") -> Iterator[tuple[Path, Path]]:
    """Build the gadget and mount its function.

    Yields the folder with the function's endpoint files and the file `UDC`, into which a
    controller's name is written to plug the device in and an empty line to unplug it.
    """
    gadget, mount = GADGETS / name, Path("/run") / name
    _build(gadget, identity, name)
    mount.mkdir(exist_ok=True)
    _mount(name, mount)
    try:
        yield mount, gadget / "UDC"
    finally:
        with contextlib.suppress(OSError):
            (gadget / "UDC").write_text("\n")
        _unmount(mount)
        _remove(gadget, name)


def controller() -> str:
    """Name of the machine's first USB device controller."""
    names = sorted(path.name for path in CONTROLLERS.glob("*"))
    if not names:
        raise OSError("this machine has no USB device controller; try: modprobe dummy_hcd")
    return names[0]


def _build(gadget: Path, identity: UsbIdentity, name: str) -> None:
    texts = gadget / "strings" / hex(_LANGUAGE)
    configuration = gadget / "configs" / "c.1"
    for folder in (gadget, texts, configuration, gadget / "functions" / f"ffs.{name}"):
        folder.mkdir(exist_ok=True)
    (gadget / "idVendor").write_text(hex(identity.vendor))
    (gadget / "idProduct").write_text(hex(identity.product))
    (gadget / "bcdUSB").write_text("0x0200")
    (texts / "manufacturer").write_text(identity.manufacturer)
    (texts / "product").write_text(identity.name)
    (texts / "serialnumber").write_text(identity.serial_number)
    (configuration / f"ffs.{name}").symlink_to(gadget / "functions" / f"ffs.{name}")


def _remove(gadget: Path, name: str) -> None:
    configuration = gadget / "configs" / "c.1"
    (configuration / f"ffs.{name}").unlink()
    for folder in (configuration, gadget / "functions" / f"ffs.{name}"):
        folder.rmdir()
    (gadget / "strings" / hex(_LANGUAGE)).rmdir()
    gadget.rmdir()


def _mount(name: str, target: Path) -> None:
    if ctypes.CDLL(None, use_errno=True).mount(
        name.encode(), os.fsencode(target), b"functionfs", 0, None
    ):
        error = ctypes.get_errno()
        raise OSError(error, f"cannot mount FunctionFS: {os.strerror(error)}", str(target))


def _unmount(target: Path) -> None:
    ctypes.CDLL(None).umount(os.fsencode(target))
