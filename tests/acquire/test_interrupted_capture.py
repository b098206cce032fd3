"""Real processes on real file systems: killed, stopped, and cut off from their disk."""

from __future__ import annotations

import os
import random
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from acquire.session import Session
from acquire.session.verification import happenings, problems
from tests.acquire.captures import recorded_bytes
from tests.nursery import Child, Nursery, can_mount
from tests.processes import lines, wait_for_lines

PLAN = "[pattern]\npitch_px = [8, 13]\n[references]\nevery_frames = 40\n"
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


@dataclass(frozen=True, slots=True)
class Room:
    """Plan and bench, beside which the sessions are written, and who captures.

    The nursery's parent has captured the whole plan, into `whole`, without any disturbance.
    """

    folder: Path
    nursery: Nursery

    def words(self, session: Path, plan: Path | None = None) -> tuple[str, ...]:
        """Of a capture."""
        return capture(self.folder, session, plan)

    def started(self, session: Path, frames: int) -> Child:
        """A capture, once the session has so many frames; it may be on a disk of the nursery's."""
        child = self.nursery.start(*self.words(session))
        wait_for_lines(child, self.nursery.seen(session), frames)
        return child

    def ends_as_never_disturbed(self, session: Path) -> None:
        """Gone on with, it has the bytes of the capture that nothing befell, and is sound."""
        child = self.nursery.run(*self.words(session))
        assert child.returncode == 0, child.output
        opened = self.nursery.seen(session)
        assert recorded_bytes(opened) == recorded_bytes(self.folder / "whole")
        assert is_sound(opened)


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    folder = tmp_path_factory.mktemp("room")
    (folder / "plan.toml").write_text(PLAN)
    (folder / "bench.toml").write_text(BENCH)
    mounts = can_mount()
    assert mounts or os.environ.get("CI") != "true"
    nursery = Nursery(folder, *capture(folder, folder / "whole"), can_mount=mounts)
    assert nursery.run("--version").returncode == 0
    yield Room(folder, nursery)
    nursery.close()


@pytest.fixture
def session(room: Room, tmp_path: Path) -> Path:
    folder = room.folder / tmp_path.name
    folder.mkdir()
    return folder / "s"


@pytest.fixture
def disk(room: Room, session: Path) -> Path:
    """The session's folder on a disk of its own, which is small."""
    if not can_mount():
        pytest.skip("this system does not let a user make a small disk")
    words = ("-t", "tmpfs", "-o", "size=80m", "tmpfs", str(session.parent))
    assert room.nursery.run(*words, program="mount").returncode == 0
    return session.parent


def capture(room: Path, session: Path, plan: Path | None = None) -> tuple[str, ...]:
    words = ("--bench", str(room / "bench.toml"), "--out", str(session))
    return ("capture", str(plan or room / "plan.toml"), *words)


def is_sound(session: Path) -> bool:
    """What was in flight is told of, and is no damage."""
    return not any(problems(Session.open(session)))


def ends_with(child: Child, status: int, said: str) -> None:
    """It ends by itself, with one message."""
    output = child.finish()
    assert child.returncode == status, output
    assert said in output
    assert "Traceback" not in output


def test_killed_again_and_again_every_file_is_as_if_never_killed(room: Room, session: Path) -> None:
    chance = random.Random(11)
    kills = 0
    whole = lines(room.folder / "whole")
    while lines(session) < whole:
        before = lines(session)
        child = room.started(session, before + chance.randint(1, 12))
        time.sleep(chance.uniform(0, 0.01))
        child.send_signal(signal.SIGKILL)
        child.finish()
        kills += child.returncode == -signal.SIGKILL
        assert lines(session) > before
        assert is_sound(session)
    assert kills >= 5
    room.ends_as_never_disturbed(session)
    outcomes = [run.outcome for run in Session.open(session).record.runs]
    assert outcomes.count("interrupted") == kills
    assert sum("was killed" in line for line in happenings(Session.open(session))) == kills


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_stops_after_the_frame_in_flight(room: Room, session: Path, number: int) -> None:
    child = room.started(session, 5)
    child.send_signal(number)
    ends_with(child, 130, "goes on from there")
    opened = Session.open(session)
    assert 5 <= len(opened.frames) < len(opened.plan)
    assert opened.record.runs[-1].outcome == "stopped"
    room.ends_as_never_disturbed(session)


def test_a_process_that_is_stopped_and_continued_goes_on_as_if_nothing_was(
    room: Room, session: Path
) -> None:
    child = room.nursery.start(*room.words(session))
    for wanted in (3, 25, 50):
        wait_for_lines(child, session, wanted)
        child.send_signal(signal.SIGSTOP)
        time.sleep(0.2)
        child.send_signal(signal.SIGCONT)
    assert child.finish()
    assert child.returncode == 0
    room.ends_as_never_disturbed(session)


def test_a_second_capture_of_the_same_session_is_refused(room: Room, session: Path) -> None:
    first = room.started(session, 3)
    first.send_signal(signal.SIGSTOP)
    second = room.nursery.run(*room.words(session))
    first.send_signal(signal.SIGCONT)
    ends_with(second, 1, "Another lumisplit is writing")
    first.finish()
    assert first.returncode == 0
    room.ends_as_never_disturbed(session)


def test_a_plan_that_was_edited_is_refused_and_the_first_one_goes_on(
    room: Room, session: Path
) -> None:
    child = room.started(session, 3)
    child.send_signal(signal.SIGTERM)
    child.finish()
    edited = session.parent / "plan.toml"
    edited.write_text(PLAN.replace("every_frames = 40", "every_frames = 30"))
    before = recorded_bytes(session)
    ends_with(room.nursery.run(*room.words(session, edited)), 1, "another plan")
    assert recorded_bytes(session) == before
    room.ends_as_never_disturbed(session)


def test_a_folder_that_was_moved_away_stops_and_goes_on_once_it_is_back(
    room: Room, session: Path
) -> None:
    child = room.started(session, 20)
    session.rename(session.with_name("elsewhere"))
    ends_with(child, 1, "moved, renamed or deleted")
    assert not session.exists()
    session.with_name("elsewhere").rename(session)
    assert is_sound(session)
    room.ends_as_never_disturbed(session)


def test_a_folder_that_was_deleted_stops_with_one_message(room: Room, session: Path) -> None:
    child = room.started(session, 20)
    session.rename(session.with_name("doomed"))
    shutil.rmtree(session.with_name("doomed"))
    ends_with(child, 1, "moved, renamed or deleted")
    room.ends_as_never_disturbed(session)


def _fill(nursery: Nursery, disk: Path) -> Callable[[], object]:
    nursery.run("-c", f"cat /dev/zero > {disk}/ballast", program="sh")
    return lambda: nursery.run(f"{disk}/ballast", program="rm")


def _forbid(nursery: Nursery, disk: Path) -> Callable[[], object]:
    # Over itself, as what is open for writing cannot be made read-only where it is.
    script = f"mount --bind {disk} {disk} && mount -o remount,bind,ro {disk}"
    assert nursery.run("-c", script, program="sh").returncode == 0
    return lambda: nursery.run(str(disk), program="umount")


@pytest.mark.parametrize(
    ("befall", "said"),
    [
        pytest.param(_fill, "The disk is full", id="full"),
        pytest.param(_forbid, "takes no writing any more", id="read-only"),
    ],
)
def test_a_disk_that_takes_no_more_stops_cleanly_and_is_gone_on_with(
    room: Room,
    session: Path,
    disk: Path,
    befall: Callable[[Nursery, Path], Callable[[], object]],
    said: str,
) -> None:
    child = room.started(session, 5)
    mend = befall(room.nursery, disk)
    ends_with(child, 1, said)
    assert not list((room.nursery.seen(session) / "frames").glob(".*.part"))
    verified = room.nursery.run("verify", str(session))
    assert verified.returncode == 0, verified.output
    assert "run 1 of 1" in verified.output
    mend()
    room.ends_as_never_disturbed(session)
    assert "every digest is right" in room.nursery.run("verify", str(session)).output


def test_of_a_full_disk_it_is_said_that_it_may_have_been_full(
    room: Room, session: Path, disk: Path
) -> None:
    child = room.started(session, 5)
    child.send_signal(signal.SIGKILL)
    child.finish()
    assert "or its disk filled up" not in room.nursery.run("verify", str(session)).output
    mend = _fill(room.nursery, disk)
    assert "The disk is full now: make room." in room.nursery.run("verify", str(session)).output
    mend()
    room.ends_as_never_disturbed(session)
