"""The other end of a serial line, on a pseudo-terminal, and what can go wrong in between."""

from __future__ import annotations

import os
import select
import threading
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeAlias

Handler: TypeAlias = Callable[[bytes], bytes]
Fault: TypeAlias = Callable[[bytes], bytes]

FAULTS: dict[str, Fault] = {
    "silence": lambda _: b"",
    "half": lambda line: line[: len(line) // 2],
    "half without its start": lambda line: line[len(line) // 2 :],
    "noise": lambda line: bytes(0x80 | byte for byte in line),
    "one bit": lambda line: line[:-3] + bytes([line[-3] ^ 1]) + line[-2:],
    "a byte too many": lambda line: line[:-2] + b"\xff" + line[-2:],
    "endless noise": lambda _: b"\x00U" * 2000,
}
HARMLESS: dict[str, Fault] = {
    "noise before": lambda line: b"\xf0\x9f\x00U" + line,
    "noise after": lambda line: line + b"\x00\xff~",
    "a line of noise before": lambda line: b"\x00\xfe garbage" + line[-1:] + line,
}


@dataclass(slots=True)
class Device:
    """A device that answers each line; its answers can be spoiled on the way.

    Parameters
    ----------
    answer
        Turns a line, without its end, into what is sent back.
    end
        What ends a line that it takes.
    spoiled
        Faults by the number of the answer that they befall, from 0.
    """

    answer: Handler
    end: bytes
    spoiled: Mapping[int, Fault] = field(default_factory=dict)
    heard: list[bytes] = field(default_factory=list)
    port: str = ""

    def serve(self, line: bytes) -> bytes:
        self.heard.append(line)
        reply = self.answer(line)
        fault = self.spoiled.get(len(self.heard) - 1)
        return reply if fault is None else fault(reply)


@contextmanager
def connected(device: Device) -> Iterator[Device]:
    """A device that hangs on a pseudo-terminal, `device.port`, until the block ends."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    device.port = os.ttyname(theirs)
    done = threading.Event()
    thread = threading.Thread(target=_run, args=(device, ours, done))
    thread.start()
    try:
        yield device
    finally:
        done.set()
        thread.join()
        os.close(theirs)
        os.close(ours)


def _run(device: Device, ours: int, done: threading.Event) -> None:
    pending = b""
    while not done.is_set():
        if not select.select([ours], [], [], 0.02)[0]:
            continue
        pending += os.read(ours, 4096)
        *lines, pending = pending.split(device.end)
        for line in lines:
            if line:
                _send(ours, device.serve(line), done)


def _send(ours: int, reply: bytes, done: threading.Event) -> None:
    """Byte by byte, as a slow line delivers; noise in bulk."""
    step = 1 if len(reply) < 100 else len(reply)
    for start in range(0, len(reply), step):
        if not done.is_set():
            os.write(ours, reply[start : start + step])
