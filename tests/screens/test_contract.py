"""The projector's contract, held by the window."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers.clock import SystemClock
from drivers.window import WindowProjector
from tests.contracts.benches import ProjectorCase
from tests.contracts.test_projector import *  # noqa: F403 - run here with the `case` below
from tests.screens.desk import Desk


@pytest.fixture  # type: ignore[no-redef]  # in place of the table's devices
def case(desk: Desk) -> Iterator[ProjectorCase]:
    assert desk.projector_px == (800, 1280)
    clock = SystemClock()
    projector = WindowProjector("DUMMY1", 0.1, clock)
    yield ProjectorCase(projector, clock, settle_s=0.1)
    projector.close()
