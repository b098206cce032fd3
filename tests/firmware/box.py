"""The shutter box's sketch, compiled for this computer."""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SKETCH = HERE.parents[1] / "firmware" / "trigger" / "trigger.ino"
MAIN = '#include "Arduino.h"\n#include "{sketch}"\nint main() {{ setup(); for (;;) loop(); }}\n'
SHUTTER_PIN = 7


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
