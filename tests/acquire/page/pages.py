"""A page with a desk behind it that only writes down what it is told."""

from __future__ import annotations

import json
import queue
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from acquire.page.commands import BenchCommand
from acquire.page.desk import Desk
from acquire.page.link import PageLink, open_page
from acquire.page.state import Setting
from tests.acquire.captures import small_plan

PATIENCE_S = 60.0


@dataclass
class Served:
    """A page that is served, and what came of it."""

    link: PageLink
    desk: Desk
    commands: queue.Queue[BenchCommand] = field(default_factory=queue.Queue)
    warnings: list[str] = field(default_factory=list)

    @property
    def host(self) -> str:
        return urlsplit(self.link.address).netloc

    @property
    def port(self) -> int:
        return int(self.host.partition(":")[2])

    @property
    def token(self) -> str:
        return urlsplit(self.link.address).path.strip("/")

    def viewer(self, **changes: str | None) -> Client:
        """A viewer whose socket is as a browser's, but for `changes` of host, origin and path."""
        wanted = {"host": self.host, "origin": f"http://{self.host}"} | changes
        path = changes.get("path") or f"/{self.token}/socket"
        return Client(
            f"ws://{wanted['host']}{path}",
            wanted["origin"],
            socket.create_connection(("127.0.0.1", self.port), PATIENCE_S),
        )


class Client:
    """One viewer without a browser."""

    def __init__(
        self, address: str, origin: str | None, through: socket.socket | None = None
    ) -> None:
        self._opening = connect(
            address,
            sock=through,
            origin=None if origin is None else Origin(origin),
            open_timeout=PATIENCE_S,
            max_size=None,
            max_queue=None,  # or a viewer with much unread does not read that it was let go
            proxy=None,
        )
        try:
            self.connection: ClientConnection = self._opening.__enter__()
        except BaseException:
            if through is not None:
                through.close()
            raise
        self.pictures: list[tuple[dict[str, Any], list[bytes]]] = []
        self.state = self.told()

    def told(self, kind: str = "state") -> dict[str, Any]:
        """The next message of a kind; pictures are put aside."""
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            message = self.connection.recv(deadline_s - time.monotonic())
            head, files = (
                unpacked(message) if isinstance(message, bytes) else (json.loads(message), [])
            )
            if files:
                self.pictures.append((head, files))
            if head["kind"] == kind:
                if kind == "state":
                    self.state = head
                return head

    def until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Wait until the state is as wanted; pictures are asked for meanwhile."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition(self.state):
            assert time.monotonic() < deadline_s, self.state
            self.told()
            if self.pictures and self.pictures[-1][0]["kind"] == "picture":
                self.ask(do="ready")
        return self.state

    def does(self, activity: str) -> dict[str, Any]:
        return self.until(lambda state: state["activity"] == activity)

    def shows(self, what: str) -> dict[str, Any]:
        return self.until(lambda state: (state["shown"] or {"what": ""})["what"] == what)

    def has_done(self, frames: int) -> dict[str, Any]:
        return self.until(lambda state: (state["progress"] or {"done": 0})["done"] >= frames)

    def is_told(self, note: str) -> dict[str, Any]:
        return self.until(lambda state: any(note in one["text"] for one in state["notes"]))

    def ask(self, **command: object) -> None:
        self.connection.send(json.dumps(command))

    def close(self) -> None:
        self._opening.__exit__(None, None, None)


def unpacked(message: bytes) -> tuple[dict[str, Any], list[bytes]]:
    (length,) = struct.unpack_from("<I", message)
    head = json.loads(message[4 : 4 + length])
    files, at = [], 4 + length
    for size in head["sizes"]:
        files.append(message[at : at + size])
        at += size
    assert at == len(message)
    return head, files


@contextmanager
def served(session: Path | None = None) -> Iterator[Served]:
    setting = Setting(
        bench="a bench",
        projector_px=(48, 64),
        frame_bytes=3000,
        plan=small_plan(),
        can_aim=True,
        can_start=True,
        version="0",
    )
    warnings: list[str] = []
    with open_page(setting, 0, warnings.append) as link:
        page = Served(link, Desk(link, lambda _: None, session), warnings=warnings)
        page.desk.listen(page.commands.put)
        yield page
