"""A pytest plugin that tells the host, line by line, how each check in the machine ended."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

EXCHANGE = Path("/mnt")
REPORTS = "reports.jsonl"


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    line = {
        "check": report.nodeid.rpartition("/")[2],
        "when": report.when,
        "outcome": report.outcome,
        "duration_s": report.duration,
        "text": report.longreprtext,
    }
    with (EXCHANGE / REPORTS).open("a") as file:
        file.write(json.dumps(line) + "\n")
