"""libgphoto2's virtual Nikon D750 at the end of a cable: a responder that others wrote.

The wheel of gphoto2 ships it as an I/O driver of libgphoto2_port ("vusb"), which speaks USB
containers. It goes on counting transactions when a session is opened anew, so each session needs
a new one. Its functions are called directly, below libgphoto2's own PTP driver, so that the
bytes are this project's on one side and libgphoto2's on the other. It answers generic PTP.
Runs in a process of its own: the library is chosen by environment variables before the import.
"""

from __future__ import annotations

import array
import ctypes
import os
from pathlib import Path

from drivers.protocols import Clock
from drivers.ptp.codes import ClassRequest
from tests.drivers.ptp.usb_backend import usb_error, usb_timeout

GP_ERROR_TIMEOUT = -10
MAPS = Path("/proc/self/maps")


class VirtualNikon:
    """A pipe to the virtual camera (see `tests.drivers.ptp.usb_backend.Pipe`).

    Parameters
    ----------
    folder
        With the JPEG files that it has and delivers.
    clock
        For the silence of an event pipe.
    """

    packet_bytes = 512
    is_plugged_in = True

    def __init__(self, folder: Path, clock: Clock) -> None:
        os.environ["VCAMERADIR"] = str(folder)
        import gphoto2  # noqa: F401  # sets up the drivers' folders and loads the library

        self._library = ctypes.CDLL(_loaded("libgphoto2_port-"))
        self._clock = clock
        self._port = ctypes.c_void_p()
        self._do("gp_port_new", ctypes.byref(self._port))
        ports, place = ctypes.c_void_p(), ctypes.c_void_p()
        self._do("gp_port_info_list_new", ctypes.byref(ports))
        self._do("gp_port_info_list_load", ports)
        number = self._do("gp_port_info_list_lookup_path", ports, b"usb:001,001")
        self._do("gp_port_info_list_get_info", ports, number, ctypes.byref(place))
        self._do("gp_port_set_info", self._port, place)
        self._do("gp_port_open", self._port)

    def write(self, data: bytes) -> None:
        self._do("gp_port_write", self._port, data, len(data))

    def read(self, size: int, timeout_s: float) -> bytes:
        """It knows no packets: a read brings all that it has, and nothing where it is silent."""
        data = self._read("gp_port_read", size)
        if not data:
            self._clock.sleep(timeout_s)
            raise usb_timeout()
        return data

    def read_event(self, size: int, timeout_s: float) -> bytes:
        self._clock.sleep(timeout_s)
        return self._read("gp_port_check_int", size)

    def control(self, kind: int, request: int, data: array.array[int]) -> int:  # noqa: ARG002
        if request == ClassRequest.GET_DEVICE_STATUS:
            data[:4] = array.array("B", b"\x04\x00\x01\x20")
            return 4
        return len(data)

    def clear_halt(self, endpoint: int) -> None:
        """It never halts."""

    def _read(self, function: str, size: int) -> bytes:
        buffer = ctypes.create_string_buffer(size)
        count = self._do(function, self._port, buffer, size)
        return buffer.raw[:count]

    def _do(self, function: str, *arguments: object) -> int:
        result: int = getattr(self._library, function)(*arguments)
        if result == GP_ERROR_TIMEOUT:
            raise usb_timeout()
        if result < 0:
            raise usb_error(5, f"{function}: {result}")
        return result


def _loaded(name: str) -> str:
    """Path of a shared library that this process has mapped."""
    paths = {line.split()[-1] for line in MAPS.read_text().splitlines() if name in line}
    return paths.pop()
