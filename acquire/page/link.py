"""The desk's end of the line to the page's process: nothing here waits for a browser."""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import ValidationError

import acquire
from acquire.errors import BenchError
from acquire.page.commands import BENCH_COMMAND, BenchCommand
from acquire.page.state import SETTING, SNAPSHOT, Setting, Snapshot
from drivers.window_channel import Channel, Message

LOOPBACK = "127.0.0.1"
CLOSING_LIMIT_S = 5.0
LOOK_S = 0.5
TOKEN_BYTES = 32
MAX_STARTS = 5
PATIENCE_S = 60.0  # the page goes last on a computer that has too much to do


class PageLink:
    """Posts snapshots and pictures, and calls a listener with commands, from its own threads.

    What was posted and not yet sent is replaced by the next of its kind, so that neither a slow
    nor a dead page holds the desk up. A page whose process has ended by itself is started again,
    some times, at the same address.

    Parameters
    ----------
    address
        What a person opens in a browser.
    start
        Starts the page's process; the channel to it.
    warn
        Told when that process has ended by itself.
    """

    def __init__(
        self, address: str, start: Callable[[], Channel], warn: Callable[[str], None]
    ) -> None:
        self.address = address
        self._start, self._warn = start, warn
        self._channel: Channel | None = start()
        self._starts = 1
        self._listener: Callable[[BenchCommand], None] | None = None
        self._snapshot: Message | None = None
        self._waiting: dict[str, Message] = {}
        self._news = threading.Condition()
        self._closed = False
        self._threads = [
            threading.Thread(target=self._deliver, name="page-out", daemon=True),
            threading.Thread(target=self._hear, name="page-in", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def listen(self, listener: Callable[[BenchCommand], None]) -> None:
        """Call `listener` with every command, from a thread of the link."""
        self._listener = listener

    def post(self, snapshot: Snapshot) -> None:
        """Let the page know; returns at once."""
        self._snapshot = Message("snapshot", SNAPSHOT.dump_json(snapshot).decode())
        self._post(self._snapshot)

    def post_picture(self, media_type: str, data: bytes) -> None:
        """A picture or raw file of the camera while aiming; returns at once."""
        self._post(Message("picture", media_type, data))

    def close(self) -> None:
        """Send what is waiting and end."""
        with self._news:
            self._closed = True
            self._news.notify_all()
        self._threads[0].join(CLOSING_LIMIT_S)
        if self._channel is not None:
            self._channel.close()

    def _post(self, message: Message) -> None:
        with self._news:
            if not self._closed:
                self._waiting[message.kind] = message
                self._news.notify_all()

    def _deliver(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._closed or (self._waiting and self._channel))
                channel = self._channel
                if channel is None or not self._waiting:
                    return
                message = self._waiting.pop(next(iter(self._waiting)))
            try:
                channel.send(message)
            except OSError:
                self._lose(channel)

    def _hear(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._closed or self._channel)
                channel = self._channel
            if self._closed or channel is None:
                return
            try:
                message = channel.receive(LOOK_S)
            except (EOFError, OSError, ValueError):
                self._lose(channel)
                continue
            if message is None or message.kind != "command" or self._listener is None:
                continue
            with contextlib.suppress(ValidationError):
                self._listener(BENCH_COMMAND.validate_json(message.text))

    def _lose(self, channel: Channel) -> None:
        """The other end is gone: start it again, but not for ever."""
        with self._news:
            if self._closed or channel is not self._channel:
                return
            self._channel = None
        channel.close()
        again = self._starts < MAX_STARTS
        self._warn(
            "the page at the bench ended by itself and is started again at the same address"
            if again
            else "the page at the bench has ended; the work goes on without it"
        )
        started = self._start() if again else None
        with self._news:
            self._starts += 1
            self._channel, self._closed = started, self._closed or not again
            self._waiting.clear()
            if self._snapshot is not None:
                self._waiting[self._snapshot.kind] = self._snapshot
            self._news.notify_all()


class _Server:
    """Starts the page's process on a socket that listens already; one at a time."""

    def __init__(self, listening: socket.socket, token: str, setting: Setting) -> None:
        self._listening, self._token = listening, token
        self._setting = SETTING.dump_json(setting)
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> Channel:
        """Start it, after the one before has ended, and tell it what never changes."""
        self.end()
        here, there = socket.socketpair()
        with there:
            self._process = _start(self._listening, there)
        channel = Channel(here)
        here.settimeout(PATIENCE_S)
        with contextlib.suppress(OSError):  # it ended already; the link will notice
            channel.send(Message("setting", self._token, self._setting))
        return channel

    def end(self) -> None:
        """Its closed channel tells it to end."""
        if self._process is None:
            return
        try:
            self._process.wait(CLOSING_LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


@contextmanager
def open_page(setting: Setting, port: int, warn: Callable[[str], None]) -> Iterator[PageLink]:
    """Serve the page on a port of the loopback interface (0: any) while the context lasts.

    Parameters
    ----------
    setting
        What never changes.
    port
        TCP port.
    warn
        Told, from another thread, when the page's process has ended by itself.

    Raises
    ------
    BenchError
        The port is taken.
    """
    token = secrets.token_urlsafe(TOKEN_BYTES)
    with _listening(port) as listening:
        address = f"http://{LOOPBACK}:{listening.getsockname()[1]}/{token}/"
        server = _Server(listening, token, setting)
        link = PageLink(address, server.start, warn)
        try:
            yield link
        finally:
            link.close()
            server.end()


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise BenchError(
            f"The page cannot be served on port {port}: {error.strerror}. Choose another --port, "
            "or leave it out."
        ) from error


def _start(listening: socket.socket, there: socket.socket) -> subprocess.Popen[bytes]:
    path = [str(Path(acquire.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    descriptors = (listening.fileno(), there.fileno())
    return subprocess.Popen(  # noqa: S603 - this interpreter and a module of this package
        [sys.executable, "-P", "-m", "acquire.page.process", *map(str, descriptors)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        pass_fds=descriptors,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path))},
        start_new_session=True,  # Ctrl+C is for the program, which then ends the page
    )
