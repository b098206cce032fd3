"""What a projector's window changes on the desk, and that it gives it all back, come what may."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from typing import Any

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import ProjectorError
from drivers.window import WindowProjector
from drivers.xserver import XServer, linear, list_monitors
from tests.processes import PATIENCE_S
from tests.screens.desk import Desk, displayed, x_client

PROGRAM = """
import sys, time
import numpy as np
from drivers.clock import SystemClock
from drivers.window import WindowProjector
projector = WindowProjector("DUMMY1", 0.0, SystemClock())
projector.show(np.full(projector.resolution, 255, np.uint8))
print("shown", flush=True)
if sys.argv[1] == "raise":
    raise RuntimeError("something unforeseen")
time.sleep(60)
"""


@pytest.mark.parametrize(
    ("ending", "number"),
    [
        pytest.param("raise", None, id="exception"),
        pytest.param("wait", signal.SIGINT, id="Ctrl+C"),
        pytest.param("wait", signal.SIGTERM, id="terminated"),
        pytest.param("wait", signal.SIGKILL, id="killed"),
    ],
)
def test_black_and_tidy_however_the_program_ends(
    desk: Desk, ending: str, number: signal.Signals | None
) -> None:
    desk.run("xrandr", "--output", "DUMMY1", "--gamma", "1:0.8:0.6")
    server = XServer()
    tinted = server.gamma_ramp("DUMMY1")
    assert tinted != linear(tinted)
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, ending],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "shown\n"
        if number is not None:
            assert (desk.projector_screen(desk.photograph()) == 255).all()
            program.send_signal(number)
        program.wait(PATIENCE_S)
    deadline_s = time.monotonic() + 1
    while desk.photograph().any() or server.gamma_ramp("DUMMY1") != tinted:
        assert time.monotonic() < deadline_s
    server.close()


def test_the_gamma_ramp_is_linear_while_open_and_then_as_it_was(desk: Desk) -> None:
    desk.run("xrandr", "--output", "DUMMY1", "--gamma", "1.2:1:0.7")
    server = XServer()
    before, operators = server.gamma_ramp("DUMMY1"), server.gamma_ramp("DUMMY0")
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    for ramp in server.gamma_ramp("DUMMY1"):
        assert ramp == tuple(257 * level for level in range(256))
    projector.close()
    assert server.gamma_ramp("DUMMY1") == before
    assert server.gamma_ramp("DUMMY0") == operators
    server.close()


def saver_is_on(connection: Any) -> bool:
    import xcffib.screensaver

    root = connection.get_setup().roots[0].root
    saver = connection(xcffib.screensaver.key)
    return bool(saver.QueryInfo(root).reply().state == xcffib.screensaver.State.On)


def test_the_screen_saver_is_held_off_and_then_let_go(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    desk.run("xset", "s", "1", "1")
    projector.show(np.full(desk.projector_px, 255, np.uint8))
    with x_client() as connection:
        time.sleep(2.2)
        assert not saver_is_on(connection)
        assert (desk.projector_screen(desk.photograph()) == 255).all()
        projector.close()
        deadline_s = time.monotonic() + 5
        while not saver_is_on(connection):
            assert time.monotonic() < deadline_s
            time.sleep(0.1)


def test_no_cursor_is_in_the_picture_and_the_keyboard_stays_with_the_operator(desk: Desk) -> None:
    import xcffib.xfixes

    with x_client() as connection:
        root = connection.get_setup().roots[0].root
        fixes = connection(xcffib.xfixes.key)
        fixes.QueryVersion(4, 0).reply()
        focus = connection.core.GetInputFocus().reply().focus
        projector = WindowProjector("DUMMY1", 0.0, SystemClock())
        projector.show(np.full(desk.projector_px, 255, np.uint8))
        connection.core.WarpPointer(0, root, 0, 0, 0, 0, 2500, 400, is_checked=True).check()
        assert not any(fixes.GetCursorImage().reply().cursor_image)
        assert connection.core.GetInputFocus().reply().focus == focus
        projector.close()


@pytest.mark.parametrize(
    ("variables", "advice"),
    [
        pytest.param({"DISPLAY": None}, "DISPLAY=:0", id="no display"),
        pytest.param({"DISPLAY": ":987"}, "cannot be reached", id="no server"),
        pytest.param({"WAYLAND_DISPLAY": "wayland-0"}, "xinit", id="Wayland"),
    ],
)
def test_without_a_usable_display_it_says_what_to_do(
    variables: dict[str, str | None], advice: str
) -> None:
    with displayed(**variables):
        with pytest.raises(ProjectorError, match=advice):
            list_monitors()
        with pytest.raises(ProjectorError, match=advice):
            WindowProjector("DUMMY1", 0.0, SystemClock())


def test_no_graphics_library_is_loaded_before_a_window_is_wanted() -> None:
    program = "import sys, drivers.window; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert "drivers" in loaded
    assert not loaded & {"glfw", "moderngl", "xcffib"}
