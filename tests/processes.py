"""Captures in processes of their own, watched through the session folder that they write."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

PATIENCE_S = 120


class Running(Protocol):
    """A process that may have ended."""

    def poll(self) -> int | None:
        """Its exit status, None while it runs."""


def start(*words: str, environment: Mapping[str, str] | None = None) -> subprocess.Popen[str]:
    """Start `lumisplit` with these words; what it says on either stream is its output."""
    return subprocess.Popen(
        [sys.executable, "-m", "acquire", *words],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


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


def finish(process: subprocess.Popen[str]) -> str:
    """Wait for the end; everything it said."""
    output, _ = process.communicate(timeout=PATIENCE_S)
    return output
