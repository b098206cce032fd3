"""The process that holds the projector's window; `drivers.window` starts it and speaks to it.

A process of its own, because the window must outlive whatever happens to the program: when the
program ends, in whatever way, its socket closes, and this process shows black, gives back what it
changed and ends. And what befalls the window, a graphics driver that hangs or an X server that
goes, does not take the frame in flight with it.

The main thread draws. Another listens to the program and watches the monitor, over an X
connection of its own, so that it can take the picture down and say so even while the driver hangs.

It takes the messages ``show`` (text: channels; data: the raster), ``check`` and ``close``, and
sends ``ready``, ``shown``, ``checked`` and, as the last, ``failed`` (text: why).
"""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from queue import SimpleQueue

from drivers.canvas import Canvas
from drivers.errors import ProjectorError
from drivers.monitors import Monitor, choose_monitor
from drivers.window_channel import Channel, Message
from drivers.xserver import XServer, linear

WATCH_S = 0.2  # how often to look without having been told to
STIR_S = 10.0
MAX_LIFTS = 5
LIFTS_WITHIN_S = 5.0
HANG_S = 1.0  # how long the drawing thread may take to end


class Watch(threading.Thread):
    """Listens to the program and watches the monitor (see the module).

    Parameters
    ----------
    channel
        To the program.
    server
        Its own connection to the X server.
    monitor
        The monitor as it must stay.
    canvas
        What is on it.
    """

    def __init__(self, channel: Channel, server: XServer, monitor: Monitor, canvas: Canvas) -> None:
        super().__init__(name="watch", daemon=True)
        self._channel, self._server, self._canvas = channel, server, canvas
        self._monitor = monitor
        self._found_ramp = server.gamma_ramp(monitor.connector)
        self._linear_ramp = linear(self._found_ramp)
        server.set_gamma_ramp(monitor.connector, self._linear_ramp)
        server.stay_awake()
        self._covered = False
        self._lifted_s: list[float] = []
        self._stirred_s = -STIR_S
        self.rasters: SimpleQueue[Message] = SimpleQueue()
        self.ending = threading.Event()
        self.drawn = threading.Event()  # the drawing thread has left the screen black

    def run(self) -> None:
        """Go on until the program closes or leaves, or the monitor changes."""
        sources: list[Channel | XServer] = [self._channel, self._server]
        try:
            while not self.ending.is_set():
                select.select(sources, [], [], WATCH_S)
                self._examine()
                while (message := self._channel.receive(0)) is not None:
                    self._obey(message)
        except (EOFError, OSError):
            pass  # the program has gone, or closed
        except ProjectorError as error:
            self.fail(str(error))
        finally:
            self._finish()

    def fail(self, reason: str) -> None:
        """Take the picture down, at once, and tell the program why."""
        with suppress(ProjectorError):
            self._server.take_down(self._canvas.handle)
        if not self.ending.is_set():
            self.ending.set()
            with suppress(OSError):
                self._channel.send(Message("failed", reason))

    def _obey(self, message: Message) -> None:
        if message.kind == "show":
            self.rasters.put(message)
            self._canvas.wake()
        elif message.kind == "check":
            self._examine()
            self._channel.send(Message("checked"))
        else:
            raise EOFError

    def _examine(self) -> None:
        now_s = time.monotonic()
        if now_s - self._stirred_s >= STIR_S:
            self._server.stir()
            self._stirred_s = now_s
        self._stay_on_top(now_s)
        self._examine_monitor()
        if self._server.gamma_ramp(self._monitor.connector) != self._linear_ramp:
            raise ProjectorError(
                f"Another program changed the colours of {self._monitor.connector} while a "
                "picture was shown: night light, redshift or a colour profile. Turn it off and "
                "run the same command again; in GNOME: `gsettings set "
                "org.gnome.settings-daemon.plugins.color night-light-enabled false`."
            )

    def _stay_on_top(self, now_s: float) -> None:
        self._covered = self._server.covered(self._covered)
        if not self._covered:
            return
        self._lifted_s = [time_s for time_s in self._lifted_s if now_s - time_s < LIFTS_WITHIN_S]
        self._lifted_s.append(now_s)
        if len(self._lifted_s) > MAX_LIFTS:
            raise ProjectorError(
                f"Another window keeps covering the picture on {self._monitor.connector}. Close "
                "it: a presentation, a video, or a panel that is always on top."
            )
        self._server.lift(self._canvas.handle)

    def _examine_monitor(self) -> None:
        opened = self._monitor
        monitors = self._server.monitors(probe=False)
        current = next((m for m in monitors if m.connector == opened.connector), None)
        if current is None:
            raise ProjectorError(
                f"The projector ({opened}) is gone: its cable was pulled, it was switched off, or "
                "its output was turned off. The picture was taken down. Plug it in, wait for its "
                "picture and run the same command again."
            )
        if replace(current, primary=opened.primary, name=opened.name) != opened:
            raise ProjectorError(
                f"The projector changed from {opened.geometry} to {current.geometry} while a "
                "picture was shown. The picture was taken down. Set the mode that the plan was "
                f"made for (`xrandr --output {opened.connector} --mode …`) and run the same "
                "command again."
            )
        choose_monitor(monitors, opened.connector)

    def _finish(self) -> None:
        self.ending.set()
        self._canvas.wake()
        if not self.drawn.wait(HANG_S):
            with suppress(ProjectorError):
                self._server.take_down(self._canvas.handle)
            self.restore()
            os._exit(1)

    def restore(self) -> None:
        """Give the monitor's gamma ramps back."""
        with suppress(ProjectorError):
            self._server.set_gamma_ramp(self._monitor.connector, self._found_ramp)


def hold_window(channel: Channel, connector: str) -> None:
    """Keep a window on a monitor until the program closes or leaves, or the monitor changes."""
    server = XServer()
    monitor = choose_monitor(server.monitors(probe=False), connector)
    canvas = Canvas(monitor, server)
    watch = Watch(channel, server, monitor, canvas)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: watch.ending.set())
    channel.send(Message("ready"))
    watch.start()
    try:
        while not watch.ending.is_set():
            canvas.wait(WATCH_S)
            while not watch.rasters.empty():
                raster = watch.rasters.get()
                canvas.show(raster.data, int(raster.text))
                channel.send(Message("shown"))
    except ProjectorError as error:
        watch.fail(str(error))
    finally:
        with suppress(ProjectorError):
            canvas.black()
        watch.restore()
        canvas.close()
        watch.drawn.set()
        watch.join(HANG_S)


def main() -> None:
    """Serve the socket whose descriptor is the first argument, on the monitor of the second."""
    channel = Channel(socket.socket(fileno=int(sys.argv[1])))
    with suppress(OSError):
        try:
            hold_window(channel, sys.argv[2])
        except ProjectorError as error:
            channel.send(Message("failed", str(error)))


if __name__ == "__main__":
    main()
