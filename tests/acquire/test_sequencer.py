from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from acquire.errors import BenchError, SessionError
from acquire.pause import Pause
from acquire.plan import Step
from acquire.rig import Bench
from acquire.rig.bench import closed_with
from acquire.sequencer import Outcome
from acquire.session import Session
from drivers.errors import CameraError, CameraTimeoutError, ProjectorError
from drivers.protocols import CameraSettings, Devices, Raster, RawFrame
from drivers.sim.clock import SimulatedClock
from tests.acquire.captures import Notes, captured, recorded_bytes, small_bench, small_plan
from tests.raws import counts

RESOLUTION = (48, 64)


@dataclass
class BareProjector:
    """Holds what it shows; black when closed."""

    resolution: tuple[int, int] = RESOLUTION
    shown: Raster | None = None
    history: list[Raster] = field(default_factory=list)
    lost_after: int | None = None

    def show(self, raster: Raster) -> None:
        self.shown = raster
        self.history.append(raster)

    def check(self) -> None:
        if self.lost_after is not None and len(self.history) > self.lost_after:
            raise ProjectorError("the projector was unplugged")

    def close(self) -> None:
        self.shown = np.zeros(self.resolution, np.uint8)


@dataclass
class BareCamera:
    """Delivers the raster it sees as its file; fails as told, by attempt number."""

    projector: BareProjector
    failures: Mapping[int, BaseException] = field(default_factory=dict)
    settings: CameraSettings | None = None
    before: Callable[[int], None] = lambda _: None
    attempts: int = 0
    media_type: str = "image/x-adobe-dng"

    def capture(self, settings: CameraSettings) -> RawFrame:
        attempt, self.attempts = self.attempts, self.attempts + 1
        self.before(attempt)
        if attempt in self.failures:
            raise self.failures[attempt]
        assert self.projector.shown is not None
        data = self.projector.shown.tobytes()
        return RawFrame(data, self.media_type, self.settings or settings, 1.0, 2.0)

    def close(self) -> None:
        pass


def bare_bench(camera: BareCamera, warnings: tuple[str, ...] = ()) -> Bench:
    devices = Devices(camera.projector, camera, SimulatedClock(), warnings)
    return Bench(
        "bare",
        {"kind": "bare"},
        RESOLUTION,
        3072,
        0.0,
        lambda _, way_out: closed_with(devices, way_out),
    )


def test_every_frame_holds_its_own_pattern(tmp_path: Path) -> None:
    projector = BareProjector()
    session, outcome = captured(tmp_path / "s", bench=bare_bench(BareCamera(projector)))
    assert outcome is Outcome.COMPLETE
    for frame in session.frames:
        assert session.read(frame) == frame.pattern.raster(RESOLUTION).tobytes()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        ("no file came", "step 4: no file came. Trying again."),
        ("no file came.", "step 4: no file came. Trying again."),
        ("is it asleep?", "step 4: is it asleep? Trying again."),
    ],
)
def test_a_time_out_is_tried_again(tmp_path: Path, error: str, said: str) -> None:
    camera = BareCamera(BareProjector(), {4: CameraTimeoutError(error)})
    notes = Notes()
    session, _ = captured(tmp_path / "s", bench=bare_bench(camera), notes=notes)
    assert session.complete
    assert [text for text in notes.warnings if "step 4" in text] == [said]


def test_too_many_time_outs_stop_cleanly_and_can_be_gone_on_with(tmp_path: Path) -> None:
    silent = {attempt: CameraTimeoutError("no file came.") for attempt in (4, 5, 6)}
    camera = BareCamera(BareProjector(), silent)
    with pytest.raises(CameraTimeoutError, match=r"Step 4 .*Tried 3 time"):
        captured(tmp_path / "s", bench=bare_bench(camera))
    session = Session.open(tmp_path / "s")
    assert len(session.frames) == 4
    assert session.record.runs[-1].outcome == "failed"
    assert "no file came" in session.record.runs[-1].reason
    session, outcome = captured(tmp_path / "s", bench=bare_bench(BareCamera(BareProjector())))
    assert outcome is Outcome.COMPLETE
    assert [run.first_step for run in session.record.runs] == [0, 4]


@pytest.mark.parametrize(
    "error",
    [CameraError("unplugged"), RuntimeError("a bug"), KeyboardInterrupt()],
    ids=["camera", "bug", "second Ctrl-C"],
)
def test_whatever_happens_the_projector_is_black_and_the_frames_are_kept(
    tmp_path: Path, error: BaseException
) -> None:
    camera = BareCamera(BareProjector(), {6: error})
    with pytest.raises(type(error)):
        captured(tmp_path / "s", bench=bare_bench(camera))
    assert camera.projector.shown is not None
    assert not camera.projector.shown.any()
    assert len(Session.open(tmp_path / "s").frames) == 6


def test_a_frame_during_which_the_projector_was_lost_is_not_kept(tmp_path: Path) -> None:
    camera = BareCamera(BareProjector(lost_after=4))
    with pytest.raises(ProjectorError, match="unplugged"):
        captured(tmp_path / "s", bench=bare_bench(camera))
    assert camera.attempts == 5
    assert len(Session.open(tmp_path / "s").frames) == 4


def test_settings_that_differ_are_not_kept(tmp_path: Path) -> None:
    camera = BareCamera(BareProjector(), settings=CameraSettings(0.2, 8.0, 200))
    with pytest.raises(BenchError, match="not kept"):
        captured(tmp_path / "s", bench=bare_bench(camera))
    assert not Session.open(tmp_path / "s").frames


def test_the_last_frame_is_safe_before_the_next_exposure(tmp_path: Path) -> None:
    lines_before = []

    def look(_attempt: int) -> None:
        lines_before.append(len((tmp_path / "s" / "frames.jsonl").read_bytes().splitlines()))

    camera = BareCamera(BareProjector(), before=look)
    captured(tmp_path / "s", bench=bare_bench(camera))
    assert lines_before == list(range(len(small_plan())))


def test_a_stop_finishes_the_frame_in_flight(tmp_path: Path) -> None:
    notes = Notes()

    def ask(attempt: int) -> None:
        if attempt == 5:
            notes.stop.set()

    camera = BareCamera(BareProjector(), before=ask)
    session, outcome = captured(tmp_path / "s", bench=bare_bench(camera), notes=notes)
    assert outcome is Outcome.STOPPED
    assert len(session.frames) == 6
    assert camera.projector.shown is not None
    assert not camera.projector.shown.any()


def test_stopped_at_every_frame_the_result_is_the_same(tmp_path: Path) -> None:
    defects = {"late": 0.1, "dropped": 0.1, "swapped": 0.1, "timeouts": 0.2, "drift": 0.1}
    noise = {"full_well_e": 20000.0, "read_noise_e": 5.0, "flicker": 0.1, "latency_s": 0.15}
    bench = small_bench(**defects, **noise)
    plan = small_plan("[pattern]\npitch_px = [8]\nshifts = [4, 2]\n[camera]\nretries = 50\n")
    captured(tmp_path / "whole", plan, bench)
    for index in range(len(plan)):
        captured(tmp_path / "pieces", plan, bench, Notes(stop_after=index))
    captured(tmp_path / "pieces", plan, bench)
    assert recorded_bytes(tmp_path / "pieces") == recorded_bytes(tmp_path / "whole")


class Attendant(threading.Thread):
    """Whenever a capture rests: does something and lets it go on; until it is dismissed."""

    def __init__(self, pause: Pause, act: Callable[[], object]) -> None:
        super().__init__(daemon=True)
        self.pause, self.act = pause, act
        self.rests = 0
        self.dismissed = threading.Event()

    def run(self) -> None:
        while not self.dismissed.wait(0.001):
            if self.pause.is_asked and self.pause.is_resting:
                self.rests += 1
                self.act()
                self.pause.go_on()

    def dismiss(self) -> int:
        self.dismissed.set()
        self.join()
        return self.rests


def test_a_rest_is_dark_and_takes_no_frame(tmp_path: Path) -> None:
    pause, seen = Pause(), list[bool]()
    camera = BareCamera(BareProjector(), before=lambda n: pause.ask() if n == 5 else None)

    def look() -> None:
        assert camera.projector.shown is not None
        seen.append(bool(camera.projector.shown.any()))
        seen.append(len((tmp_path / "s" / "frames.jsonl").read_bytes().splitlines()) == 6)

    attendant = Attendant(pause, look)
    attendant.start()
    session, outcome = captured(tmp_path / "s", bench=bare_bench(camera), pause=pause)
    assert attendant.dismiss() == 1
    assert seen == [False, True]
    assert outcome is Outcome.COMPLETE
    for frame in session.frames:
        assert session.read(frame) == frame.pattern.raster(RESOLUTION).tobytes()


def test_a_stop_ends_a_rest(tmp_path: Path) -> None:
    pause, notes = Pause(), Notes()
    pause.ask()
    attendant = Attendant(pause, notes.stop.set)
    attendant.start()
    session, outcome = captured(tmp_path / "s", notes=notes, pause=pause)
    assert attendant.dismiss() == 1
    assert outcome is Outcome.STOPPED
    assert session.frames == []


def test_rested_before_every_frame_the_files_are_the_same(tmp_path: Path) -> None:
    bench = small_bench(late=0.1, dropped=0.05, latency_s=0.05, drift=0.1, full_well_e=20000.0)
    whole, _ = captured(tmp_path / "whole", bench=bench)
    pause = Pause()

    @dataclass
    class Restless(Notes):
        def frame_kept(self, step: Step, total: int) -> None:
            super().frame_kept(step, total)
            pause.ask()

    attendant = Attendant(pause, lambda: None)
    attendant.start()
    rested, _ = captured(tmp_path / "rested", bench=bench, notes=Restless(), pause=pause)
    assert attendant.dismiss() >= len(whole.frames) // 2 - 1
    light = [[counts(one.read(frame)) for frame in one.frames] for one in (rested, whole)]
    assert light[0] == light[1]


def test_same_plan_and_seed_same_bytes_other_seed_other_bytes(tmp_path: Path) -> None:
    for name, seed in [("a", 1), ("b", 1), ("c", 2)]:
        captured(tmp_path / name, bench=small_bench(full_well_e=20000.0, seed=seed))
    assert recorded_bytes(tmp_path / "a") == recorded_bytes(tmp_path / "b")
    assert recorded_bytes(tmp_path / "a") != recorded_bytes(tmp_path / "c")


def test_another_plan_or_bench_is_refused(tmp_path: Path) -> None:
    captured(tmp_path / "s", notes=Notes(stop_after=2))
    with pytest.raises(SessionError, match="another plan"):
        captured(tmp_path / "s", plan=small_plan("[pattern]\npitch_px = [16]\n"))
    with pytest.raises(SessionError, match="another bench"):
        captured(tmp_path / "s", bench=small_bench(seed=99))
    assert len(Session.open(tmp_path / "s").frames) == 3


def test_a_complete_session_is_left_as_it_is(tmp_path: Path) -> None:
    session, _ = captured(tmp_path / "s")
    again, outcome = captured(tmp_path / "s")
    assert outcome is Outcome.COMPLETE
    assert again.record == session.record


def test_stop_event_set_before_the_start_takes_no_frame(tmp_path: Path) -> None:
    stop = threading.Event()
    stop.set()
    session, outcome = captured(tmp_path / "s", notes=Notes(stop=stop))
    assert outcome is Outcome.STOPPED
    assert session.frames == []


@pytest.mark.parametrize("kind", ["image/jpeg", "image/tiff"])
def test_a_camera_that_delivers_developed_pictures_stops_at_the_first(
    tmp_path: Path, kind: str
) -> None:
    projector = BareProjector()
    bench = bare_bench(BareCamera(projector, media_type=kind))
    with pytest.raises(BenchError, match="RAW"):
        captured(tmp_path / "s", bench=bench)
    assert Session.open(tmp_path / "s").frames == []
    assert projector.shown is not None
    assert not projector.shown.any()


def test_what_a_person_should_change_on_the_camera_is_said_first(tmp_path: Path) -> None:
    notes = Notes(stop_after=0)
    captured(tmp_path / "s", bench=bare_bench(BareCamera(BareProjector()), ("full",)), notes=notes)
    assert notes.warnings == ["camera: full"]
