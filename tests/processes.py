"""Captures in processes of their own, watched through the session folder that they write."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Protocol

PATIENCE_S = 120


class Running(Protocol):
    """A process that may have ended."""

    def poll(self) -> int | None:
        """Its exit status, None while it runs."""


def lines(session: Path) -> int:
    """Number of frames that a session has on the disk."""
    path = session / "frames.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def wait_for_lines(process: Running, session: Path, wanted: int) -> None:
    """Until the session has so many frames, or the process has ended."""
    deadline_s = time.monotonic() + PATIENCE_S
    while lines(session) < wanted and process.poll() is None:
        assert time.monotonic() < deadline_s
        time.sleep(0.002)
