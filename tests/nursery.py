"""Processes of `lumisplit` that need not import everything anew: forked from one that has.

A child is a process like any other, with its own memory, files and signals; only the second or
more of imports and compiled code is shared. Run as a program, this module is the parent: it reads
a line of JSON for each child on its standard input, and writes lines of JSON: the number of each
child that it made, and of each that ended how it did.
"""

from __future__ import annotations

import json
import os
import selectors
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import IO, Any

POLL_S = 0.005
PATIENCE_S = 120.0
BIRTH_S = 1800.0  # the first waits until the parent has exercised
APART = ("unshare", "--user", "--map-root-user", "--mount")


class Child:
    """A `lumisplit` with some words; what it says on either stream goes to one file."""

    def __init__(self, pid: int, output: Path, ended: Callable[[], int | None]) -> None:
        self.pid, self._output, self._ended = pid, output, ended

    @property
    def returncode(self) -> int | None:
        """As of `subprocess.Popen`: negative for a signal, None while it runs."""
        return self._ended()

    def poll(self) -> int | None:
        """The same."""
        return self._ended()

    def send_signal(self, number: int) -> None:
        """Send a signal unless it has ended."""
        if self._ended() is None:
            os.kill(self.pid, number)

    @property
    def output(self) -> str:
        """Everything it has said so far."""
        return self._output.read_text(errors="replace")

    def finish(self, patience_s: float = PATIENCE_S) -> str:
        """Wait for the end; everything it said."""
        deadline_s = time.monotonic() + patience_s
        while self._ended() is None:
            if time.monotonic() > deadline_s:
                os.kill(self.pid, signal.SIGKILL)
                raise TimeoutError(self.output)
            time.sleep(POLL_S)
        return self.output


def can_mount() -> bool:
    """Whether this system lets a user make file systems of its own."""
    if shutil.which(APART[0]) is None:
        return False
    trial = [*APART, "mount", "-t", "tmpfs", "tmpfs", "/proc/fs"]
    return subprocess.run(trial, check=False, capture_output=True).returncode == 0


class Nursery:
    """The parent.

    Parameters
    ----------
    folder
        For what the children say.
    exercise
        Words for `lumisplit` that the parent itself carries out first: what that computes and
        keeps in memory, the children have.
    can_mount
        Whether the parent and its children have file systems of their own, which nobody else
        sees, and may mount small or read-only ones (Linux). `seen` is where we see them.
    """

    def __init__(self, folder: Path, *exercise: str, can_mount: bool = False) -> None:
        self._folder = folder
        self._count = 0
        self._results: dict[int, int] = {}
        self._born: list[int] = []
        self._news = threading.Condition()
        self._parent = subprocess.Popen(
            [*(APART if can_mount else ()), sys.executable, "-m", "tests.nursery", *exercise],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            # Threads of BLAS do not survive a fork.
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def start(
        self,
        *words: str,
        program: str = "lumisplit",
        environment: Mapping[str, str] | None = None,
    ) -> Child:
        """Start `lumisplit`, or another program, with these words, in this or our environment."""
        self._count += 1
        output = self._folder / f"output-{self._count}"
        request = {
            "program": program,
            "words": words,
            "output": str(output),
            "environment": dict(os.environ if environment is None else environment),
        }
        stdin = self._parent.stdin
        assert stdin is not None
        stdin.write(json.dumps(request) + "\n")
        stdin.flush()
        with self._news:
            assert self._news.wait_for(lambda: len(self._born) >= self._count, BIRTH_S)
            pid = self._born[self._count - 1]
        return Child(pid, output, lambda: self._results.get(pid))

    def run(self, *words: str, program: str = "lumisplit", patience_s: float = PATIENCE_S) -> Child:
        """The same, to its end."""
        child = self.start(*words, program=program)
        child.finish(patience_s)
        return child

    def seen(self, path: Path) -> Path:
        """Where we see a file of the children."""
        return Path(f"/proc/{self._parent.pid}/root{path}")

    def close(self) -> None:
        """End the parent."""
        assert self._parent.stdin is not None
        self._parent.stdin.close()
        self._listener.join()
        assert self._parent.stdout is not None
        self._parent.stdout.close()
        self._parent.wait()

    def _listen(self) -> None:
        assert self._parent.stdout is not None
        for line in self._parent.stdout:
            said: dict[str, int] = json.loads(line)
            with self._news:
                if "born" in said:
                    self._born.append(said["born"])
                else:
                    self._results[said["died"]] = said["returncode"]
                self._news.notify_all()


def _be_child(request: dict[str, Any]) -> None:
    from acquire.cli.main import main

    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    null = os.open(os.devnull, os.O_RDONLY)
    output = os.open(request["output"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    for source, target in [(null, 0), (output, 1), (output, 2)]:
        os.dup2(source, target)
    os.environ.clear()
    os.environ.update(request["environment"])
    sys.argv = [request["program"], *request["words"]]
    if request["program"] != "lumisplit":
        os.execvp(sys.argv[0], sys.argv)  # noqa: S606 - the tests' own words
    status = 0
    try:
        main()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 1
    except BaseException:  # noqa: BLE001 - the child ends here
        import traceback

        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _say(stream: IO[str], **said: int) -> None:
    stream.write(json.dumps(said) + "\n")
    stream.flush()


def _bury(stream: IO[str]) -> None:
    while True:
        try:
            pid, status = os.waitpid(-1, os.WNOHANG)
        except ChildProcessError:
            return
        if not pid:
            return
        _say(stream, died=pid, returncode=os.waitstatus_to_exitcode(status))


def _main() -> None:
    import acquire.pipeline
    import acquire.recording  # noqa: F401
    from acquire.cli.main import main

    if sys.argv[1:]:
        with suppress(SystemExit), redirect_stdout(sys.stderr):
            main()
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    signal.set_wakeup_fd(writer)
    signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
    selector = selectors.DefaultSelector()
    selector.register(sys.stdin, selectors.EVENT_READ)
    selector.register(reader, selectors.EVENT_READ)
    while True:
        for key, _ in selector.select():
            if key.fd == reader:
                os.read(reader, 4096)
                _bury(sys.stdout)
                continue
            line = sys.stdin.readline()
            if not line:
                return
            pid = os.fork()
            if pid == 0:
                _be_child(json.loads(line))
            _say(sys.stdout, born=pid)


if __name__ == "__main__":
    _main()
