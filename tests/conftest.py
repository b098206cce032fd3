from __future__ import annotations

import os

import pytest

import acquire  # noqa: F401 - before numpy, whose threads it limits


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--expect-bench", help="bench file of the devices that must be there")


# What takes longest, longest first: begun last, one of them keeps a single worker busy at the end.
LONG = (
    "tests/guest/test_usb_stack.py",
    "tests/acquire/test_interrupted_capture.py",
    "tests/screens/test_lab_session.py",
    "tests/processing/test_ranges.py",
    "tests/acquire/test_pipeline.py",
)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: many tests wait for a program, a window or a camera."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    ranks = {file: rank for rank, file in enumerate(LONG)}
    items.sort(key=lambda item: ranks.get(item.nodeid.partition("::")[0], len(LONG)))
