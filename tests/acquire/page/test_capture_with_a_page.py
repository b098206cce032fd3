"""``lumisplit capture --page``: the page may rest and end a capture but cannot harm it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from acquire.page.commands import Order
from acquire.page.state import Activity, Snapshot
from acquire.session import Session
from acquire.session.verification import problems
from tests.acquire.page.pages import PATIENCE_S, Client, served

PLAN = "[pattern]\npitch_px = [8, 12]\nshifts = [4, 2]\n[projector]\nsettle_s = 0.05\n"
BENCH = 'kind = "sim"\n[sim]\ncamera_px = [16, 20]\nprojector_px = [48, 64]\nreal_time = true\n'


class Capture:
    """A running capture and a viewer of its page."""

    def __init__(self, folder: Path) -> None:
        (folder / "plan.toml").write_text(PLAN)
        (folder / "bench.toml").write_text(BENCH)
        self.session = folder / "s"
        words = ["capture", "plan.toml", "--out", "s", "--bench", "bench.toml", "--page"]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "acquire", *words],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert self.process.stdout is not None
        line = next(line for line in self.process.stdout if line.startswith("page: "))
        address = urlsplit(line.split()[-1])
        self.viewer = Client(
            f"ws://{address.netloc}{address.path}socket", f"http://{address.netloc}"
        )

    def end(self) -> str:
        output, _ = self.process.communicate(timeout=PATIENCE_S)
        assert "Traceback" not in output
        return output


@pytest.fixture
def capture(tmp_path: Path) -> Iterator[Capture]:
    capture = Capture(tmp_path)
    yield capture
    capture.viewer.close()
    if capture.process.poll() is None:
        capture.process.kill()
        capture.process.communicate()


def test_the_page_rests_and_stops_it_and_the_command_goes_on(
    capture: Capture, tmp_path: Path
) -> None:
    viewer = capture.viewer
    capture.viewer.has_done(2)
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
    again.viewer.does("ended")
    again.viewer.close()
    again.end()
    assert again.process.returncode == 0
    session = Session.open(capture.session)
    assert session.complete
    assert [problem for problem in problems(session) if problem] == []


def test_the_pictures_are_the_frames_with_what_they_should_show(capture: Capture) -> None:
    viewer = capture.viewer
    viewer.until(lambda _: any(head.get("frame") for head, _ in viewer.pictures))
    viewer.does("ended")
    capture.end()
    session = Session.open(capture.session)
    for head, files in viewer.pictures:
        if head["kind"] == "picture":
            record = session.frames[head["frame"]["step"]]
            assert head["frame"]["sha256"] == record.sha256
            assert files[0].startswith(b"\x89PNG")


def children(pid: int) -> list[int]:
    return [
        int(child)
        for path in Path(f"/proc/{pid}/task").glob("*/children")
        for child in path.read_text().split()
    ]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's /proc")
def test_a_page_that_is_killed_does_not_stop_it(capture: Capture) -> None:
    capture.viewer.has_done(1)
    for child in children(capture.process.pid):
        os.kill(child, signal.SIGKILL)
    output = capture.end()
    assert capture.process.returncode == 0
    assert "goes on without it" in output
    assert Session.open(capture.session).complete


def test_a_signal_ends_it_with_the_page_open(capture: Capture) -> None:
    capture.viewer.has_done(1)
    capture.process.send_signal(signal.SIGTERM)
    capture.end()
    assert capture.process.returncode == 130
    capture.viewer.does("ended")


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
