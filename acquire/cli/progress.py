"""How a long job is shown: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Self

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from acquire.plan import Step
from acquire.session.records import Caution

LINE_EVERY_S = 10.0


def tell(caution: Caution, kind: str, *, err: bool = False) -> None:
    """Say what was found, what it means and what to do, a line each."""
    typer.echo(f"{kind}: {caution.what}", err=err)
    typer.echo(f"  means: {caution.meaning}", err=err)
    typer.echo(f"  do: {caution.remedy}", err=err)


class ProgressDisplay:
    """Shows stages of a job on standard error; speaks both observers' languages.

    On a terminal a bar with the time left. Elsewhere a line at the start and the end of each
    stage and every ten seconds between. With `quiet` only warnings; with `verbose` a line for
    every unit, and its time.
    """

    def __init__(self, *, quiet: bool = False, verbose: bool = False) -> None:
        self._verbose = verbose
        self._console = Console(stderr=True)
        self._live = self._console.is_terminal and not quiet
        self._quiet = quiet
        self._bar = Progress(
            TextColumn("{task.description:<12}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self._console,
            disable=not self._live,
        )
        self._task: TaskID | None = None
        self._name, self._total, self._done = "", 0, 0
        self._first: tuple[int, float] | None = None
        self._began_s = self._spoke_s = self._unit_s = time.monotonic()

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def stage(self, name: str, total: int, done: int = 0) -> None:
        """A stage of `total` units begins, of which `done` are done already."""
        self._name, self._total, self._done = name, total, done
        self._began_s = self._unit_s = time.monotonic()
        self._first = None
        self._task = self._bar.add_task(name, total=total, completed=done)
        self._line(f"{name}: {total - done} to do")

    def advance(self, what: str = "") -> None:
        """One unit of the stage is done; with --verbose its time and `what` are said."""
        self._done += 1
        self._time_unit(what)
        if self._task is not None:
            self._bar.advance(self._task)
        now = time.monotonic()
        if self._done == self._total:
            self._line(f"{self._name}: done in {now - self._began_s:.1f} s")
        elif now - self._spoke_s > LINE_EVERY_S:
            self._line(f"{self._name}: {self._done} of {self._total}{self._left(now)}")
        if self._first is None:
            self._first = self._done, now

    def _left(self, now_s: float) -> str:
        """Time left at the pace since the first unit, which may have had to compile loops."""
        if self._first is None:
            return ""
        units, since_s = self._first
        left_s = (now_s - since_s) / (self._done - units) * (self._total - self._done)
        return f", about {left_s:.0f} s left"

    def frame_kept(self, step: Step, total: int) -> None:  # noqa: ARG002 - see sequencer.Observer
        """A frame of a capture is on the disk."""
        self.advance(f", {step.pattern}")

    def warning(self, message: str) -> None:
        """Something a person should know; the job goes on."""
        self._console.print(f"warning: {message}", markup=False, highlight=False, soft_wrap=True)

    def _time_unit(self, what: str) -> None:
        now_s = time.monotonic()
        if self._verbose:
            took = f"{now_s - self._unit_s:.3f} s"
            self.say(f"{self._name}: {self._done} of {self._total}, {took}{what}")
        self._unit_s = now_s

    def say(self, message: str) -> None:
        """A line of news, unless quiet."""
        if not self._quiet:
            self._console.print(message, markup=False, highlight=False, soft_wrap=True)

    def _line(self, text: str) -> None:
        if self._live or self._quiet:
            return
        self._spoke_s = time.monotonic()
        print(text, file=sys.stderr, flush=True)  # noqa: T201 - the terminal is the product here
