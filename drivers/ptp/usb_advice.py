"""What a person must do when the computer does not hand the USB camera over."""

from __future__ import annotations

import os
import sys
from pathlib import Path

UDEV_RULES = "/etc/udev/rules.d/70-lumisplit-camera.rules"


def no_libusb() -> str:
    """Libusb itself is missing."""
    return (
        "libusb 1.0 is not installed, so no USB camera can be reached; install it: "
        "Debian, Ubuntu: sudo apt install libusb-1.0-0; macOS: brew install libusb; "
        "Windows: pip install libusb-package"
    )


def busy(bus: int, address: int, platform: str = sys.platform, processes: str = "/proc") -> str:
    """Another program has claimed the camera."""
    start = f"another program holds the camera (usb:{bus:03d},{address:03d}, busy)"
    if platform == "darwin":
        return (
            f"{start}: macOS's own ptpcamerad or PTPCamera takes every camera that is plugged in; "
            "quit Photos and Image Capture, then: sudo pkill -9 ptpcamerad PTPCamera, "
            "and start this program within a second, since macOS takes it again"
        )
    if platform == "win32":
        return f"{start}: close the camera maker's program and the import window of Windows"
    names = holders(bus, address, Path(processes))
    if names and not any("gvfs" in name or name == "gphoto2" for name in names):
        return f"{start}: it is held by {', '.join(names)}; end that program and try again"
    holder = f"{', '.join(names)}, " if names else "most often gvfs-gphoto2-volume-monitor, "
    return (
        f"{start}: it is held by {holder}the desktop's own picture import; free it: "
        "systemctl --user stop gvfs-gphoto2-volume-monitor.service; gio mount -s gphoto2; "
        "pkill gvfsd-gphoto2; to keep it free: "
        "systemctl --user mask gvfs-gphoto2-volume-monitor.service"
    )


def denied(vendor: int, product: int, platform: str = sys.platform) -> str:
    """The user may not open the device."""
    start = f"no permission to open the camera {vendor:04x}:{product:04x}"
    if platform == "win32":
        return unsupported(vendor, product, platform)
    if platform == "darwin":
        return f"{start}: macOS's ptpcamerad holds it; sudo pkill -9 ptpcamerad, then try again"
    return (
        f"{start}; allow it once with the udev rule {udev_rule(vendor, product)}: "
        f"echo '{udev_rule(vendor, product)}' | sudo tee {UDEV_RULES} && "
        "sudo udevadm control --reload && sudo udevadm trigger; then plug the camera in again"
    )


def udev_rule(vendor: int, product: int) -> str:
    """The rule that opens the device to everybody who uses this machine."""
    return (
        f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", '
        f'ATTR{{idProduct}}=="{product:04x}", MODE="0666"'
    )


def unsupported(vendor: int, product: int, platform: str = sys.platform) -> str:
    """Libusb sees the device but has no way to talk to it."""
    start = f"the camera {vendor:04x}:{product:04x} has no driver that libusb can use"
    if platform == "win32":
        return (
            f"{start}; give it WinUSB: start Zadig (https://zadig.akeo.ie), Options > List All "
            f"Devices, choose the camera, target WinUSB, Replace Driver"
        )
    return f"{start}; plug it in directly rather than through a virtual machine, and try again"


def gone() -> str:
    """The device no longer answers on the bus."""
    return (
        "the camera is gone from the USB: unplugged, switched off, asleep or out of battery; "
        "check cable and battery, set the camera's standby timer to its longest, switch it on"
    )


def holders(bus: int, address: int, processes: Path = Path("/proc")) -> list[str]:
    """Names of the other programs that have the device file open, as far as this user may see."""
    node = f"/dev/bus/usb/{bus:03d}/{address:03d}"
    names = set()
    for process in processes.glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        try:
            if any(str(link.readlink()) == node for link in (process / "fd").iterdir()):
                names.add((process / "comm").read_text().strip())
        except OSError:  # ended meanwhile, or another user's
            continue
    return sorted(names)
