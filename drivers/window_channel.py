"""Messages between the program and the process that holds its window.

A message is a line of JSON, an object whose key ``size`` tells how many bytes follow it.
"""

from __future__ import annotations

import json
import select
import socket
import threading
import time
from dataclasses import dataclass
from typing import Any

SEND_LIMIT_S = 3.0
_PIECE_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Message:
    """What it is (its `kind`), its text and its bytes."""

    kind: str
    text: str = ""
    data: bytes = b""


class Channel:
    """One end; sending is safe from several threads, receiving is for one."""

    def __init__(self, connection: socket.socket) -> None:
        connection.settimeout(SEND_LIMIT_S)
        self._connection = connection
        self._received = bytearray()
        self._sending = threading.Lock()

    def fileno(self) -> int:
        """Descriptor that becomes readable when there is something to receive."""
        return self._connection.fileno()

    def close(self) -> None:
        """Close this end."""
        self._connection.close()

    def send(self, message: Message) -> None:
        """Send a message; TimeoutError when it is not taken, OSError when the other end is gone."""
        head = {"kind": message.kind, "text": message.text, "size": len(message.data)}
        with self._sending:
            self._connection.sendall(json.dumps(head).encode() + b"\n" + message.data)

    def receive(self, limit_s: float) -> Message | None:
        """The next message; None when it is not complete within `limit_s` seconds.

        Raises
        ------
        EOFError
            The other end is gone.
        """
        deadline_s = time.monotonic() + limit_s
        while (message := self._complete()) is None:
            remaining_s = max(deadline_s - time.monotonic(), 0)
            if not select.select([self._connection], [], [], remaining_s)[0]:
                return None
            try:
                piece = self._connection.recv(_PIECE_BYTES)
            except OSError as error:
                raise EOFError from error
            if not piece:
                raise EOFError
            self._received += piece
        return message

    def _complete(self) -> Message | None:
        end = self._received.find(b"\n")
        if end < 0:
            return None
        head: dict[str, Any] = json.loads(self._received[:end])
        stop = end + 1 + head["size"]
        if len(self._received) < stop:
            return None
        message = Message(head["kind"], head["text"], bytes(self._received[end + 1 : stop]))
        del self._received[:stop]
        return message
