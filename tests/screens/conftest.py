"""Desks as pytest fixtures."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tests.screens.desk import Desk, missing, set_up_desk

SIZES_PX = {"1280x800": (800, 1280), "1920x1080": (1080, 1920)}


def require_desk() -> None:
    """Skip, or fail in CI, where no X server with two monitors can be started."""
    lacking = missing()
    if lacking and os.environ.get("CI") == "true":
        pytest.fail(f"CI must have an X server with two monitors; missing: {lacking}")
    if lacking:
        pytest.skip(f"no X server with two monitors on this machine; missing: {lacking}")


@pytest.fixture(scope="module", params=list(SIZES_PX.values()), ids=list(SIZES_PX))
def running_desk_of_each_size(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Desk]:
    """A desk with a projector of each size that labs have; use `desk_of_each_size`."""
    require_desk()
    with set_up_desk(tmp_path_factory.mktemp("xorg"), request.param) as desk:
        yield desk


@pytest.fixture(scope="module")
def running_desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """A desk with the smaller projector; use `desk`, which puts it in order first."""
    require_desk()
    with set_up_desk(tmp_path_factory.mktemp("xorg"), SIZES_PX["1280x800"]) as desk:
        yield desk


@pytest.fixture
def desk_of_each_size(running_desk_of_each_size: Desk) -> Iterator[Desk]:
    """A desk in order, and this process's display for one test."""
    running_desk_of_each_size.arrange()
    with running_desk_of_each_size.at_hand():
        yield running_desk_of_each_size


@pytest.fixture
def desk(running_desk: Desk) -> Iterator[Desk]:
    """A desk in order, and this process's display for one test."""
    running_desk.arrange()
    with running_desk.at_hand():
        yield running_desk
