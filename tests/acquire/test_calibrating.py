"""Every calibration on the simulated bench with known defects, through the ordinary capture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from acquire.bench_file import SimSection
from acquire.calibrating import calibrate, recorded_sessions
from acquire.calibrating.board import BoardCalibration
from acquire.calibrating.exposure import ExposureCalibration
from acquire.calibrating.finding import Calibration, Setting
from acquire.calibrating.geometry import GeometryCalibration
from acquire.calibrating.latency import LatencyCalibration
from acquire.calibrating.page import write_page
from acquire.calibrating.projector import LeakCalibration, ResponseCalibration
from acquire.calibrating.run import Calibrated, capture_all
from acquire.calibrating.sensor import DarkCalibration, NoiseCalibration
from acquire.cli.progress import ProgressDisplay
from acquire.errors import ProfileError
from acquire.plan import CameraPlan, Plan, ProjectorPlan
from acquire.plan_file import BLACK, WHITE
from acquire.profile_file import check_applies, read_maps, read_profile
from acquire.recording import record
from acquire.rig.simulated import simulated_bench
from calibration.poses import Chessboard
from drivers.sim.devices import SimulationConfig, build
from processing.patterns import Family, Pattern, shift_grid
from tests.acquire.captures import Notes

SIM = SimSection(
    scene="board",
    seed=4,
    camera_px=(40, 40),
    projector_px=(120, 160),
    gamma=2.2,
    black_level=0.01,
    full_well_e=20_000,
    read_noise_e=5,
)


def calibrated(
    calibration: Calibration, folder: Path, camera: CameraPlan | None = None, **changes: object
) -> Calibrated:
    bench = simulated_bench(SIM.model_copy(update=changes))
    setting = Setting(camera or CameraPlan(), ProjectorPlan(), bench.resolution)
    with ProgressDisplay(quiet=True) as progress:
        sessions, _ = capture_all(
            calibration, setting, bench, folder / "frames", progress, Notes().stop
        )
        return calibrate(calibration, sessions, folder / "profile.json", progress)


def value(found: Calibrated, name: str) -> NDArray[np.float64]:
    return found.profile.numbers(name)


def test_dark(tmp_path: Path) -> None:
    found = calibrated(DarkCalibration(), tmp_path, black_level=0.0)
    # Read noise of 5 electrons and rounding of 1/√12 counts; green is the mean of two.
    one = np.hypot(5 / 20_000, 1 / np.sqrt(12) / 15_871)
    expected = one * np.array([1, 1 / np.sqrt(2), 1])
    assert value(found, "read_noise") == pytest.approx(expected, rel=0.03)
    assert np.abs(value(found, "black_level")).max() < 1e-4
    assert value(found, "hot_pixels") == [0]


def test_noise(tmp_path: Path) -> None:
    found = calibrated(NoiseCalibration(), tmp_path)
    errors = np.array(found.profile.quantities["electrons_in_range"].uncertainty)
    off = np.abs(value(found, "electrons_in_range") - 20_000)
    assert np.all(off < 4 * errors)
    assert np.all(errors < 0.03 * 20_000)
    assert value(found, "read_noise_e") == pytest.approx([5] * 3, abs=0.5)
    per_count = 20_000 / (16_383 - 512)
    assert value(found, "electrons_per_count") == pytest.approx([per_count] * 3, rel=0.05)
    assert value(found, "linear_to") > 0.6


def test_response_to_half_a_per_cent_of_white(tmp_path: Path) -> None:
    found = calibrated(ResponseCalibration(steps=16), tmp_path)
    truth = (np.arange(256) / 255) ** 2.2
    for colour in ("red", "green", "blue"):
        assert np.abs(found.profile.column("light", colour) - truth).max() < 0.005
    assert value(found, "gamma") == pytest.approx([2.2] * 3, abs=0.02)
    assert value(found, "offset") == pytest.approx([0.01], abs=0.005)
    assert not any("white segment" in warning for warning in found.profile.warnings)


def test_leak_is_a_map_and_a_number(tmp_path: Path) -> None:
    found = calibrated(LeakCalibration(), tmp_path, black_level=0.03)
    assert value(found, "leak") == pytest.approx([0.03], abs=3e-4)
    profile, _ = read_profile(tmp_path / "profile.json")
    leak = read_maps(tmp_path / "profile.json", profile)["leak"]
    assert leak.shape == SIM.camera_px
    assert np.nanmean(leak) == pytest.approx(0.03, abs=1e-3)


@pytest.mark.parametrize("start_s", [0.002, 0.1, 2.0])
def test_exposure_from_anywhere_in_few_shots(tmp_path: Path, start_s: float) -> None:
    found = calibrated(ExposureCalibration(), tmp_path, CameraPlan(exposure_s=start_s))
    assert value(found, "exposure_s") * 60 == pytest.approx(value(found, "refreshes"))
    assert 0.66 < value(found, "expected_signal").max() <= 0.8
    assert sum(use.frames for use in found.profile.sessions) <= 30


def test_flicker_is_measured_and_warned_of(tmp_path: Path) -> None:
    calm = calibrated(ExposureCalibration(), tmp_path / "calm", flicker=0.3)
    # Whole refreshes cancel it; told a wrong refresh, they do not.
    assert value(calm, "flicker") < 0.002
    beating = calibrated(ExposureCalibration(refresh_hz=75), tmp_path / "beating", flicker=0.3)
    assert value(beating, "flicker") > 0.005
    assert any("flickers" in warning for warning in beating.profile.warnings)


@pytest.mark.parametrize("delay_s", [0.02, 0.117, 0.3])
def test_latency_to_five_milliseconds(tmp_path: Path, delay_s: float) -> None:
    found = calibrated(LatencyCalibration(), tmp_path, latency_s=delay_s)
    assert value(found, "delay_s") == pytest.approx([delay_s], abs=0.005)
    assert value(found, "settle_s") > delay_s


def board_truth(pitches: NDArray[np.float64], blur_px: float) -> NDArray[np.float64]:
    """(pitches, 3) from the geometry alone: Gaussian, photosites' boxes, two greens' distance."""
    bench = build(SimulationConfig("board", 0, (48, 48), (144, 192)))
    places = bench.projector_coordinates()
    down, right = np.gradient(places, axis=0), np.gradient(places, axis=1)
    scale = bench.stage.transport.projector_px_per_camera_px
    truth = np.zeros((len(pitches), 3))
    for k, pitch_px in enumerate(pitches):
        total = np.zeros(3)
        for sign in (1, -1):
            along = [
                (step[..., 0] + sign * step[..., 1]) / (2 * pitch_px) for step in (down, right)
            ]
            box = np.sinc(along[0] / 2) * np.sinc(along[1] / 2)
            greens = np.cos(np.pi * (along[0] - along[1]) / 2)
            total += np.stack([box, box * greens, box], axis=-1).mean(axis=(0, 1)) / 2
        truth[k] = np.exp(-((np.pi * blur_px * scale / pitch_px) ** 2)) * total
    return truth


def test_board_to_one_per_cent(tmp_path: Path) -> None:
    found = calibrated(
        BoardCalibration(), tmp_path, camera_px=(48, 48), projector_px=(144, 192), blur_px=1.0
    )
    pitches = found.profile.column("contrast", "pitch_px")
    truth = board_truth(pitches, 1.0)
    measured = np.stack(
        [found.profile.column("contrast", f"modulation_{c}") for c in ("red", "green", "blue")],
        axis=-1,
    )
    assert np.abs(measured - truth).max() < 0.01
    assert 6 < value(found, "finest_px") < 12


SMALL = {"camera_px": (48, 48), "projector_px": (144, 192)}
PITCHES_PX = (4, 8, 12, 16, 24, 32)
TWO_POSITIONS = [
    Pattern(family, pitch_px, k * pitch_px * family.varies_down, k * pitch_px * family.varies_right)
    for family in (Family.STRIPES_ROWS, Family.STRIPES_COLUMNS)
    for pitch_px in PITCHES_PX
    for k in (0, 1)
]
AS_A_SCENE = [
    Pattern(Family.CHECKER, pitch_px, *shift)
    for pitch_px in PITCHES_PX
    for shift in shift_grid(pitch_px, (6, 6))
]


@pytest.mark.parametrize(
    ("patterns", "within"),
    [
        # Which places in the stripes 48 pixels happen to see is some percent of a period.
        pytest.param(TWO_POSITIONS, 0.03, id="stripes in two positions"),
        pytest.param(AS_A_SCENE, 0.01, id="the plan of a scene"),
    ],
)
def test_a_board_that_was_captured_with_another_plan(
    tmp_path: Path, patterns: list[Pattern], within: float
) -> None:
    bench = simulated_bench(SIM.model_copy(update={**SMALL, "blur_px": 1.0}))
    plan = Plan(patterns=(WHITE, BLACK, *patterns))
    session, _ = record(plan, bench, tmp_path / "s", Notes(), Notes().stop)
    finding = BoardCalibration().fit([session], lambda: None)
    columns = finding.curves["contrast"].columns
    pitches = np.array(columns["pitch_px"], np.float64)
    assert list(pitches) == list(PITCHES_PX)
    measured = np.array([columns[f"modulation_{c}"] for c in ("red", "green", "blue")], np.float64)
    assert np.abs(measured.T - board_truth(pitches, 1.0)).max() < within


def test_a_board_without_complements_is_refused(tmp_path: Path) -> None:
    bench = simulated_bench(SIM.model_copy(update=SMALL))
    plan = Plan(patterns=(WHITE, BLACK, *TWO_POSITIONS[::2]))
    session, _ = record(plan, bench, tmp_path / "s", Notes(), Notes().stop)
    with pytest.raises(ProfileError, match="no two pitches of checkers or stripes with their comp"):
        BoardCalibration().fit([session], lambda: None)


def test_geometry_finds_the_projector_pixel_of_every_camera_pixel(tmp_path: Path) -> None:
    found = calibrated(GeometryCalibration(), tmp_path, scene="corner", camera_px=(48, 48))
    truth = build(SimulationConfig("corner", 0, (48, 48), (120, 160))).projector_coordinates()
    column, row = (found.finding.maps[name] for name in ("column", "row"))
    off = np.hypot(column - truth[..., 1], row - truth[..., 0])
    # A camera pixel is 2.2 projector pixels wide. What it sees is weighted by what reflects in it,
    # so that its middle is found to a tenth of itself typically, and to half of itself always.
    assert np.nanmedian(off) < 0.22
    assert np.nanmax(off) < 1.1
    assert value(found, "decoded")[0] > 0.95
    down, right = np.gradient(truth, axis=0), np.gradient(truth, axis=1)
    area = np.abs(down[..., 0] * right[..., 1] - down[..., 1] * right[..., 0])
    assert value(found, "camera_px_per_projector_px") == pytest.approx(
        [1 / np.median(area)], rel=0.03
    )
    page = write_page(tmp_path / "profile.json", found, GeometryCalibration().purpose).read_text()
    assert "projector column" in page


def test_poses_of_a_chessboard_tell_the_lenses(tmp_path: Path) -> None:
    """Focal lengths within 4 of their stated errors; reprojection as the requirement has it."""
    sessions = []
    for number in (2, 3, 4, 5):
        board = {"scene": f"chessboard-{number}", "camera_px": (96, 128)}
        large = {**board, "projector_px": (216, 288), "gamma": 1.0, "black_level": 0.0}
        bench = simulated_bench(SIM.model_copy(update=large))
        setting = Setting(CameraPlan(), ProjectorPlan(), bench.resolution)
        with ProgressDisplay(quiet=True) as progress:
            folder = tmp_path / str(number)
            one = GeometryCalibration()
            sessions += capture_all(one, setting, bench, folder, progress, Notes().stop)[0]
    found = GeometryCalibration(board=Chessboard(7, 5, 0.07)).fit(sessions, lambda: None)
    assert (found.quantities["reprojection_px"].value[0] or 1) < 0.3
    for name, focal_px in (("camera", 128 / 0.6), ("projector", 216 / (1.125 * 0.6))):
        focal = found.quantities[f"{name}_focal_px"]
        off = np.array(focal.value, float) - focal_px
        assert np.all(np.abs(off) < 4 * np.array(focal.uncertainty, float))


@pytest.mark.parametrize(
    ("calibration", "camera", "changes", "message"),
    [
        pytest.param(LeakCalibration(), CameraPlan(exposure_s=10), {}, "saturated", id="saturated"),
        pytest.param(
            LeakCalibration(), CameraPlan(exposure_s=1e-4), {}, "far too short", id="too dark"
        ),
        pytest.param(LeakCalibration(), None, {"latency_s": 0.15}, "settle_s", id="not settled"),
        pytest.param(DarkCalibration(), None, {"ambient": 0.2}, "cap on the lens", id="lit dark"),
        pytest.param(
            NoiseCalibration(),
            None,
            {"full_well_e": None, "read_noise_e": 0.0},
            "no shot noise",
            id="no noise",
        ),
        pytest.param(
            LatencyCalibration(exposure_s=0.2), None, {"latency_s": 0.4}, "longer", id="too late"
        ),
        pytest.param(
            GeometryCalibration(board=Chessboard(9, 6, 0.025)),
            None,
            {},
            "no board of 9",
            id="no board",
        ),
        pytest.param(BoardCalibration(), None, {"blur_px": 12}, "focus", id="out of focus"),
    ],
)
def test_refused_with_nothing_written(
    tmp_path: Path,
    calibration: Calibration,
    camera: CameraPlan | None,
    changes: dict[str, object],
    message: str,
) -> None:
    with pytest.raises(ProfileError, match=message):
        calibrated(calibration, tmp_path, camera, **changes)
    assert not (tmp_path / "profile.json").exists()


def test_a_recorded_session_gives_the_same_profile_and_a_page(tmp_path: Path) -> None:
    first = calibrated(LeakCalibration(), tmp_path)
    before = (tmp_path / "profile.json").read_bytes()
    with ProgressDisplay(quiet=True) as progress:
        again = calibrate(
            LeakCalibration(),
            recorded_sessions(tmp_path / "frames"),
            tmp_path / "profile.json",
            progress,
        )
    assert again.profile == first.profile
    assert (tmp_path / "profile.json").read_bytes() == before
    page = write_page(tmp_path / "profile.json", again, LeakCalibration().purpose).read_text()
    assert "fraction of white" in page
    assert "://" not in page


def test_a_profile_of_other_devices_or_settings_is_refused(tmp_path: Path) -> None:
    found = calibrated(DarkCalibration(), tmp_path, black_level=0.0)
    bench = found.profile.bench
    check_applies(found.profile, "it", bench, CameraPlan())
    with pytest.raises(ProfileError, match=r"exposure_s = 0\.1, the session has 0.5"):
        check_applies(found.profile, "it", bench, CameraPlan(exposure_s=0.5))
    other = json.loads(json.dumps(bench))
    other["sim"]["camera_px"] = [48, 48]
    with pytest.raises(ProfileError, match="another bench"):
        check_applies(found.profile, "it", other, CameraPlan())
    other["sim"] = {**bench["sim"], "scene": "corner", "seed": 9}  # type: ignore[dict-item]
    check_applies(found.profile, "it", other, CameraPlan())


def test_a_damaged_profile_is_refused(tmp_path: Path) -> None:
    calibrated(LeakCalibration(), tmp_path)
    path = tmp_path / "profile.json"
    profile, _ = read_profile(path)
    path.with_suffix(".npz").write_bytes(b"other")
    with pytest.raises(ProfileError, match="is not the file"):
        read_maps(path, profile)
    path.write_text(path.read_text().replace('"kind"', '"sort"'))
    with pytest.raises(ProfileError, match="no profile that can be used"):
        read_profile(path)
