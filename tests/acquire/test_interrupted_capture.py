"""Real processes on real file systems: killed, stopped, and cut off from their disk."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from acquire.session import Session
from acquire.session.verification import happenings, problems
from tests.acquire.captures import recorded_bytes
from tests.nursery import Child, Nursery, can_mount
from tests.processes import PATIENCE_S, lines

PLAN = "[pattern]\npitch_px = [8, 13, 29]\n[references]\nevery_frames = 50\n"
BENCH = """kind = "sim"
[sim]
camera_px = [16, 20]
projector_px = [48, 64]
full_well_e = 20000
read_noise_e = 5
late = 0.05
swapped = 0.05
timeouts = 0.05
"""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Plan and bench, beside which the sessions are written."""
    folder = tmp_path_factory.mktemp("room")
    (folder / "plan.toml").write_text(PLAN)
    (folder / "bench.toml").write_text(BENCH)
    return folder


@pytest.fixture(scope="module")
def nursery(room: Path) -> Iterator[Nursery]:
    """Its parent has captured the whole plan, into `whole`, without any disturbance."""
    mounts = can_mount()
    assert mounts or os.environ.get("CI") != "true"
    nursery = Nursery(room, *capture(room, room / "whole"), can_mount=mounts)
    assert nursery.run("--version").returncode == 0
    yield nursery
    nursery.close()


@pytest.fixture
def session(room: Path, tmp_path: Path) -> Path:
    folder = room / tmp_path.name
    folder.mkdir()
    return folder / "s"


def capture(room: Path, session: Path) -> tuple[str, ...]:
    plan, bench = str(room / "plan.toml"), str(room / "bench.toml")
    return ("capture", plan, "--bench", bench, "--out", str(session))


def wait_for_lines(child: Child, session: Path, wanted: int) -> None:
    """Until the session has so many frames, or the process has ended."""
    deadline_s = time.monotonic() + PATIENCE_S
    while lines(session) < wanted and child.poll() is None:
        assert time.monotonic() < deadline_s
        time.sleep(0.002)


def assert_as_never_disturbed(nursery: Nursery, room: Path, session: Path) -> None:
    """Gone on with, it ends with the bytes of the capture that nothing befell, and is sound."""
    child = nursery.run(*capture(room, session))
    assert child.returncode == 0, child.output
    assert recorded_bytes(nursery.seen(session)) == recorded_bytes(room / "whole")
    opened = Session.open(nursery.seen(session))
    assert [problem for problem in problems(opened) if problem] == []


def test_killed_again_and_again_every_file_is_as_if_never_killed(
    nursery: Nursery, room: Path, session: Path
) -> None:
    chance = random.Random(11)
    kills = 0
    whole = lines(room / "whole")
    while lines(session) < whole:
        before = lines(session)
        child = nursery.start(*capture(room, session))
        wait_for_lines(child, session, before + chance.randint(1, 20))
        time.sleep(chance.uniform(0, 0.01))
        child.send_signal(signal.SIGKILL)
        child.finish()
        kills += child.returncode == -signal.SIGKILL
        assert lines(session) > before
        # What was in flight is told of, and is no damage.
        opened = Session.open(session)
        assert [problem for problem in problems(opened) if problem] == []
    assert kills >= 5
    assert_as_never_disturbed(nursery, room, session)
    outcomes = [run.outcome for run in Session.open(session).record.runs]
    assert outcomes.count("interrupted") == kills
    assert sum("was killed" in line for line in happenings(Session.open(session))) == kills


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_after_the_frame_in_flight(
    nursery: Nursery, room: Path, session: Path, number: int
) -> None:
    child = nursery.start(*capture(room, session))
    wait_for_lines(child, session, 5)
    child.send_signal(number)
    output = child.finish()
    assert child.returncode == 130
    assert "goes on from there" in output
    assert "Traceback" not in output
    opened = Session.open(session)
    assert 5 <= len(opened.frames) < len(opened.plan)
    assert opened.record.runs[-1].outcome == "stopped"
    assert_as_never_disturbed(nursery, room, session)


def test_a_process_that_is_stopped_and_continued_goes_on_as_if_nothing_was(
    nursery: Nursery, room: Path, session: Path
) -> None:
    child = nursery.start(*capture(room, session))
    for wanted in (3, 30, 70):
        wait_for_lines(child, session, wanted)
        child.send_signal(signal.SIGSTOP)
        time.sleep(0.2)
        child.send_signal(signal.SIGCONT)
    assert child.finish()
    assert child.returncode == 0
    assert_as_never_disturbed(nursery, room, session)


def test_a_second_capture_of_the_same_session_is_refused(
    nursery: Nursery, room: Path, session: Path
) -> None:
    first = nursery.start(*capture(room, session))
    wait_for_lines(first, session, 3)
    first.send_signal(signal.SIGSTOP)
    second = nursery.run(*capture(room, session))
    first.send_signal(signal.SIGCONT)
    assert second.returncode == 1
    assert "Another lumisplit is writing" in second.output
    first.finish()
    assert first.returncode == 0
    assert_as_never_disturbed(nursery, room, session)


def test_a_plan_that_was_edited_is_refused_and_the_first_one_goes_on(
    nursery: Nursery, room: Path, session: Path
) -> None:
    child = nursery.start(*capture(room, session))
    wait_for_lines(child, session, 3)
    child.send_signal(signal.SIGTERM)
    child.finish()
    edited = session.parent / "plan.toml"
    edited.write_text(PLAN.replace("every_frames = 50", "every_frames = 40"))
    before = recorded_bytes(session)
    words = capture(room, session)
    refused = nursery.run(*(str(edited) if word.endswith("plan.toml") else word for word in words))
    assert refused.returncode == 1
    assert "another plan" in refused.output
    assert recorded_bytes(session) == before
    assert_as_never_disturbed(nursery, room, session)


def test_a_folder_that_was_moved_away_stops_and_goes_on_once_it_is_back(
    nursery: Nursery, room: Path, session: Path
) -> None:
    child = nursery.start(*capture(room, session))
    wait_for_lines(child, session, 20)
    session.rename(session.with_name("elsewhere"))
    output = child.finish()
    assert child.returncode == 1
    assert "moved, renamed or deleted" in output
    assert "Traceback" not in output
    assert not session.exists()
    session.with_name("elsewhere").rename(session)
    assert [problem for problem in problems(Session.open(session)) if problem] == []
    assert_as_never_disturbed(nursery, room, session)


def test_a_folder_that_was_deleted_stops_with_one_message(
    nursery: Nursery, room: Path, session: Path
) -> None:
    child = nursery.start(*capture(room, session))
    wait_for_lines(child, session, 20)
    session.rename(session.with_name("doomed"))
    shutil.rmtree(session.with_name("doomed"))
    output = child.finish()
    assert child.returncode == 1
    assert "moved, renamed or deleted" in output
    assert "Traceback" not in output
    assert_as_never_disturbed(nursery, room, session)


def _fill(nursery: Nursery, disk: Path) -> Callable[[], object]:
    nursery.run("-c", f"cat /dev/zero > {disk}/ballast", program="sh")
    return lambda: nursery.run(f"{disk}/ballast", program="rm")


def _forbid(nursery: Nursery, disk: Path) -> Callable[[], object]:
    # Over itself, as what is open for writing cannot be made read-only where it is.
    script = f"mount --bind {disk} {disk} && mount -o remount,bind,ro {disk}"
    assert nursery.run("-c", script, program="sh").returncode == 0
    return lambda: nursery.run(str(disk), program="umount")


@pytest.mark.skipif(not can_mount(), reason="this system does not let a user make a small disk")
@pytest.mark.parametrize(
    ("befall", "said"),
    [
        pytest.param(_fill, "The disk is full", id="full"),
        pytest.param(_forbid, "takes no writing any more", id="read-only"),
    ],
)
def test_a_disk_that_takes_no_more_stops_cleanly_and_is_gone_on_with(
    nursery: Nursery,
    room: Path,
    session: Path,
    befall: Callable[[Nursery, Path], Callable[[], object]],
    said: str,
) -> None:
    disk = session.parent
    words = ("-t", "tmpfs", "-o", "size=80m", "tmpfs", str(disk))
    assert nursery.run(*words, program="mount").returncode == 0
    child = nursery.start(*capture(room, session))
    wait_for_lines(child, nursery.seen(session), 5)
    mend = befall(nursery, disk)
    output = child.finish()
    assert child.returncode == 1
    assert said in output
    assert "Traceback" not in output
    assert not list((nursery.seen(session) / "frames").glob(".*.part"))
    verified = nursery.run("verify", str(session))
    assert verified.returncode == 0, verified.output
    assert "run 1 of 1" in verified.output
    mend()
    assert_as_never_disturbed(nursery, room, session)
    assert "every digest is right" in nursery.run("verify", str(session)).output


@pytest.mark.skipif(not can_mount(), reason="this system does not let a user make a small disk")
def test_of_a_full_disk_it_is_said_that_it_may_have_been_full(
    nursery: Nursery, room: Path, session: Path
) -> None:
    disk = session.parent
    words = ("-t", "tmpfs", "-o", "size=80m", "tmpfs", str(disk))
    assert nursery.run(*words, program="mount").returncode == 0
    child = nursery.start(*capture(room, session))
    wait_for_lines(child, nursery.seen(session), 5)
    child.send_signal(signal.SIGKILL)
    child.finish()
    assert "or its disk filled up" not in nursery.run("verify", str(session)).output
    mend = _fill(nursery, disk)
    assert "The disk is full now: make room." in nursery.run("verify", str(session)).output
    mend()
    assert_as_never_disturbed(nursery, room, session)
