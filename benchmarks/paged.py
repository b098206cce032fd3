"""A program with a page at the simulated bench, at its real pace, for a picture and for timing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

HOME = Path(__file__).parents[1]
# Settling 0.1 s, exposure 0.1 s, delivery 0.05 s, and whatever computing adds.
BENCH = """kind = "sim"
[sim]
camera_px = [192, 256]
full_well_e = 20000
read_noise_e = 5
real_time = true
"""


def start(
    folder: Path, plan: str, command: str, *options: str, has_page: bool = True
) -> tuple[subprocess.Popen[str], str]:
    """Start a command on a plan, its session in ``s`` of a folder; the address of its page."""
    (folder / "plan.toml").write_text(plan)
    (folder / "bench.toml").write_text(BENCH)
    words = [command, "plan.toml", "--out", "s", "--bench", "bench.toml", *options]
    process = subprocess.Popen(  # noqa: S603 - this interpreter and this project
        [sys.executable, "-m", "acquire", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(HOME)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    return process, process.stdout.readline().split()[-1] if has_page else ""
