"""The shutter box's sketch, compiled for this computer."""

from __future__ import annotations

import os
import select
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SKETCH = HERE.parents[1] / "firmware" / "trigger" / "trigger.ino"
MAIN = '#include "Arduino.h"\n#include "{sketch}"\nint main() {{ setup(); for (;;) loop(); }}\n'
SHUTTER_PIN = 7
RELAY_S = 0.12  # more than a short pulse takes
PATIENCE_S = 0.6  # more than that, with other tests beside it


def compile_sketch(folder: Path) -> Path:
    """The sketch as a program; skips, or fails in CI, where there is no compiler."""
    compiler = shutil.which("g++")
    if compiler is None and os.environ.get("CI") == "true":
        pytest.fail("CI must have g++ to run the firmware")
    if compiler is None:
        pytest.skip("no g++ on this machine to run the firmware")
    source, program = folder / "main.cpp", folder / "box"
    source.write_text(MAIN.format(sketch=SKETCH))
    subprocess.run(
        [compiler, "-Wall", "-Wextra", "-Werror", "-O1", "-I", HERE, source, "-o", program],
        check=True,
    )
    return program


@contextmanager
def behind_a_line(
    sketch: Path, log: Path, spoiled: Mapping[int, Callable[[bytes], bytes]] | None = None
) -> Iterator[Callable[[bytes], bytes]]:
    """The running sketch as a function from a line, without its end, to what it answers.

    Parameters
    ----------
    sketch
        The compiled sketch.
    log
        File that takes what happens at its pins.
    spoiled
        What befalls requests on their way, by their number, from 0.
    """
    numbers = count()
    with (
        log.open("w") as errors,
        subprocess.Popen(
            [sketch], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, bufsize=0
        ) as box,
    ):
        assert box.stdin is not None
        assert box.stdout is not None
        requests, answers = box.stdin, box.stdout

        def relay(line: bytes) -> bytes:
            fault = (spoiled or {}).get(next(numbers))
            requests.write(line + b"\n" if fault is None else fault(line + b"\n"))
            answer = b""
            while not answer.endswith(b"\n") and select.select([answers], [], [], RELAY_S)[0]:
                answer += answers.read(4096) or b""
            return answer

        yield relay
        box.kill()


@dataclass(frozen=True, slots=True)
class Exposure:
    """When the shutter's contact closed and opened, in milliseconds."""

    closed_ms: int
    opened_ms: int


def exposures(log: Path) -> list[Exposure]:
    """The exposures that the box made, by what it wrote on standard error."""
    changes = [tuple(map(int, line.split())) for line in log.read_text().splitlines()]
    shutter = [(level, time_ms) for pin, level, time_ms in changes if pin == SHUTTER_PIN][1:]
    assert [level for level, _ in shutter] == [1, 0] * (len(shutter) // 2)
    times_ms = [time_ms for _, time_ms in shutter]
    return [Exposure(*pair) for pair in zip(times_ms[::2], times_ms[1::2], strict=True)]
