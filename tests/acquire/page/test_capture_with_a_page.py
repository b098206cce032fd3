"""``lumisplit capture --page``: the page may rest and end a capture but cannot harm it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from acquire.page.commands import Order
from acquire.page.link import MAX_STARTS
from acquire.page.state import Activity, Snapshot
from acquire.session import Session
from acquire.session.verification import problems
from tests.acquire.page.pages import PATIENCE_S, served
from tests.acquire.page.programs import Program, children, needs_proc

PLAN = "[pattern]\npitch_px = [8, 12]\nshifts = [4, 2]\n[projector]\nsettle_s = 0.05\n"
BENCH = """kind = "sim"
[sim]
scene = "board"
camera_px = [16, 20]
projector_px = [48, 64]
real_time = true
"""


class Capture(Program):
    """A running capture and the viewer who commands it."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, PLAN, BENCH, "capture", "--page")
        self.first = self.viewer()


@pytest.fixture
def capture(tmp_path: Path) -> Iterator[Capture]:
    capture = Capture(tmp_path)
    yield capture
    capture.first.close()
    capture.kill()


def test_the_page_rests_and_stops_it_and_the_command_goes_on(
    capture: Capture, tmp_path: Path
) -> None:
    viewer = capture.first
    capture.first.has_done(2)
    viewer.ask(do="pause")
    viewer.does("paused")
    viewer.ask(do="show", what="white")
    viewer.ask(do="stop")
    viewer.does("ended")
    assert any("Not while the plan" in note["text"] for note in viewer.state["notes"])
    assert "goes on from there" in capture.end()
    assert capture.process.returncode == 130
    session = Session.open(capture.session)
    assert 2 <= len(session.frames) < len(session.plan)
    assert viewer.state["progress"]["done"] == len(session.frames)
    again = Capture(tmp_path)
    again.first.does("ended")
    again.first.close()
    again.end()
    assert again.process.returncode == 0
    session = Session.open(capture.session)
    assert session.complete
    assert [problem for problem in problems(session) if problem] == []


def test_the_pictures_are_the_frames_with_what_they_should_show(capture: Capture) -> None:
    viewer = capture.first
    viewer.until(lambda _: any(head.get("frame") for head, _ in viewer.pictures))
    viewer.does("ended")
    capture.end()
    session = Session.open(capture.session)
    for head, files in viewer.pictures:
        if head["kind"] == "picture":
            record = session.frames[head["frame"]["step"]]
            assert head["frame"]["sha256"] == record.sha256
            assert files[0].startswith(b"\x89PNG")


@needs_proc
def test_a_page_that_is_killed_comes_back_with_the_truth(capture: Capture) -> None:
    capture.first.has_done(1)
    capture.first.ask(do="pause")
    before = capture.first.does("paused")
    (page,) = children(capture.process.pid)
    os.kill(page, signal.SIGKILL)
    again = capture.viewer()
    state = again.does("paused")
    assert state["progress"] == before["progress"]
    assert state["holder"] == state["you"]
    assert capture.frames == before["progress"]["done"]
    again.ask(do="go-on")
    again.does("ended")
    again.close()
    assert "started again" in capture.end()
    assert capture.process.returncode == 0
    assert Session.open(capture.session).complete


@needs_proc
def test_a_page_that_is_killed_again_and_again_is_given_up() -> None:
    with served() as page:
        for count in range(1, MAX_STARTS + 1):
            deadline_s = time.monotonic() + PATIENCE_S
            while len(page.warnings) < count:
                assert time.monotonic() < deadline_s
                for child in children(os.getpid()):
                    with suppress(ProcessLookupError):
                        os.kill(child, signal.SIGKILL)
        for number in range(3):
            page.desk.remark(f"note {number}")
            page.desk.picture("image/png", bytes(1 << 20))
        assert ["goes on without it" in text for text in page.warnings] == [False] * 4 + [True]
    assert children(os.getpid()) == []


def test_a_signal_ends_it_with_the_page_open(capture: Capture) -> None:
    capture.first.has_done(1)
    capture.process.send_signal(signal.SIGTERM)
    capture.end()
    assert capture.process.returncode == 130
    capture.first.does("ended")


def test_a_page_that_takes_nothing_does_not_hold_the_desk_up() -> None:
    """Far more than any buffer holds is posted while the page's process stands still."""
    with served() as page:
        viewer = page.viewer()
        (process,) = children(os.getpid())[-1:]
        os.kill(process, signal.SIGSTOP)
        try:
            for number in range(300):
                page.desk.picture("image/png", bytes(1 << 20))
                page.desk.remark(f"note {number}")
        finally:
            os.kill(process, signal.SIGCONT)
        viewer.is_told("note 299")
        page.desk.change(lambda _: Snapshot(Activity.RESTING))
        viewer.does("resting")
        viewer.ask(do="aim")
        assert page.commands.get(timeout=PATIENCE_S) == Order(do="aim")
        viewer.close()
