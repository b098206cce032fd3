"""What a frame should show, against what the simulated bench does show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from acquire.cli.bench import setting_of
from acquire.page.comparison import compared, small
from acquire.page.darkroom import CLIPPED, Negative, negative
from acquire.page.session_tail import SessionTail
from acquire.page.session_view import SessionView
from acquire.profile_file import Profile, session_use, write_profile
from acquire.profile_use import plan_with_profiles
from acquire.proof.expectation import Expectation, Expected, Places, Small
from acquire.session import FrameRecord, Session
from drivers.sim.devices import SimulationConfig, build
from processing.patterns import Family, Pattern
from processing.proof.prediction import code_covariance, pattern_covariance
from tests.acquire.captures import captured, small_bench, small_plan

CAMERA_PX, PROJECTOR_PX = (32, 40), (96, 128)
# Rounding of three 14-bit files.
CODE = 3 / (16383 - 512)
PLAN = """[references]
every_frames = 20
[pattern]
pitch_px = [16]
shifts = [6, 6]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A board, which has only direct light, without noise."""
    folder = tmp_path_factory.mktemp("expectation") / "s"
    bench = small_bench(scene="board", camera_px=CAMERA_PX, projector_px=PROJECTOR_PX)
    captured(folder, small_plan(PLAN), bench)
    return folder


def expected(
    folder: Path,
    step: int,
    *,
    seen_as: int | None = None,
    places: Places | None = None,
    without: Family | None = None,
) -> tuple[Expected, Negative]:
    """As when `step` was the newest frame and, where given, had the picture of `seen_as`."""
    tail = SessionTail(folder)
    tail.follow()
    known = {
        number: record
        for number, record in tail.frames.items()
        if number <= step and record.pattern.family is not without
    }
    picture = tail.picture(tail.frames[step if seen_as is None else seen_as])
    plan = Session.open(folder).plan

    def develop(line: FrameRecord) -> Small:
        return small(tail.picture(line))

    expectation = Expectation(plan, PROJECTOR_PX, known, develop, places)
    return expectation.of(tail.frames[step], small(picture)), picture


def missed(found: Expected, picture: Negative) -> NDArray[np.float32]:
    assert found.prediction is not None
    return small(picture).values - found.prediction.values


def first_of(folder: Path, pattern: str) -> int:
    steps = (frame.step for frame in Session.open(folder).frames if str(frame.pattern) == pattern)
    return next(steps)


def test_with_its_complement_a_frame_is_predicted_exactly(folder: Path) -> None:
    step = first_of(folder, "checker:16:16,5")
    found, picture = expected(folder, step)
    assert "complement" in found.how
    assert found.holds == pytest.approx(1, abs=1e-4)
    assert np.abs(missed(found, picture)).max() <= CODE


def test_the_prediction_is_of_the_pattern_and_not_of_what_the_frame_shows(folder: Path) -> None:
    step = first_of(folder, "checker:16:16,5")
    right, truth = expected(folder, step)
    wrong, picture = expected(folder, step, seen_as=step - 1)
    assert right.prediction is not None
    assert wrong.prediction is not None
    np.testing.assert_array_equal(wrong.prediction.values, right.prediction.values)
    seen, true = compared(small(picture), wrong), compared(small(truth), right)
    assert seen.rms is not None
    assert true.rms is not None
    # A shift by a third of the pitch changes every third place between black and white.
    assert seen.rms > 0.2
    assert true.rms < 1e-3


@pytest.mark.parametrize("pattern", ["checker:16:0,2", "checker:16:0,13", "checker:16:10,13"])
def test_neighbours_hold_the_part_of_the_contrast_that_is_said(folder: Path, pattern: str) -> None:
    step = first_of(folder, pattern)
    found, picture = expected(folder, step)
    assert found.holds is not None
    assert 0.2 < found.holds < 0.99
    first = small(SessionTail(folder).picture(record(folder, 0))).values
    left = missed(found, picture) ** 2
    whole = (small(picture).values - first / 2) ** 2
    # The part is a mean over the projector; the camera sees some periods of it, blurred.
    assert left.mean() / whole.mean() == pytest.approx(1 - found.holds, abs=0.1)


def record(folder: Path, step: int) -> FrameRecord:
    return Session.open(folder).frames[step]


def test_the_first_of_a_pitch_has_only_its_raster(folder: Path) -> None:
    found, picture = expected(folder, first_of(folder, "checker:16:0,0"))
    assert found.prediction is None
    assert "only the raster" in found.how
    shown = compared(small(picture), found)
    assert (shown.prediction, shown.difference, shown.rms) == (b"", b"", None)


def test_with_a_geometry_the_first_of_a_pitch_is_drawn(folder: Path) -> None:
    bench = build(SimulationConfig("board", 3, CAMERA_PX, PROJECTOR_PX))
    row, column = np.moveaxis(bench.projector_coordinates().astype(np.float32), 2, 0)
    found, picture = expected(folder, first_of(folder, "checker:16:0,0"), places=(column, row))
    assert "geometry" in found.how
    assert found.white is not None
    # Beside the edges of checks, which a camera pixel's own size blurs, all light is direct.
    errors = np.abs(missed(found, picture)).mean(axis=2) / found.white
    assert np.median(errors) < 0.005
    assert errors.mean() < 0.15


def test_the_page_draws_with_the_profile_that_the_plan_names(folder: Path, tmp_path: Path) -> None:
    session = Session.open(folder)
    bench = build(SimulationConfig("board", 3, CAMERA_PX, PROJECTOR_PX))
    row, column = np.moveaxis(bench.projector_coordinates().astype(np.float32), 2, 0)
    profile = Profile(
        kind="geometry",
        measured="now",
        bench=session.record.bench,
        camera=session.plan.camera,
        projector=session.plan.projector,
        sessions=(session_use(session),),
        quantities={},
        versions={},
    )
    write_profile(tmp_path / "geometry.json", profile, {"column": column, "row": row})
    named = PLAN + '[calibration]\ngeometry = "geometry.json"\n'
    (tmp_path / "plan.toml").write_text(named)
    plan, files = plan_with_profiles(tmp_path / "plan.toml")
    bench_found = small_bench(scene="board", camera_px=CAMERA_PX, projector_px=PROJECTOR_PX)
    setting = setting_of(bench_found, plan, files)
    (tmp_path / "begun").mkdir()
    step = first_of(folder, "checker:16:0,0")
    lines = (folder / "frames.jsonl").read_bytes().splitlines(keepends=True)
    (tmp_path / "begun" / "frames.jsonl").write_bytes(b"".join(lines[: step + 1]))
    (tmp_path / "begun" / "frames").symlink_to(folder / "frames")
    frame = SessionView(tmp_path / "begun", setting).newest()
    assert frame is not None
    assert frame.about["step"] == step
    assert "geometry" in frame.comparison.how
    assert frame.comparison.rms is not None
    assert frame.comparison.rms < 0.2


def test_a_later_reference_should_be_like_the_first(folder: Path) -> None:
    last_white = max(
        frame.step for frame in Session.open(folder).frames if str(frame.pattern) == "white"
    )
    assert last_white > 0
    found, picture = expected(folder, last_white)
    assert "step 0" in found.how
    assert np.abs(missed(found, picture)).max() <= CODE
    assert expected(folder, 0)[0].prediction is None


def test_without_references_only_the_raster_is_known(folder: Path) -> None:
    step = first_of(folder, "checker:16:16,5")
    for family in (Family.WHITE, Family.BLACK):
        found, _ = expected(folder, step, without=family)
        assert found.prediction is None
        assert "no white and black" in found.how


def test_saturated_places_are_not_compared(folder: Path) -> None:
    step = first_of(folder, "checker:16:16,5")
    found, picture = expected(folder, step)
    picture.marks[3, 5] = CLIPPED
    picture.values[3, 5] = 100
    assert found.prediction is not None
    found.prediction.usable[7, 9] = False
    found.prediction.values[7, 9] = -100
    shown = compared(small(picture), found)
    assert shown.rms is not None
    assert shown.rms < 1e-3
    image = negative("image/png", shown.difference)
    grey = negative("image/png", compared(small(picture), found).prediction)
    assert image.values[3, 5] == pytest.approx(image.values[7, 9])
    assert len(set(grey.values[7, 9])) == 1


@pytest.mark.parametrize(
    "texts",
    [
        pytest.param(["checker:8:0,0", "checker:8:3,1", "checker:8:8,5"], id="checker"),
        pytest.param(["stripes-rows:8:0", "stripes-rows:8:3", "stripes-rows:8:8"], id="stripes"),
        pytest.param(["sinusoid-columns:8:0", "sinusoid-columns:8:5"], id="sinusoid"),
    ],
)
def test_the_covariance_is_that_of_the_codes(texts: list[str]) -> None:
    patterns = [Pattern.parse(text) for text in texts]
    found = pattern_covariance(patterns, (96, 128))
    codes = np.stack([pattern.code((16, 16)).ravel() for pattern in patterns])
    np.testing.assert_allclose(found, code_covariance(codes), atol=1e-12)
