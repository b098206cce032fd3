"""A serial port on which a question is asked until an intelligible answer comes."""

from __future__ import annotations

import errno
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from drivers.errors import SerialError

Answer = TypeVar("Answer")

TRIES = 3
WRITE_LIMIT_S = 2.0
MAX_LINE_BYTES = 256  # longer ones are noise
_SHOWN_BYTES = 80


def list_serial_ports() -> list[tuple[str, str]]:
    """Names of the serial ports of this computer and what hangs on each, as far as it tells."""
    from serial.tools import list_ports  # noqa: PLC0415 - only a lab with a serial line needs it

    return sorted((port.device, port.description) for port in list_ports.comports())


class SerialLine:
    """An open serial port: 8 data bits, no parity, 1 stop bit, no flow control.

    Parameters
    ----------
    port
        Device file: ``/dev/ttyUSB0``; better a name that stays, from ``/dev/serial/by-id``.
    baud
        Symbols a second.
    """

    def __init__(self, port: str, baud: int) -> None:
        import serial  # noqa: PLC0415 - only a lab with a serial line needs it

        self.port, self.baud = port, baud
        self._failures: tuple[type[Exception], ...] = (serial.SerialException, OSError)
        if sys.platform != "win32":
            import termios  # noqa: PLC0415 - not on Windows

            # termios.error is no OSError, and pyserial lets it through.
            self._failures += (termios.error,)
        try:
            self._serial: Any = serial.Serial(
                port, baud, timeout=0, write_timeout=WRITE_LIMIT_S, exclusive=True
            )
        except self._failures as error:
            raise SerialError(_why_not_opened(port, error)) from error

    def ask(
        self,
        request: bytes,
        end: bytes,
        read: Callable[[bytes], Answer | None],
        limit_s: float,
    ) -> Answer:
        """Send a request, again where need be, until `read` understands an answer.

        Parameters
        ----------
        request
            Bytes to send; sending them repeatedly must do no harm.
        end
            What ends an answer.
        read
            Turns a line, without its end, into the answer; None for noise, an echo or the answer
            to another question.
        limit_s
            How long to wait for the answer to each try.

        Raises
        ------
        SerialError
            Nothing intelligible came, or the port is gone.
        """
        heard = b""
        for _ in range(TRIES):
            self._write(request)
            deadline_s = time.monotonic() + limit_s
            for line in self._lines(end, deadline_s):
                heard = line
                # Half a line may look like a whole answer to another question.
                answer = read(line.removesuffix(end)) if line.endswith(end) else None
                if answer is not None:
                    return answer
        raise SerialError(self._complaint(request, heard))

    def close(self) -> None:
        """Close the port; may be called more than once."""
        self._serial.close()

    def _write(self, request: bytes) -> None:
        with self._mapped():
            self._serial.reset_input_buffer()
            self._serial.write(request)

    def _lines(self, end: bytes, deadline_s: float) -> Iterator[bytes]:
        """Lines with their end until the deadline; what is left then comes last, without."""
        pending = b""
        while (remaining_s := deadline_s - time.monotonic()) > 0:
            with self._mapped():
                self._serial.timeout = remaining_s
                pending += self._serial.read(max(1, self._serial.in_waiting))
            *lines, pending = pending.split(end)
            pending = pending[-MAX_LINE_BYTES:]
            for line in lines:
                yield line + end
        if pending:
            yield pending

    @contextmanager
    def _mapped(self) -> Iterator[None]:
        try:
            yield
        except self._failures as error:
            raise SerialError(
                f"The serial port {self.port} failed ({error}). Was its adapter unplugged? Plug "
                "it in again and run the same command."
            ) from error

    def _complaint(self, request: bytes, heard: bytes) -> str:
        asked = f"The device on {self.port} was asked {request!r} {TRIES} times"
        if not heard:
            return (
                f"{asked} and stayed silent. Is it powered, is its serial control turned on in "
                "its menu, and is the cable the right one (a null modem crosses TX and RX, a "
                f"straight cable does not)? It must be set to {self.baud} baud, 8N1."
            )
        return (
            f"{asked} and answered {heard[-_SHOWN_BYTES:]!r}, which means nothing here. Usually "
            f"the baud rate differs: set the device to {self.baud} baud, 8N1, or put its rate in "
            "the bench file; else another kind of device hangs on this port."
        )


def _why_not_opened(port: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        return (
            f"There is no serial port {port}. Plug its adapter in; `ls /dev/serial/by-id` lists "
            "those that are."
        )
    if number in {errno.EACCES, errno.EPERM}:
        return (
            f"This user may not use the serial port {port}. Run `sudo usermod -aG dialout $USER`, "
            "then log out and in again."
        )
    if number in {errno.EAGAIN, errno.EBUSY}:
        return (
            f"Another program has the serial port {port} open. Close it; `sudo fuser {port}` tells "
            "which it is."
        )
    return f"The serial port {port} cannot be opened ({error}). Is it a serial port?"
