"""What a named profile does to the numbers, from calibration to result on a simulated bench."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import rawpy

from acquire.calibrating import calibrate
from acquire.calibrating.board import BoardCalibration
from acquire.calibrating.finding import Calibration, Setting
from acquire.calibrating.run import capture_all
from acquire.calibrating.sensor import DarkCalibration, NoiseCalibration
from acquire.cli.progress import ProgressDisplay
from acquire.errors import ProfileError
from acquire.evaluation import read_truth
from acquire.pipeline import Options, process
from acquire.plan import CameraPlan, Plan, ProjectorPlan
from acquire.plan_file import WHITE
from acquire.profile_cautions import UNUSED
from acquire.profile_use import profiles_for
from acquire.result import Result
from acquire.rig import Bench
from acquire.rig.bench import Resumption
from acquire.rig.replayed import replay_bench
from acquire.rig.simulated import simulated_bench
from acquire.session import Session
from drivers.image import Demosaic
from drivers.protocols import Camera, CameraSettings, Devices, RawFrame
from drivers.sim.dng import encode_dng
from processing.patterns import Family
from tests.acquire.captures import SMALL_SIM, Notes, captured, small_plan
from tests.acquire.test_pipeline import Silent

BLURRED = SMALL_SIM.model_copy(
    update={
        "scene": "board", "camera_px": (48, 48), "projector_px": (144, 192), "blur_px": 1.0,
        "full_well_e": 20_000.0, "read_noise_e": 5.0,
    }
)  # fmt: skip
PITCHES = small_plan("[pattern]\npitch_px = [4, 8, 12, 24]\n")
IVA = Options("iva", n_components=2)


def calibrated(kinds: tuple[Calibration, ...], bench: Bench, folder: Path) -> Path:
    setting = Setting(CameraPlan(), ProjectorPlan(), bench.resolution)
    with ProgressDisplay(quiet=True) as progress:
        for one in kinds:
            at = folder / f"{one.kind}.session"
            sessions, _ = capture_all(one, setting, bench, at, progress, Notes().stop)
            calibrate(one, sessions, folder / f"{one.kind}.json", progress)
    return folder


@pytest.fixture(scope="module")
def profiles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("profiles")
    kinds = (BoardCalibration(), NoiseCalibration(), DarkCalibration())
    return calibrated(kinds, simulated_bench(BLURRED), folder)


@pytest.fixture(scope="module")
def blurred(tmp_path_factory: pytest.TempPathFactory) -> Session:
    folder = tmp_path_factory.mktemp("blurred") / "s"
    return captured(folder, PITCHES, simulated_bench(BLURRED))[0]


def processed(
    session: Session, folder: Path, *named: Path, options: Options = IVA
) -> tuple[Result, dict[int, float]]:
    """The result and the relative error of direct light at each pitch."""
    result = process(session, folder, options, Silent(), None, profiles_for(session, named))
    truth = read_truth(session.folder / "truth.npz", result.record.shape)["direct"]
    use = result.mask == 0
    errors = {}
    for pitch in result.record.pitches:
        off = (result.pitch_image(pitch.direct) - truth)[use]
        errors[pitch.pitch_px] = float(np.linalg.norm(off) / np.linalg.norm(truth[use]))
    return result, errors


def test_blur_that_a_board_measured_is_divided_out(
    profiles: Path, blurred: Session, tmp_path: Path
) -> None:
    """A board has nothing but direct light: what pitch 8 loses there is all blur."""
    _, plain = processed(blurred, tmp_path / "plain")
    result, freed = processed(blurred, tmp_path / "freed", profiles / "board.json")
    assert plain[8] > 0.4
    for pitch_px in (8, 12):
        assert freed[pitch_px] < plain[pitch_px] / 4
    assert freed[24] < plain[24] + 0.005
    resolved = {pitch.pitch_px: pitch.resolved for pitch in result.record.pitches}
    assert resolved == {4: False, 8: True, 12: True, 24: True}
    assert freed[4] == plain[4]
    text = " ".join(result.record.warnings)
    assert "Not resolved, by the board: checker 4 px" in text
    assert "divided by it" in text
    assert "more than all light there is" not in text
    for pitch in result.record.pitches:
        both = result.pitch_image(pitch.direct) + result.pitch_image(pitch.global_)
        np.testing.assert_allclose(both, result.white, atol=1e-5)
    profile_digests = result.record.options["profiles"]
    assert isinstance(profile_digests, dict)
    assert profile_digests.keys() == {"board"}


def test_a_noise_profile_gives_errors_where_frames_tell_no_noise(
    profiles: Path, tmp_path: Path
) -> None:
    """Three phases hold no complementary pair."""
    text = '[pattern]\nfamily = "sinusoid-columns"\npitch_px = [32]\nshifts = [1, 3]\n'
    sharp = simulated_bench(BLURRED)
    session, _ = captured(tmp_path / "s", small_plan(text), sharp)
    plain, _ = processed(session, tmp_path / "plain")
    named = profiles / "noise.json", profiles / "board.json"
    result, _ = processed(session, tmp_path / "named", *named)
    assert plain.record.pitches[0].deviation is None
    (pitch,) = result.record.pitches
    assert pitch.deviation is not None
    assert pitch.corrected is not None
    truth = read_truth(session.folder / "truth.npz", result.record.shape)["direct"]
    off = np.abs(result.pitch_image(pitch.corrected) - truth)
    share = float((off <= result.pitch_image(pitch.deviation)).mean())
    # 6912 values: 0.68 ± 0.03, the requirement on stated errors.
    assert share == pytest.approx(0.68, abs=0.03)


def test_frames_noisier_than_the_profile_are_said(profiles: Path, tmp_path: Path) -> None:
    """The lamp flickers at an exposure that is no whole number of refreshes."""
    lit = simulated_bench(BLURRED.model_copy(update={"flicker": 1.0}))
    text = "[pattern]\npitch_px = [24, 32]\n[camera]\nexposure_s = 0.104\n"
    session, _ = captured(tmp_path / "s", small_plan(text), lit, keep_unproven=True)
    result, _ = processed(session, tmp_path / "r", profiles / "noise.json")
    assert any("times as noisy as the noise profile says" in w for w in result.record.warnings)


def test_profiles_of_superpixels_are_left_out_of_demosaiced_frames(
    profiles: Path, blurred: Session, tmp_path: Path
) -> None:
    named = [profiles / f"{kind}.json" for kind in ("board", "noise", "dark")]
    found = profiles_for(blurred, named)
    assert found.hot is not None
    hot = np.zeros_like(found.hot)
    hot[10, 20] = True
    options = replace(IVA, demosaic=Demosaic.BILINEAR)
    result = process(blurred, tmp_path / "r", options, Silent(), None, replace(found, hot=hot))
    assert UNUSED in result.record.cautions
    used = result.record.options["profiles"]
    assert isinstance(used, dict)
    assert used.keys() == {"dark"}
    # The quad and the photosites around it, which its values went into.
    left_out = np.zeros(result.record.shape, bool)
    left_out[19:23, 39:43] = True
    assert ((result.mask == 1) == left_out).all()


@dataclass(frozen=True)
class Lifted:
    """A camera whose raw files state a black level that is 100 counts too low."""

    inner: Camera

    def capture(self, settings: CameraSettings) -> RawFrame:
        frame = self.inner.capture(settings)
        with rawpy.imread(io.BytesIO(frame.data)) as raw:
            counts = np.minimum(raw.raw_image + np.uint16(100), 16383).astype(np.uint16)
        return replace(frame, data=encode_dng(counts, settings))

    def close(self) -> None:
        self.inner.close()


def lifted_bench() -> Bench:
    bench = simulated_bench(BLURRED.model_copy(update={"blur_px": 0.0}))

    @contextmanager
    def opened(resumption: Resumption) -> Iterator[Devices]:
        with bench.open(resumption) as devices:
            yield replace(devices, camera=Lifted(devices.camera))

    return replace(bench, _connect=lambda plan, closing: closing.enter_context(opened(plan)))


def test_a_black_level_that_files_misstate_is_taken_off(tmp_path: Path) -> None:
    """Where no black frame was captured that could hold it."""
    bench = lifted_bench()
    dark = calibrated((DarkCalibration(),), bench, tmp_path) / "dark.json"
    patterns = tuple(p for p in PITCHES.patterns if p.family is not Family.BLACK)
    session, _ = captured(tmp_path / "s", Plan(patterns=patterns), bench)
    assert patterns[0] == WHITE
    truth = sum(read_truth(session.folder / "truth.npz", (48, 48)).values())
    plain, _ = processed(session, tmp_path / "plain")
    named, _ = processed(session, tmp_path / "named", dark)
    assert float(np.mean(plain.white - truth)) == pytest.approx(100 / 15871, rel=0.05)
    assert abs(float(np.mean(named.white - truth))) < 0.05 * 100 / 15871


def test_profiles_of_a_bench_hold_for_its_recordings(
    profiles: Path, blurred: Session, tmp_path: Path
) -> None:
    first, _ = captured(tmp_path / "1", PITCHES, replay_bench(blurred.folder))
    again, _ = captured(tmp_path / "2", PITCHES, replay_bench(first.folder))
    for session in (first, again):
        assert profiles_for(session, [profiles / "board.json"]).contrast is not None
    other = simulated_bench(BLURRED.model_copy(update={"gamma": 1.8}))
    strange, _ = captured(tmp_path / "3", PITCHES, other)
    replayed, _ = captured(tmp_path / "4", PITCHES, replay_bench(strange.folder))
    with pytest.raises(ProfileError, match="another bench"):
        profiles_for(replayed, [profiles / "board.json"])
