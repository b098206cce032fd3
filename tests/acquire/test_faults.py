"""What befalls a capture: at most the frame in flight is lost, and the session says what it was."""

from __future__ import annotations

import os
import resource
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acquire.cli.main import app
from acquire.errors import SessionError, StorageError
from acquire.proof import read_proofs
from acquire.recording import record
from acquire.rig.bench import Bench, Resumption, closed_with
from acquire.sequencer import Outcome
from acquire.session import Session
from acquire.session.folder import MOST_LOST
from acquire.session.log import read_notes
from acquire.session.verification import happenings, problems
from drivers.clock import SystemClock
from drivers.errors import CameraError, CameraTimeoutError, ProjectorError
from drivers.protocols import CameraSettings, Devices
from drivers.ptp.discovery import open_camera
from drivers.sim.devices import SimulatedBench, SimulatedProjector, SimulationConfig, build
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.server import PtpIpServer
from tests.acquire.captures import Notes, captured, recorded_bytes, small_bench, small_plan
from tests.acquire.faults import Faults, with_faults
from tests.raws import counts

PLAN = small_plan("[pattern]\npitch_px = [8]\n")
BENCH = small_bench(late=0.06, dropped=0.04, swapped=0.04, full_well_e=2500.0, read_noise_e=50.0)


def sound(folder: Path) -> bool:
    return [problem for problem in problems(Session.open(folder)) if problem] == []


def said(folder: Path) -> str:
    """What a plain `verify` says beside what is wrong."""
    return "\n".join(happenings(Session.open(folder)))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A capture that nothing disturbed, some frames of it taken again."""
    session, _ = captured(tmp_path_factory.mktemp("whole") / "s", PLAN, BENCH)
    assert len(session.lines) > len(PLAN) + 2
    return session


def cut(whole: Session, folder: Path, kept: int) -> Path:
    """The session as it was when `kept` exposures lay on the disk and the power failed."""
    shutil.copytree(whole.folder, folder)
    lines = (folder / "frames.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "frames.jsonl").write_bytes(b"".join(lines[:kept]))
    for line in whole.lines[kept:]:
        (folder / line.file).unlink()
    (folder / "proof.jsonl").unlink()
    record_ = (folder / "session.json").read_text().replace('"complete"', '"running"')
    (folder / "session.json").write_text(record_)
    return folder


def add(name: str, content: bytes) -> Callable[[Path, Session, int], None]:
    def damage(folder: Path, _whole: Session, _kept: int) -> None:
        with (folder / name).open("ab") as file:
            file.write(content)

    return damage


def next_file(folder: Path, whole: Session, kept: int) -> None:
    (folder / whole.lines[kept].file).write_bytes(b"all of it, or something else")


def next_part(folder: Path, whole: Session, kept: int) -> None:
    file = folder / whole.lines[kept].file
    file.with_name(f".{file.name}.part").write_bytes(b"half")


def half_line(folder: Path, whole: Session, kept: int) -> None:
    next_file(folder, whole, kept)
    line = whole.lines[kept].to_line()
    add("frames.jsonl", line[: len(line) // 2])(folder, whole, kept)


def zero_line(folder: Path, whole: Session, kept: int) -> None:
    next_file(folder, whole, kept)
    line = whole.lines[kept].to_line()
    add("frames.jsonl", bytes(100) + line[100:])(folder, whole, kept)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        pytest.param(add("frames.jsonl", b""), "power failed", id="between two frames"),
        pytest.param(next_part, "in flight", id="file in part"),
        pytest.param(next_file, "in flight", id="file without line"),
        pytest.param(half_line, "is unfinished", id="line in part"),
        pytest.param(zero_line, "is unfinished", id="beginning of the line is zeros"),
        pytest.param(add("frames.jsonl", bytes(4096)), "is unfinished", id="page of zeros"),
        pytest.param(add("proof.jsonl", b'{"step":0,"atte'), "power failed", id="proof in part"),
        pytest.param(add("proof.jsonl", bytes(99) + b"}\n"), "power failed", id="proof of zeros"),
        pytest.param(add("log.jsonl", bytes(99)), "power failed", id="log of zeros"),
        pytest.param(add(".session.json.part", b"{"), "in flight", id="record in part"),
    ],
)
def test_what_a_power_cut_leaves_is_told_and_mended(
    tmp_path: Path, whole: Session, damage: Callable[[Path, Session, int], None], words: str
) -> None:
    retake = next(n for n, line in enumerate(whole.lines) if line.attempt)
    for kept in (7, retake):
        folder = cut(whole, tmp_path / str(kept), kept)
        damage(folder, whole, kept)
        assert sound(folder)
        assert words in said(folder)
        session, outcome = captured(folder, PLAN, BENCH)
        assert outcome is Outcome.COMPLETE
        assert recorded_bytes(folder) == recorded_bytes(whole.folder)
        assert sound(folder)
        assert [run.outcome for run in session.record.runs] == ["interrupted", "complete"]


@pytest.mark.parametrize(
    "lose",
    [
        pytest.param(lambda path: path.unlink(), id="gone"),
        pytest.param(lambda path: os.truncate(path, 0), id="empty"),
        pytest.param(lambda path: path.write_bytes(bytes(path.stat().st_size)), id="zeros"),
    ],
)
def test_frames_that_a_disk_confirmed_and_lost_are_taken_again(
    tmp_path: Path, whole: Session, lose: Callable[[Path], None]
) -> None:
    retake = next(n for n, line in enumerate(whole.lines) if line.attempt)
    folder = cut(whole, tmp_path / "s", retake + 1)
    for line in whole.lines[retake - 2 : retake + 1]:
        lose(folder / line.file)
    assert not sound(folder)
    notes = Notes()
    captured(folder, PLAN, BENCH, notes)
    assert "had not kept the last 3 frame(s)" in notes.warnings[0]
    assert recorded_bytes(folder) == recorded_bytes(whole.folder)
    assert sound(folder)
    assert "had not kept the last 3 frame(s)" in said(folder)


def lose_last(folder: Path, whole: Session) -> None:
    for line in whole.lines[-2:]:
        (folder / line.file).unlink()


def spoil_one(folder: Path, whole: Session) -> None:
    path = folder / whole.lines[-5].file
    path.write_bytes(path.read_bytes()[:-1] + b"\0")


@pytest.mark.parametrize(
    ("damage", "dropped"),
    [pytest.param(lose_last, 2, id="last gone"), pytest.param(spoil_one, 5, id="one byte before")],
)
def test_frames_that_were_lost_after_the_capture_are_taken_again_when_asked_for(
    tmp_path: Path, whole: Session, damage: Callable[[Path, Session], None], dropped: int
) -> None:
    folder = tmp_path / "s"
    shutil.copytree(whole.folder, folder)
    damage(folder, whole)
    verified = CliRunner().invoke(app, ["verify", str(folder)])
    assert verified.exit_code == 1
    assert f"with `--mend`: it takes the last {dropped} exposure(s) again" in verified.output
    session, outcome = captured(folder, PLAN, BENCH, mend=True)
    assert outcome is Outcome.COMPLETE
    assert recorded_bytes(folder) == recorded_bytes(whole.folder)
    assert sound(folder)
    assert f"its last {dropped} frame(s)" in said(folder)
    assert read_proofs(folder) == read_proofs(whole.folder)
    # A second time there is nothing to mend.
    assert captured(folder, PLAN, BENCH, mend=True)[0].record == session.record


def test_a_capture_whose_files_are_gone_is_not_called_complete(
    tmp_path: Path, whole: Session
) -> None:
    folder = tmp_path / "s"
    shutil.copytree(whole.folder, folder)
    lose_last(folder, whole)
    before = recorded_bytes(folder)
    with pytest.raises(SessionError, match=r"missing or damaged\. .*--mend.*verify"):
        captured(folder, PLAN, BENCH)
    (folder / whole.lines[3].file).unlink()
    with pytest.raises(SessionError, match=r"exposures back .*Restore"):
        captured(folder, PLAN, BENCH)
    assert recorded_bytes(folder) | {whole.lines[3].file: before[whole.lines[3].file]} == before
    other = small_bench(seed=4)
    with pytest.raises(SessionError, match="another bench"):
        captured(folder, PLAN, other, mend=True)


def no_frames(folder: Path) -> None:
    for path in (folder / "frames").iterdir():
        path.unlink()


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        pytest.param(no_frames, "no power cut explains", id="all files gone"),
        pytest.param(
            lambda folder: os.truncate(folder / "frames.jsonl", 0), "lost its lines", id="no lines"
        ),
    ],
)
def test_what_no_power_cut_explains_is_refused_and_left_alone(
    tmp_path: Path, whole: Session, damage: Callable[[Path], object], reason: str
) -> None:
    folder = cut(whole, tmp_path / "s", MOST_LOST + 4)
    damage(folder)
    before = recorded_bytes(folder)
    with pytest.raises(SessionError, match=reason):
        captured(folder, PLAN, BENCH)
    assert recorded_bytes(folder) == before


def contents(session: Session) -> list[bytes]:
    """What befell a capture shows in the times that its files tell, and in nothing else."""
    return [counts(session.read(frame)) for frame in session.frames]


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Session:
    session, _ = captured(tmp_path_factory.mktemp("clean") / "s", PLAN, small_bench())
    return session


def at(number: int, error: BaseException) -> Callable[[int], BaseException | None]:
    return lambda n: error if n == number else None


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        pytest.param(
            Faults(failing=at(9, CameraError("switched off"))), "switched off", id="camera off"
        ),
        pytest.param(
            Faults(lost=at(9, CameraError("cable pulled"))), "cable pulled", id="file lost"
        ),
        pytest.param(
            Faults(unplugged=lambda n: n == 9), "was unplugged", id="projector's cable pulled"
        ),
        pytest.param(
            Faults(failing=at(9, CameraTimeoutError("asleep"))), "Tried 3 time", id="camera asleep"
        ),
    ],
)
def test_a_device_that_fails_ends_the_run_and_the_next_goes_on(
    tmp_path: Path, clean: Session, faults: Faults, words: str
) -> None:
    with pytest.raises((CameraError, ProjectorError)):
        captured(tmp_path / "s", PLAN, with_faults(small_bench(), faults))
    session = Session.open(tmp_path / "s")
    assert len(session.frames) == 9
    assert sound(tmp_path / "s")
    assert words in said(tmp_path / "s")
    session, _ = captured(tmp_path / "s", PLAN, small_bench())
    assert contents(session) == contents(clean)
    assert words in said(tmp_path / "s")


@pytest.mark.parametrize("jump_s", [-7200.0, 3600.0, 1e8], ids=["back", "forward", "years"])
def test_a_clock_that_is_set_changes_nothing_but_is_told(
    tmp_path: Path, clean: Session, jump_s: float
) -> None:
    faults = Faults(clock_off_s=lambda n: jump_s if n > 9 else 0.0)
    session, outcome = captured(tmp_path / "s", PLAN, with_faults(small_bench(), faults))
    assert outcome is Outcome.COMPLETE
    assert contents(session) == contents(clean)
    assert f"jumped by {jump_s:+.0f} s between steps 8 and 9" in said(tmp_path / "s")
    times = [frame.monotonic_s for frame in session.lines]
    assert None not in times
    assert times == sorted(times, key=lambda moment: moment or 0.0)


def test_a_frame_across_a_suspension_is_not_kept(tmp_path: Path, clean: Session) -> None:
    """The light goes when the computer sleeps: what was exposed meanwhile is dark."""
    faults = Faults(slept_s=lambda n: 3600.0 if n > 9 else 0.0, dark=lambda n: n == 9)
    notes = Notes()
    session, outcome = captured(tmp_path / "s", PLAN, with_faults(small_bench(), faults), notes)
    assert outcome is Outcome.COMPLETE
    assert contents(session) == contents(clean)
    assert session.lines == session.frames
    (warning,) = notes.warnings
    assert warning.startswith("step 9: the computer was suspended for 3600 s")
    assert warning in said(tmp_path / "s")
    assert [note.step for note in read_notes(tmp_path / "s")] == [9]


class ErraticClock(SystemClock):
    """The wall clock is set by hours, back and forth, all the time."""

    def __init__(self) -> None:
        self.count = 0

    def now(self) -> float:
        self.count += 1
        return super().now() + (-10_800, 3_600, 86_400)[self.count % 3]


@pytest.fixture
def lit() -> SimulatedBench:
    return build(SimulationConfig("board", camera_px=(16, 20), projector_px=(48, 64)))


@pytest.fixture
def responder(lit: SimulatedBench) -> Callable[..., Responder]:
    def source(settings: CameraSettings) -> tuple[bytes, str]:
        frame = lit.camera.capture(settings)
        return frame.data, frame.media_type

    return lambda *wrong: Responder(source, misbehaviours=[*map(Misbehaviour.parse, wrong)])


@pytest.fixture
def over_tcp(lit: SimulatedBench) -> Callable[[Path, int], tuple[Session, Outcome]]:
    def run(folder: Path, port: int) -> tuple[Session, Outcome]:
        def connect(_: Resumption, closing: ExitStack) -> Devices:
            clock = ErraticClock()
            camera = open_camera(f"ptpip:127.0.0.1:{port}", clock)
            return closed_with(Devices(SimulatedProjector(lit.stage, 0.0), camera, clock), closing)

        bench = Bench("the network camera", {"kind": "tcp"}, (48, 64), 3000, 0.0, connect)
        return record(FEW, bench, folder, Notes(), threading.Event())

    return run


class Unplugged:
    """Tells when a camera has pulled its own cable."""

    def __init__(self, server: PtpIpServer) -> None:
        self.server, self.stopped = server, threading.Event()

    def watch(self) -> None:
        while self.server.is_plugged_in:
            time.sleep(0.01)
        self.stopped.set()


FEW = small_plan("[pattern]\npitch_px = [8]\nshifts = [2, 2]\n[camera]\nexposure_s = 0.005\n")


@pytest.fixture
def undisturbed(lit: SimulatedBench) -> list[bytes]:
    frames = []
    for number in range(len(FEW)):
        step = FEW.step(number)
        lit.projector.show(FEW.projector.raster(step.pattern, (48, 64)))
        frames.append(counts(lit.camera.capture(step.settings).data))
    return frames


Run = Callable[[Path, int], tuple[Session, Outcome]]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        pytest.param("sleep+3", "1 time(s) no file came from the camera", id="asleep"),
        pytest.param("cut-object+3", "", id="file cut off and fetched again"),
    ],
)
def test_a_camera_on_the_network_that_stops_answering_is_asked_again(
    tmp_path: Path,
    responder: Callable[..., Responder],
    over_tcp: Run,
    undisturbed: list[bytes],
    wrong: str,
    words: str,
) -> None:
    with PtpIpServer(responder(wrong)) as server:
        session, outcome = over_tcp(tmp_path / "s", server.address[1])
    assert outcome is Outcome.COMPLETE
    assert contents(session) == undisturbed
    assert sound(tmp_path / "s")
    assert words in said(tmp_path / "s")
    assert "clock jumped" in said(tmp_path / "s")


def test_a_camera_whose_cable_is_put_back_at_once_loses_nothing(
    tmp_path: Path, responder: Callable[..., Responder], over_tcp: Run, undisturbed: list[bytes]
) -> None:
    def put_back() -> None:
        first.stopped.wait()
        time.sleep(1)
        with PtpIpServer(responder(), port=first.server.address[1]):
            done.wait()

    done = threading.Event()
    first = Unplugged(PtpIpServer(responder("unplug+3")))
    hand = threading.Thread(target=put_back)
    hand.start()
    try:
        with first.server:
            threading.Thread(target=first.watch, daemon=True).start()
            session, outcome = over_tcp(tmp_path / "s", first.server.address[1])
    finally:
        done.set()
        hand.join()
    assert outcome is Outcome.COMPLETE
    assert contents(session) == undisturbed


def test_a_camera_that_is_gone_ends_the_run_soon_and_the_next_goes_on(
    tmp_path: Path, responder: Callable[..., Responder], over_tcp: Run, undisturbed: list[bytes]
) -> None:
    """Soon by the clock that nobody sets, although the other one jumps by hours."""
    with PtpIpServer(responder("unplug+3")) as server:
        port = server.address[1]
        with pytest.raises(CameraError, match="did not come back"):
            over_tcp(tmp_path / "s", port)
    assert len(Session.open(tmp_path / "s").frames) == 3
    assert sound(tmp_path / "s")
    assert "did not come back" in said(tmp_path / "s")
    with PtpIpServer(responder(), port=port):
        session, _ = over_tcp(tmp_path / "s", port)
    assert contents(session) == undisturbed
    assert session.complete


def test_a_disk_too_full_to_note_why_a_run_ended_is_told_all_the_same(
    tmp_path: Path, clean: Session
) -> None:
    """Neither a frame nor the record has room, but a line at the end of a file has."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill_up(number: int) -> bool:
        if number == 9:
            resource.setrlimit(resource.RLIMIT_FSIZE, (600, hard))
        return False

    try:
        with pytest.raises(StorageError, match="The disk is full"):
            captured(tmp_path / "s", PLAN, with_faults(small_bench(), Faults(dark=fill_up)))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    session = Session.open(tmp_path / "s")
    assert session.record.runs[-1].outcome == "running"
    assert "run 1 of 1, from step 0: running: The disk is full" in said(tmp_path / "s")
    session, _ = captured(tmp_path / "s", PLAN, small_bench())
    assert contents(session) == contents(clean)
    told = said(tmp_path / "s")
    assert "run 1 of 2, from step 0: interrupted: The disk is full" in told
    assert told.count("The disk is full") == 1
