"""The desk's end of the line to the page's process: nothing here waits for a browser."""

from __future__ import annotations

import contextlib
import os
import secrets
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from pydantic import ValidationError

import acquire
from acquire.errors import BenchError
from acquire.page.commands import BENCH_COMMAND, BenchCommand
from acquire.page.state import SETTING, SNAPSHOT, Setting, Snapshot
from drivers.window_channel import Channel, Message

LOOPBACK = "127.0.0.1"
CLOSING_LIMIT_S = 2.0
LOOK_S = 0.5
TOKEN_BYTES = 32


class PageLink:
    """Posts snapshots and pictures, and calls a listener with commands, from its own threads.

    What was posted and not yet sent is replaced by the next of its kind, so that neither a slow
    nor a dead page holds the desk up.

    Parameters
    ----------
    address
        What a person opens in a browser.
    channel
        To the page's process.
    gone
        Called once when that process has ended by itself.
    """

    def __init__(self, address: str, channel: Channel, gone: Callable[[], None]) -> None:
        self.address = address
        self._channel, self._gone = channel, gone
        self._listener: Callable[[BenchCommand], None] | None = None
        self._waiting: dict[str, Message] = {}
        self._news = threading.Condition()
        self._closed = False
        self._threads = [
            threading.Thread(target=self._deliver, name="page-out", daemon=True),
            threading.Thread(target=self._hear, name="page-in", daemon=True),
        ]

    def start(self) -> None:
        """Begin to send and to listen."""
        for thread in self._threads:
            thread.start()

    def listen(self, listener: Callable[[BenchCommand], None]) -> None:
        """Call `listener` with every command, from a thread of the link."""
        self._listener = listener

    def post(self, snapshot: Snapshot) -> None:
        """Let the page know; returns at once."""
        self._post(Message("snapshot", SNAPSHOT.dump_json(snapshot).decode()))

    def post_picture(self, media_type: str, data: bytes) -> None:
        """A picture or raw file of the camera while aiming; returns at once."""
        self._post(Message("picture", media_type, data))

    def close(self) -> None:
        """Send what is waiting and end."""
        with self._news:
            self._closed = True
            self._news.notify()
        self._threads[0].join(CLOSING_LIMIT_S)

    def _post(self, message: Message) -> None:
        with self._news:
            if not self._closed:
                self._waiting[message.kind] = message
                self._news.notify()

    def _deliver(self) -> None:
        while True:
            with self._news:
                self._news.wait_for(lambda: self._waiting or self._closed)
                if not self._waiting:
                    return
                message = self._waiting.pop(next(iter(self._waiting)))
            try:
                self._channel.send(message)
            except OSError:
                self._lost()
                return

    def _hear(self) -> None:
        while not self._closed:
            try:
                message = self._channel.receive(LOOK_S)
            except (EOFError, OSError, ValueError):
                self._lost()
                return
            if message is None or message.kind != "command" or self._listener is None:
                continue
            with contextlib.suppress(ValidationError):
                self._listener(BENCH_COMMAND.validate_json(message.text))

    def _lost(self) -> None:
        with self._news:
            already, self._closed = self._closed, True
            self._waiting.clear()
            self._news.notify()
        if not already:
            self._gone()


@contextmanager
def open_page(setting: Setting, port: int, gone: Callable[[], None]) -> Iterator[PageLink]:
    """Serve the page on a port of the loopback interface (0: any) while the context lasts.

    Parameters
    ----------
    setting
        What never changes.
    port
        TCP port.
    gone
        Called once, from another thread, when the page's process has ended by itself.

    Raises
    ------
    BenchError
        The port is taken.
    """
    token = secrets.token_urlsafe(TOKEN_BYTES)
    with _listening(port) as listening, tempfile.TemporaryFile() as stderr:
        address = f"http://{LOOPBACK}:{listening.getsockname()[1]}/{token}/"
        here, there = socket.socketpair()
        with there:
            process = _start(listening, there, stderr)
        channel = Channel(here)
        link = PageLink(address, channel, gone)
        try:
            channel.send(Message("setting", token, SETTING.dump_json(setting)))
            link.start()
            yield link
        finally:
            link.close()
            channel.close()
            _end(process)


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise BenchError(
            f"The page cannot be served on port {port}: {error.strerror}. Choose another --port, "
            "or leave it out."
        ) from error


def _start(
    listening: socket.socket, there: socket.socket, stderr: IO[bytes]
) -> subprocess.Popen[bytes]:
    path = [str(Path(acquire.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    descriptors = (listening.fileno(), there.fileno())
    return subprocess.Popen(  # noqa: S603 - this interpreter and a module of this package
        [sys.executable, "-P", "-m", "acquire.page.process", *map(str, descriptors)],
        stdin=subprocess.DEVNULL,
        stdout=stderr,
        stderr=stderr,
        pass_fds=descriptors,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path))},
        start_new_session=True,  # Ctrl+C is for the program, which then ends the page
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    """The closed channel tells it to end."""
    try:
        process.wait(CLOSING_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
