"""A projector that is a monitor of this computer."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import threading
import weakref
from contextlib import suppress
from pathlib import Path
from typing import IO, NoReturn

import drivers
from drivers.errors import ProjectorError
from drivers.monitors import choose_monitor
from drivers.protocols import Clock, Raster
from drivers.raster import check_raster
from drivers.window_channel import Channel, Message
from drivers.xserver import list_monitors

OPENING_LIMIT_S = 30.0
ANSWER_LIMIT_S = 3.0
CLOSING_LIMIT_S = 2.0
LOOK_S = 0.05  # how often to look for bad news while waiting


class WindowProjector:
    """Shows rasters on a monitor, pixel for pixel (see `drivers.protocols.Projector`).

    The window lives in a process of its own, which blacks it out and gives the monitor back
    however this program ends (see `drivers.window_process`). Closed means: black, then gone; what
    the projector shows after that is the desktop.

    Parameters
    ----------
    monitor
        Connector or name of the monitor, as `drivers.xserver.list_monitors` has them. None: the
        only one besides the operator's.
    settle_s
        Time from the raster on the screen to its light settled on the scene, ≥ 0.
    clock
        The bench's clock.

    Raises
    ------
    ProjectorError
        There is no such monitor, or no window can be put on it exactly.
    """

    def __init__(self, monitor: str | None, settle_s: float, clock: Clock) -> None:
        if not settle_s >= 0:
            raise ValueError(f"settle_s is at least 0 s, not {settle_s}")
        self.monitor = choose_monitor(list_monitors(), monitor)
        self._settle_s, self._clock = settle_s, clock
        self._failure: str | None = None
        here, there = socket.socketpair()
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115 - the finalizer closes it
        with there:
            self._process = _start(there, self.monitor.connector, self._stderr)
        self._channel = Channel(here)
        self._closing = weakref.finalize(self, _close, self._process, self._channel, self._stderr)
        self._expect("ready", OPENING_LIMIT_S)

    @property
    def resolution(self) -> tuple[int, int]:
        """(height, width) in projector pixels."""
        return self.monitor.size_px

    def show(self, raster: Raster) -> None:
        """Show a raster; returns when its light is on the scene and settled."""
        check_raster(raster, self.resolution)
        channels = 1 if raster.ndim == 2 else 3
        self._ask(Message("show", str(channels), raster.tobytes()), "shown")
        self._wait(self._settle_s, None)
        self.check()

    def check(self) -> None:
        """Raise `ProjectorError` unless what was shown is still on the projector, unchanged.

        After an exposure it tells whether the frame can be trusted.
        """
        self._ask(Message("check"), "checked")

    def hold(self, duration_s: float | None, stop: threading.Event) -> None:
        """Keep what is shown for a time (None: without end) or until `stop` is set."""
        self._wait(duration_s, stop)

    def close(self) -> None:
        """Go black and take the window away."""
        self._closing()
        self._failure = self._failure or "The projector's window is closed; open it again."

    def _wait(self, duration_s: float | None, stop: threading.Event | None) -> None:
        end_s = None if duration_s is None else self._clock.monotonic() + duration_s
        while stop is None or not stop.is_set():
            remaining_s = LOOK_S if end_s is None else end_s - self._clock.monotonic()
            if remaining_s <= 0:
                return
            self._clock.sleep(min(remaining_s, LOOK_S))
            self._receive(0)

    def _ask(self, message: Message, answer: str) -> None:
        if self._failure is not None:
            raise ProjectorError(self._failure)
        try:
            self._channel.send(message)
        except TimeoutError:
            self._give_up()
        except OSError:
            # Its last message, if any, says why it is gone.
            self._receive(ANSWER_LIMIT_S)
            self._fail("The projector's window does not take pictures any more.")
        self._expect(answer, ANSWER_LIMIT_S)

    def _expect(self, kind: str, limit_s: float) -> None:
        message = self._receive(limit_s)
        if message is None:
            self._give_up()
        elif message.kind != kind:
            self._fail(f"The projector's window answered {message.kind!r} instead of {kind!r}.")

    def _give_up(self) -> NoReturn:
        self._process.kill()
        self._fail(
            "The projector's window did not answer for seconds and was taken away: the graphics "
            "driver hangs or the computer is overloaded. Run the same command again; if it comes "
            "back, restart the desktop session and check the driver with `glxinfo -B`."
        )

    def _receive(self, limit_s: float) -> Message | None:
        try:
            message = self._channel.receive(limit_s)
        except EOFError:
            self._fail(f"The process with the projector's window ended.{self._last_words()}")
        if message is not None and message.kind == "failed":
            self._fail(message.text)
        return message

    def _fail(self, reason: str) -> NoReturn:
        self._failure = reason
        self._closing()
        raise ProjectorError(reason)

    def _last_words(self) -> str:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSING_LIMIT_S)
        self._stderr.seek(0)
        lines = self._stderr.read().decode(errors="replace").strip().splitlines()
        return f" Its last words: {lines[-1]}" if lines else " Did the desktop session end?"


def _start(there: socket.socket, connector: str, stderr: IO[bytes]) -> subprocess.Popen[bytes]:
    path = [str(Path(drivers.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path))}
    environment["PYGLFW_LIBRARY_VARIANT"] = "x11"
    return subprocess.Popen(  # noqa: S603 - this interpreter and a module of this package
        [
            *(sys.executable, "-P", "-m", "drivers.window_process"),
            *(str(there.fileno()), connector),
        ],
        stdin=subprocess.DEVNULL,
        stdout=stderr,
        stderr=stderr,
        pass_fds=[there.fileno()],
        env=environment,
        start_new_session=True,  # Ctrl+C is for the program, which then closes the window
    )


def _close(process: subprocess.Popen[bytes], channel: Channel, stderr: IO[bytes]) -> None:
    with suppress(OSError):
        channel.send(Message("close"))
    channel.close()
    try:
        process.wait(CLOSING_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    stderr.close()
