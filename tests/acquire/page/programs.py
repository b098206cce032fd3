"""``lumisplit`` running with a page, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.acquire.page.pages import PATIENCE_S, Client
from tests.processes import lines

needs_proc = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's /proc")
HOME = Path(__file__).parents[3]


class Program:
    """A running command that serves a page; plan and bench are written into its folder first.

    `words` are the command without plan, session and bench, which are ``plan.toml``, ``s`` and
    ``bench.toml``.
    """

    def __init__(
        self,
        folder: Path,
        plan: str,
        bench: str,
        *words: str,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        (folder / "plan.toml").write_text(plan)
        (folder / "bench.toml").write_text(bench)
        self.session = folder / "s"
        command = [*words[:1], "plan.toml", "--out", "s", "--bench", "bench.toml", *words[1:]]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "acquire", *command],
            cwd=folder,
            env={**(environment or os.environ), "PYTHONPATH": str(HOME)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert self.process.stdout is not None
        line = next(line for line in self.process.stdout if line.startswith("page: "))
        self.address = line.split()[-1]

    def viewer(self) -> Client:
        """One more viewer."""
        parts = urlsplit(self.address)
        return Client(f"ws://{parts.netloc}{parts.path}socket", f"http://{parts.netloc}")

    @property
    def frames(self) -> int:
        """On the disk."""
        return lines(self.session)

    def until_frames(self, count: int) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while self.frames < count:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)

    def end(self, number: int | None = None) -> str:
        """Wait for its end, after a signal where one is given; everything it said."""
        if number is not None:
            self.process.send_signal(number)
        output, _ = self.process.communicate(timeout=PATIENCE_S)
        assert "Traceback" not in output
        return output

    def kill(self) -> None:
        """Whatever it does."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()


def children(pid: int) -> list[int]:
    """Processes that a process has started, from Linux's /proc."""
    return [
        int(child)
        for path in Path(f"/proc/{pid}/task").glob("*/children")
        for child in _text(path).split()
    ]


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:  # the thread has ended
        return ""


def descendants(pid: int) -> set[int]:
    """Those processes, theirs, and so on; none where there is no /proc."""
    own = children(pid)
    return set(own).union(*(descendants(child) for child in own))
