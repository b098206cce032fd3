"""What becomes of the picture when the monitors change under it."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import Any

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import ProjectorError
from drivers.window import WindowProjector
from tests.screens.desk import Desk, x_client

CHANGES = [
    pytest.param(["--output", "DUMMY1", "--off"], "gone", id="unplugged"),
    pytest.param(["--output", "DUMMY1", "--mode", "1024x768"], "1024x768", id="other mode"),
    pytest.param(["--output", "DUMMY1", "--same-as", "DUMMY0"], "0", id="mirrored"),
    pytest.param(["--output", "DUMMY1", "--left-of", "DUMMY0"], "changed", id="places swapped"),
    pytest.param(["--output", "DUMMY1", "--gamma", "1:0.8:0.6"], "colours", id="night light"),
]


def white(desk: Desk) -> np.ndarray:
    return np.full(desk.projector_px, 255, np.uint8)


@pytest.mark.parametrize(("change", "reason"), CHANGES)
def test_a_change_while_the_light_settles_ends_show_within_a_second(
    desk: Desk, change: list[str], reason: str
) -> None:
    projector = WindowProjector("DUMMY1", 30.0, SystemClock())
    changed_s = []

    def pull() -> None:
        changed_s.append(time.monotonic())
        desk.run("xrandr", *change)

    threading.Timer(0.3, pull).start()
    with pytest.raises(ProjectorError, match=reason):
        projector.show(white(desk))
    assert time.monotonic() - changed_s[0] < 1
    assert not desk.photograph().any()
    with pytest.raises(ProjectorError, match=reason):
        projector.show(white(desk))
    projector.close()


@pytest.mark.parametrize(("change", "reason"), CHANGES)
def test_a_change_during_an_exposure_takes_the_picture_down_and_is_told_after_it(
    desk: Desk, change: list[str], reason: str
) -> None:
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    projector.show(white(desk))
    assert desk.photograph().any()
    desk.run("xrandr", *change)
    deadline_s = time.monotonic() + 1
    while desk.photograph().any():
        assert time.monotonic() < deadline_s
    with pytest.raises(ProjectorError, match=reason):
        projector.check()
    projector.close()


def test_a_window_process_that_hangs_is_an_error(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    projector.show(white(desk))
    os.kill(projector._process.pid, signal.SIGSTOP)
    with pytest.raises(ProjectorError, match="did not answer"):
        projector.show(white(desk))
    assert not desk.photograph().any()


def test_a_window_process_that_dies_is_an_error(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 30.0, SystemClock())
    threading.Timer(0.3, os.kill, (projector._process.pid, signal.SIGKILL)).start()
    started_s = time.monotonic()
    with pytest.raises(ProjectorError, match="ended"):
        projector.show(white(desk))
    assert time.monotonic() - started_s < 1.5
    assert not desk.photograph().any()


def pop_up(connection: Any) -> int:
    """A white window in the middle of the projector's picture, over all others."""
    from xcffib.xproto import CW

    window = int(connection.generate_id())
    root = connection.get_setup().roots[0]
    mask = CW.BackPixel | CW.OverrideRedirect
    place = (2200, 300, 200, 100)
    core = connection.core
    core.CreateWindow(
        root.root_depth, window, root.root, *place, 0, 1, root.root_visual, mask, [0xFFFFFF, 1]
    )
    core.MapWindow(window, is_checked=True).check()
    return window


def test_a_window_that_pops_up_over_the_picture_is_put_behind_it(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    raster = np.full(desk.projector_px, 9, np.uint8)
    projector.show(raster)
    with x_client() as connection:
        pop_up(connection)
        projector.check()
        deadline_s = time.monotonic() + 1
        while not (desk.projector_screen(desk.photograph()) == 9).all():
            assert time.monotonic() < deadline_s
    projector.close()


def test_a_window_that_keeps_coming_back_is_an_error(desk: Desk) -> None:
    from xcffib.xproto import ConfigWindow, StackMode

    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    projector.show(white(desk))
    with x_client() as connection:
        window = pop_up(connection)

        def come_back() -> None:
            for _ in range(100):
                projector.check()
                connection.core.ConfigureWindow(
                    window, ConfigWindow.StackMode, [StackMode.Above], is_checked=True
                ).check()

        with pytest.raises(ProjectorError, match="keeps covering"):
            come_back()
    projector.close()


def test_a_second_program_cannot_take_the_projector(desk: Desk) -> None:
    first = WindowProjector("DUMMY1", 0.0, SystemClock())
    first.show(white(desk))
    with pytest.raises(ProjectorError, match="Another lumisplit"):
        WindowProjector("DUMMY1", 0.0, SystemClock())
    first.check()
    assert (desk.projector_screen(desk.photograph()) == 255).all()
    first.close()
    second = WindowProjector("DUMMY1", 0.0, SystemClock())
    second.close()
