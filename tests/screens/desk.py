"""The lab PC's desk: an operator's screen and a projector on one X server.

Xorg with its dummy driver, which has monitors to plug in but shows them to nobody, and Mesa's
software OpenGL. Debian's packages: xserver-xorg-core xserver-xorg-video-dummy x11-xserver-utils
libgl1 libgl1-mesa-dri.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

OPERATOR, PROJECTOR = "DUMMY0", "DUMMY1"
OPERATOR_PX = 1080, 1920
START_LIMIT_S = 20.0
Z_PIXMAP = 2
DRIVER = Path("/usr/lib/xorg/modules/drivers/dummy_drv.so")
PROGRAMS = ("Xorg", "xrandr", "xset")

# Timings after VESA CVT (1280x800) and CEA-861 (1920x1080, 1024x768 after VESA DMT).
CONFIGURATION = """
Section "Device"
  Identifier "graphics"
  Driver "dummy"
  VideoRam 128000
EndSection
Section "Monitor"
  Identifier "any"
  HorizSync 10-500
  VertRefresh 10-200
  Modeline "1920x1080" 148.50 1920 2008 2052 2200 1080 1084 1089 1125 +hsync +vsync
  Modeline "1280x800" 83.50 1280 1352 1480 1680 800 803 809 831 -hsync +vsync
  Modeline "1024x768" 65.00 1024 1048 1184 1344 768 771 777 806 -hsync -vsync
EndSection
Section "Screen"
  Identifier "desk"
  Device "graphics"
  Monitor "any"
  DefaultDepth 24
  SubSection "Display"
    Depth 24
    Modes "1920x1080"
    Virtual 3840 1080
  EndSubSection
EndSection
"""


def missing() -> str:
    """What this machine lacks for a desk; empty if nothing."""
    lacking = [program for program in PROGRAMS if shutil.which(program) is None]
    if not DRIVER.exists():
        lacking.append(str(DRIVER))
    return ", ".join(lacking)


@dataclass(frozen=True, slots=True)
class Desk:
    """Two monitors side by side, the operator's on the left.

    Parameters
    ----------
    environment
        For programs that are to run on it.
    projector_px
        (height, width) of the projector.
    """

    environment: dict[str, str]
    projector_px: tuple[int, int]

    def run(self, *command: str) -> str:
        """What a program on this desk prints."""
        return subprocess.run(
            command, env=self.environment, check=True, capture_output=True, text=True
        ).stdout

    def arrange(self) -> None:
        """Plug both monitors in, side by side, neutral in colour, no screen saver."""
        height, width = self.projector_px
        mode = f"{width}x{height}"
        self.run("xrandr", "--addmode", PROJECTOR, mode)
        self.run(
            "xrandr",
            *("--output", OPERATOR, "--primary", "--mode", "1920x1080", "--pos", "0x0"),
            *("--output", PROJECTOR, "--mode", mode, "--pos", "1920x0"),
        )
        for output in (OPERATOR, PROJECTOR):
            self.run("xrandr", "--output", output, "--gamma", "1:1:1")
        self.run("xset", "s", "off", "s", "reset")
        self.run("xrandr")  # makes the server read its outputs again

    def photograph(self) -> NDArray[np.uint8]:
        """Everything on the desktop, (height, width, 3), red first."""
        with x_client(self.environment["DISPLAY"]) as client:
            root = client.get_setup().roots[0].root
            size = client.core.GetGeometry(root).reply()
            place = root, 0, 0, size.width, size.height, 0xFFFFFFFF
            request = client.core.GetImage(Z_PIXMAP, *place)
            # The reply's own parser makes a list of millions of integers.
            reply = client.wait_for_reply(request.sequence)
            length = 4 * size.width * size.height
            pixels = np.frombuffer(bytes(reply.buf[32 : 32 + length]), np.uint8)
        return pixels.reshape(size.height, size.width, 4)[..., 2::-1]

    @contextmanager
    def at_hand(self) -> Iterator[None]:
        """Make it this process's display; several desks may run side by side."""
        with displayed(DISPLAY=self.environment["DISPLAY"], WAYLAND_DISPLAY=None):
            yield

    def operator_screen(self, photograph: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The part of a photograph that the operator sees."""
        height, width = OPERATOR_PX
        return photograph[:height, :width]

    def projector_screen(self, photograph: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The part of a photograph that is projected."""
        height, width = self.projector_px
        return photograph[:height, OPERATOR_PX[1] : OPERATOR_PX[1] + width]


@contextmanager
def x_client(display: str | None = None) -> Iterator[Any]:
    """A connection to an X server, by default that of ``DISPLAY``."""
    # Loads libxcb, which a machine without a desk need not have.
    import xcffib
    import xcffib.xproto

    library: Any = xcffib
    connection = library.connect(display)
    try:
        yield connection
    finally:
        connection.disconnect()


@contextmanager
def set_up_desk(folder: Path, projector_px: tuple[int, int]) -> Iterator[Desk]:
    """Start the X server and arrange its monitors."""
    configuration = folder / "xorg.conf"
    configuration.write_text(CONFIGURATION)
    reader, writer = os.pipe()
    server = subprocess.Popen(
        [
            *("Xorg", "-displayfd", str(writer), "-config", str(configuration)),
            *("-logfile", str(folder / "xorg.log"), "-noreset", "-nolisten", "tcp"),
        ],
        pass_fds=[writer],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(writer)
    try:
        display = _display(reader, server, folder)
        environment = {key: value for key, value in os.environ.items() if "WAYLAND" not in key}
        desk = Desk({**environment, "DISPLAY": display}, projector_px)
        desk.arrange()
        yield desk
    finally:
        server.terminate()
        server.wait()


def _display(reader: int, server: subprocess.Popen[bytes], folder: Path) -> str:
    deadline_s = time.monotonic() + START_LIMIT_S
    text = b""
    with os.fdopen(reader, "rb", buffering=0) as numbers:
        while not text.endswith(b"\n"):
            piece = numbers.read(16)
            if not piece or time.monotonic() > deadline_s:
                server.wait()
                log = (folder / "xorg.log").read_text(errors="replace")
                raise RuntimeError(f"Xorg did not start:\n{log[-2000:]}")
            text += piece
    return f":{int(text)}"


@contextmanager
def displayed(**variables: str | None) -> Iterator[None]:
    """Environment variables set, or unset where None, for this process and its children."""
    before = {name: os.environ.get(name) for name in variables}
    _put(variables)
    try:
        yield
    finally:
        _put(before)


def _put(variables: dict[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
