"""One visit to the virtual machine, booted once for all that is asked about it.

Not a `conftest`: pytest inside the machine would load it, and what it imports.
"""

from __future__ import annotations

import json
import os
import random
import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from acquire.plan_file import parse_plan
from tests.guest import machine
from tests.guest.inside.reporting import REPORTS
from tests.guest.rendering import render

TIMEOUT_S = 600.0  # of a hung machine; a busy host is slow
OBJECT_BYTES = 3_000_000
PLAN = """[pattern]
pitch_px = [8]
shifts = [2, 2]
[camera]
exposure_s = 0.02
aperture = 8.0
iso = 200
[projector]
settle_s = 0.0
"""
# An emulated processor takes 20 s to import hypothesis, and longer to compile than its small
# frames take uncompiled.
QUICKLY = ("PYTEST_DISABLE_PLUGIN_AUTOLOAD=1", "PYTHONUNBUFFERED=1", "NUMBA_DISABLE_JIT=1")


@dataclass(frozen=True, slots=True)
class Visit:
    """What happened in the machine: its folder, how it ended, and every check's reports."""

    folder: Path
    status: int | None
    log: str
    reports: Mapping[str, Sequence[Mapping[str, Any]]]


def visit_once(tmp_path_factory: pytest.TempPathFactory) -> Visit:
    """Boot and let every check run there; the first of several workers does it for all."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent
    folder = root / "guest"
    ended = root / "guest-ended.json"
    with FileLock(root / "guest.lock"):
        if not ended.exists():
            outcome = _boot(folder)
            ended.write_text(json.dumps([outcome.status, outcome.log]))
    status, log = json.loads(ended.read_text())
    reports = defaultdict(list)
    file = folder / REPORTS
    for line in file.read_text().splitlines() if file.exists() else ():
        report = json.loads(line)
        reports[report["check"].partition("[")[0]].append(report)
    return Visit(folder, status, log, reports)


def _boot(folder: Path) -> machine.Outcome:
    try:
        parts = machine.find_parts()
    except machine.PartsMissingError as error:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip(str(error))
    served = folder / "mtp" / "object.bin"
    served.parent.mkdir(parents=True)
    served.write_bytes(random.Random(0).randbytes(OBJECT_BYTES))
    (folder / "sessions").mkdir()
    (folder / "plan.toml").write_text(PLAN)
    render(parse_plan(PLAN, "the plan of the machine's sessions"), folder / "scene")
    devices = ["-device", "qemu-xhci", "-device", f"usb-mtp,rootdir={served.parent}"]
    command = ["env", *QUICKLY, sys.executable, "-m", "pytest", "-o", "addopts=", "--durations=20"]
    command += ["-p", "no:cacheprovider", "-p", "tests.guest.inside.reporting"]
    inside = Path(__file__).parent / "inside"
    command += [os.path.relpath(path) for path in sorted(inside.glob("*_checks.py"))]
    return machine.run(parts, command, folder, TIMEOUT_S, devices)
