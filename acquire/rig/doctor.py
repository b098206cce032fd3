"""What is plugged in, what is missing and what to do; changes nothing."""

from __future__ import annotations

import importlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from acquire.rig import hardware
from drivers.errors import DriverError
from drivers.monitors import choose_monitor
from drivers.ptp.discovery import FoundCamera, open_camera
from drivers.serial_line import list_serial_ports


class Verdict(StrEnum):
    """How a finding bears on a capture."""

    GOOD = "good"
    NOTE = "note"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at: what was found and, unless it is good, what to do."""

    subject: str
    verdict: Verdict
    text: str


def examine() -> list[Finding]:
    """Look at everything; a look that fails is a finding, not an error."""
    return [finding for look in _LOOKS for finding in look()]


def bench_text(findings: list[Finding]) -> str:
    """A bench file for the projector and camera that were found, in TOML."""
    lines = ['kind = "lab"']
    projector = next(
        (f for f in findings if f.subject == "projector" and f.verdict == "good"), None
    )
    if projector is not None:
        lines += ["", "[projector]", f"monitor = {json.dumps(projector.text.split()[0])}"]
    serials = [camera.serial_number for camera in _cameras() if camera.serial_number]
    if serials:
        lines += ["", "[camera]", f"address = {json.dumps(serials[0])}"]
    return "\n".join(lines) + "\n"


def _cameras() -> list[FoundCamera]:
    try:
        return hardware.cameras()
    except DriverError:
        return []


def _look_at_display() -> Iterator[Finding]:
    kind = os.environ.get("XDG_SESSION_TYPE", "")
    if not os.environ.get("DISPLAY"):
        yield Finding(
            "display",
            Verdict.BAD,
            "no X server (DISPLAY is not set): log in at the computer's own screen, or on Wayland "
            "choose an Xorg session; over ssh set DISPLAY=:0. Simulation and processing need none.",
        )
        return
    yield Finding("display", Verdict.GOOD, f"DISPLAY {os.environ['DISPLAY']} {kind}".strip())


def _look_at_monitors() -> Iterator[Finding]:
    try:
        found = hardware.monitors()
    except DriverError as error:
        yield Finding("monitors", Verdict.BAD, str(error))
        return
    for monitor in found:
        yield Finding("monitor", Verdict.GOOD, str(monitor))
    try:
        yield Finding("projector", Verdict.GOOD, str(choose_monitor(found, None)))
    except DriverError as error:
        yield Finding("projector", Verdict.BAD, str(error))
    yield from _look_at_colours()


def _look_at_colours() -> Iterator[Finding]:
    """A night light keeps setting ramps, also those that the pattern window has made linear."""
    night = next((name for name in ("redshift", "gammastep") if _is_running(name)), None)
    if night is not None:
        text = f"{night} shifts the colours of the screens: `pkill {night}`"
        yield Finding("colours", Verdict.BAD, text)
        return
    try:
        tinted = hardware.tinted_monitors()
    except DriverError as error:
        yield Finding("colours", Verdict.NOTE, f"the gamma ramps cannot be read: {error}")
        return
    for connector, cast in tinted.items():
        yield Finding("colours", Verdict.BAD, _TINTED.format(connector=connector, cast=cast))
    if not tinted:
        yield Finding("colours", Verdict.GOOD, "the gamma ramps of all monitors are neutral")


_TINTED = (
    "the gamma ramps of {connector} differ between the colours by {cast:.0%} of full light: a "
    "night light or a display profile is at work, and may come back in mid-capture. GNOME: "
    "`gsettings set org.gnome.settings-daemon.plugins.color night-light-enabled false`; KDE: "
    "System Settings, Night Light; a profile: `xrandr --output {connector} --gamma 1:1:1` and no "
    "profile for it in the colour settings"
)


def _look_at_opengl() -> Iterator[Finding]:
    for name in ("glfw", "moderngl"):
        try:
            importlib.import_module(name)
        except (ImportError, OSError) as error:
            yield Finding(
                "OpenGL",
                Verdict.BAD,
                f"{name} cannot be loaded ({error}): `sudo apt install libgl1 libegl1`",
            )
            return
    yield Finding("OpenGL", Verdict.GOOD, "glfw and moderngl load")


def _look_at_usb() -> Iterator[Finding]:
    try:
        found = hardware.cameras()
    except DriverError as error:
        yield Finding("USB", Verdict.BAD, str(error))
        return
    if not found:
        yield Finding(
            "camera",
            Verdict.NOTE,
            "no camera on the USB: check that it is on and awake, its cable, and that its USB mode "
            "is PTP or MTP; one with a network port is named with its address, ptpip:HOST",
        )
    for camera in found:
        yield from _look_into(camera)


def _look_into(camera: FoundCamera) -> Iterator[Finding]:
    name = f"{camera.name or 'camera'} ({camera.serial_number or camera.address})"
    try:
        with open_camera(camera.address) as opened:
            state = opened.state()
    except DriverError as error:
        yield Finding("camera", Verdict.BAD, f"{name}: {error}")
        return
    yield Finding("camera", Verdict.GOOD, name)
    for warning in state.warnings:
        yield Finding("camera", Verdict.BAD, f"{name}: {warning}")


def _look_at_serial_ports() -> Iterator[Finding]:
    ports = list_serial_ports()
    for port, description in ports:
        if os.name != "posix" or os.access(port, os.R_OK | os.W_OK):
            yield Finding("serial port", Verdict.GOOD, f"{port} {description}")
        else:
            yield Finding(
                "serial port",
                Verdict.BAD,
                f"{port} may not be opened: `sudo usermod -aG dialout $USER`, log in again",
            )
    if not ports:
        yield Finding("serial port", Verdict.NOTE, "none; only lamp control and trigger need one")


def _is_running(name: str) -> bool:
    if not os.path.isdir("/proc"):  # noqa: PTH112 - the kernel's own folder
        return False
    for entry in os.scandir("/proc"):
        if entry.name.isdigit():
            try:
                with open(f"/proc/{entry.name}/comm", encoding="utf-8") as file:  # noqa: PTH123
                    if file.read().strip() == name:
                        return True
            except OSError:
                continue
    return False


def _look_at_disk() -> Iterator[Finding]:
    free = shutil.disk_usage(os.curdir).free
    verdict = Verdict.GOOD if free > 30e9 else Verdict.NOTE
    yield Finding("disk", verdict, f"{free / 1e9:.0f} GB free here; a full session takes about 21")


_LOOKS: tuple[Callable[[], Iterator[Finding]], ...] = (
    _look_at_display,
    _look_at_monitors,
    _look_at_opengl,
    _look_at_usb,
    _look_at_serial_ports,
    _look_at_disk,
)
