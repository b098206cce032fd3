"""Aiming and capturing in turn, at the simulated bench, ordered by a viewer without a browser."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from acquire.page.bench import Job, PagedBench, unused
from acquire.rig import Bench
from acquire.session import Session
from drivers.errors import CameraError
from tests.acquire.captures import Notes, captured, recorded_bytes, small_bench, small_plan
from tests.acquire.faults import Faults, with_faults
from tests.acquire.page.pages import PATIENCE_S, Client, served


@dataclass
class Terminal(Notes):
    """Remembers which captures began."""

    stages: list[tuple[int, int]] = field(default_factory=list)

    def stage(self, name: str, total: int, done: int = 0) -> None:
        assert name == "capturing"
        self.stages.append((done, total))


@contextmanager
def working(folder: Path, bench: Bench | None = None) -> Iterator[tuple[Client, Terminal]]:
    """A bench with a page at work, and the viewer who commands it."""
    stop, terminal = threading.Event(), Terminal()
    with served(folder) as page:
        job = Job(small_plan(), folder)
        paged = PagedBench(bench or small_bench(), job, page.desk, terminal, stop)
        page.desk.listen(paged.obey)
        work = threading.Thread(target=paged.run)
        work.start()
        viewer = page.viewer()
        try:
            yield viewer, terminal
        finally:
            viewer.close()
            stop.set()
            work.join(PATIENCE_S)
    assert not work.is_alive()


def aims(viewer: Client, note: str) -> dict[str, Any]:
    """Wait until something was said and the bench aims."""
    viewer.is_told(note)
    return viewer.does("aiming")


def test_what_was_captured_before_is_known_and_gone_on_with(tmp_path: Path) -> None:
    notes = Notes(stop_after=6)
    captured(tmp_path / "s", notes=notes)
    captured(tmp_path / "whole")
    with working(tmp_path / "s") as (viewer, terminal):
        assert viewer.does("aiming")["progress"]["done"] == 7
        viewer.ask(do="look", source="exposures")
        viewer.until(lambda state: state["camera"]["source"] == "exposures")
        viewer.until(lambda state: state["camera"]["read_back"] is not None)
        viewer.ask(do="start")
        state = aims(viewer, "complete")
        assert state["progress"]["done"] == state["progress"]["total"]
        viewer.ask(do="show", what="white")
        viewer.shows("white")
        viewer.ask(do="start-new")
        aims(viewer, "s-2")
        assert viewer.state["session"] == "s-2"
    total = len(small_plan())
    assert terminal.stages == [(7, total), (0, total)]
    whole = recorded_bytes(tmp_path / "whole")
    assert recorded_bytes(tmp_path / "s") == recorded_bytes(tmp_path / "s-2") == whole


def test_a_second_start_does_not_begin_again_what_was_stopped(tmp_path: Path) -> None:
    with working(tmp_path / "s", small_bench(real_time=True)) as (viewer, terminal):
        viewer.does("aiming")
        viewer.ask(do="start")
        viewer.ask(do="start")
        viewer.has_done(2)
        viewer.ask(do="stop")
        aims(viewer, "stopped")
        viewer.ask(do="show", what="white")
        viewer.shows("white")
    assert len(terminal.stages) == 1


def test_a_camera_that_fails_lets_the_devices_go_until_the_bench_is_opened(tmp_path: Path) -> None:
    broken = threading.Event()
    broken.set()

    def failing(number: int) -> CameraError | None:
        return CameraError("no camera") if number == 3 and broken.is_set() else None

    bench = with_faults(small_bench(), Faults(failing=failing))
    with working(tmp_path / "s", bench) as (viewer, _):
        viewer.does("aiming")
        viewer.ask(do="start")
        viewer.does("resting")
        assert any("no camera" in note["text"] for note in viewer.state["notes"])
        viewer.ask(do="show", what="white")
        viewer.ask(do="aim")
        aims(viewer, "open the bench first")
        broken.clear()
        viewer.ask(do="start")
        aims(viewer, "complete")
    assert Session.open(tmp_path / "s").complete


def test_frames_that_fail_their_proof_end_the_capture_and_not_the_aiming(tmp_path: Path) -> None:
    bench = with_faults(small_bench(), Faults(dark=lambda number: number > 4))
    with working(tmp_path / "s", bench) as (viewer, _):
        viewer.does("aiming")
        viewer.ask(do="start")
        aims(viewer, "no light of the projector")
        viewer.ask(do="start-new")
        viewer.until(lambda state: state["session"] == "s-2")
        viewer.does("aiming")


def test_a_session_of_another_plan_is_not_touched(tmp_path: Path) -> None:
    captured(tmp_path / "s", small_plan("[pattern]\npitch_px = [8]\nshifts = [4, 2]\n"))
    before = recorded_bytes(tmp_path / "s")
    with working(tmp_path / "s") as (viewer, _):
        viewer.does("aiming")
        viewer.ask(do="start")
        aims(viewer, "another plan")
        assert recorded_bytes(tmp_path / "s") == before
        viewer.ask(do="start-new")
        aims(viewer, "complete")
    assert Session.open(tmp_path / "s-2").complete


@pytest.mark.parametrize(
    ("taken", "given", "wanted"),
    [
        pytest.param([], "night", "night-2", id="second"),
        pytest.param(["night-2"], "night", "night-3", id="third"),
        pytest.param([], "2026-11-22", "2026-11-22-2", id="a date is no number"),
    ],
)
def test_a_new_session_has_the_next_free_name(
    tmp_path: Path, taken: list[str], given: str, wanted: str
) -> None:
    for name in taken:
        (tmp_path / name).mkdir()
    assert unused(tmp_path / given) == tmp_path / wanted
