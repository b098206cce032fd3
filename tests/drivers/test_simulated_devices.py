from __future__ import annotations

import hashlib
import io
import os
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.errors import CameraTimeoutError, SettingsError
from drivers.protocols import CameraSettings, Raster, RawFrame
from drivers.raw import decode_raw
from drivers.sim.defects import Defects
from drivers.sim.devices import RunPosition, SimulatedBench, SimulationConfig, build
from processing.patterns import Pattern
from tests.raws import counts

PROJECTOR_PX = (72, 96)
EXPOSURE = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
STEP = 1 / (16383 - 512)
WHITE, BLACK = (
    Pattern.parse("white").raster(PROJECTOR_PX),
    Pattern.parse("black").raster(PROJECTOR_PX),
)
CHECKER = Pattern.parse("checker:16").raster(PROJECTOR_PX)


def bench(scene: str = "board", frames_in_run: int = 2, **defects: float) -> SimulatedBench:
    config = SimulationConfig(scene, 7, (24, 24), PROJECTOR_PX, Defects(**defects))
    return build(config, frames_in_run, settle_s=0.2)


def seen(
    on: SimulatedBench, raster: Raster, exposure: CameraSettings = EXPOSURE
) -> NDArray[np.float32]:
    on.projector.show(raster)
    return decode_raw(on.camera.capture(exposure).data).values


@pytest.mark.parametrize("scene", ["corner", "groove", "board"])
def test_the_truth_adds_up_to_white_minus_black_to_quantisation(scene: str) -> None:
    on = bench(scene, black_level=0.02, ambient=0.01)
    total = sum(on.truth().values())
    np.testing.assert_allclose(seen(on, WHITE) - seen(on, BLACK), total, atol=STEP)


def test_the_brightest_photosite_under_white_reaches_80_percent() -> None:
    assert seen(bench(), WHITE).max() == pytest.approx(0.8, abs=STEP)


@pytest.mark.parametrize(
    ("exposure", "expected"),
    [
        pytest.param(CameraSettings(0.05, 8.0, 200), 0.5, id="half-the-time"),
        pytest.param(CameraSettings(0.1, 16.0, 200), 0.25, id="two-stops-down"),
        pytest.param(CameraSettings(0.1, 8.0, 100), 0.5, id="half-the-speed"),
        pytest.param(CameraSettings(0.1, None, None), 1.0, id="nothing-else-to-set"),
    ],
)
def test_light_is_proportional_to_the_exposure(exposure: CameraSettings, expected: float) -> None:
    on = bench()
    np.testing.assert_allclose(seen(on, WHITE, exposure), expected * seen(on, WHITE), atol=STEP)


def test_too_much_light_saturates() -> None:
    on = bench()
    on.projector.show(WHITE)
    image = decode_raw(on.camera.capture(CameraSettings(0.4, 8.0, 200)).data)
    assert image.values.max() == 1
    assert image.saturated.any()
    assert not decode_raw(on.camera.capture(EXPOSURE).data).saturated.any()


def test_settings_out_of_range_are_refused_by_name() -> None:
    with pytest.raises(SettingsError, match="aperture"):
        bench().camera.capture(CameraSettings(0.1, 0.0, 200))


def test_gamma_bends_the_half_tones_alone() -> None:
    half = np.full(PROJECTOR_PX, 128, np.uint8)
    curved = bench(gamma=2.2)
    expected = (128 / 255) ** 2.2 * seen(bench(), WHITE)
    np.testing.assert_allclose(seen(curved, half), expected, atol=STEP)
    np.testing.assert_array_equal(seen(curved, WHITE), seen(bench(), WHITE))


def test_black_level_is_a_fraction_of_white() -> None:
    on = bench(black_level=0.1)
    np.testing.assert_allclose(seen(on, BLACK), 0.1 * seen(on, WHITE), atol=STEP)


def test_ambient_light_is_there_without_the_projector() -> None:
    np.testing.assert_allclose(seen(bench(ambient=0.05), BLACK), 0.05 * 0.8, atol=STEP)


def test_blur_has_the_stated_width() -> None:
    on = bench(blur_px=1.0)
    scale = on.stage.transport.projector_px_per_camera_px
    edge = np.zeros(PROJECTOR_PX, np.uint8)
    edge[:, 48:] = 255
    profile = on.stage.emitted(edge)[36]
    spread = np.diff(profile[24:72])
    place = np.arange(len(spread))
    centre = (spread * place).sum() / spread.sum()
    width = np.sqrt((spread * (place - centre) ** 2).sum() / spread.sum())
    assert width == pytest.approx(scale, rel=0.01)
    assert np.ptp(seen(on, CHECKER)) < np.ptp(seen(bench(), CHECKER))


@pytest.mark.parametrize(
    ("latency_s", "share_of_old"),
    # The exposure runs from 0.2 s to 0.3 s after the start of `show`.
    [(0.1, 0.0), (0.2, 0.0), (0.25, 0.5), (0.3, 1.0), (9.0, 1.0)],
)
def test_light_that_comes_late_is_mixed_with_the_light_before(
    latency_s: float, share_of_old: float
) -> None:
    on = bench(latency_s=latency_s)
    white = seen(bench(), WHITE)
    np.testing.assert_allclose(seen(on, WHITE), (1 - share_of_old) * white, atol=STEP)
    np.testing.assert_allclose(seen(on, BLACK), share_of_old * white, atol=STEP)


def test_late_shows_the_raster_before() -> None:
    on = bench(late=1.0)
    assert not seen(on, WHITE).any()
    np.testing.assert_array_equal(seen(on, CHECKER), seen(bench(), WHITE))


def test_dropped_shows_black() -> None:
    assert not seen(bench(dropped=1.0), WHITE).any()


def test_swapped_hands_the_last_file_over_again() -> None:
    on = bench(swapped=1.0)
    first = seen(on, WHITE)
    np.testing.assert_array_equal(seen(on, BLACK), first)


def test_a_camera_that_times_out_may_succeed_the_next_time() -> None:
    on = bench(timeouts=0.5)
    on.projector.show(WHITE)
    outcomes = [attempt(on) for _ in range(60)]
    frames = [frame for frame in outcomes if frame is not None]
    # Binomial, n = 60, p = ½: four standard deviations are 15.5.
    assert 14 < len(frames) < 46
    assert {counts(frame.data) for frame in frames} == {counts(frames[0].data)}


def attempt(on: SimulatedBench) -> RawFrame | None:
    try:
        return on.camera.capture(EXPOSURE)
    except CameraTimeoutError:
        return None


@pytest.mark.parametrize(("name", "of"), [("late", WHITE), ("dropped", BLACK)])
def test_defects_of_a_frame_come_as_often_as_they_should(name: str, of: Raster) -> None:
    on = bench("board", 200, **{name: 0.2})
    raster = BLACK if name == "late" else WHITE
    wrong = 0
    for _ in range(200):
        on.projector.show(WHITE if name == "late" else BLACK)
        on.projector.show(raster)
        image = decode_raw(on.camera.capture(EXPOSURE).data).values
        wrong += bool(image.any()) == bool(of.any())
    # Binomial, n = 200, p = 0.2: mean 40, four standard deviations are 22.6.
    assert 17 < wrong < 63


def test_the_lamp_drifts_linearly_over_the_run() -> None:
    on = bench(frames_in_run=3, drift=-0.2)
    white = seen(bench(), WHITE)
    for expected in (1.0, 0.9, 0.8):
        np.testing.assert_allclose(seen(on, WHITE), expected * white, atol=STEP)


def test_the_scene_moves_over_the_run() -> None:
    on = bench("corner", frames_in_run=3, move_px=2.0)
    start, middle, end = (seen(on, CHECKER) for _ in range(3))
    np.testing.assert_allclose(middle[:, 1:], start[:, :-1], atol=STEP)
    np.testing.assert_allclose(end[:, 2:], start[:, :-2], atol=STEP)


def test_flicker_has_its_amplitude_and_vanishes_over_whole_refreshes() -> None:
    short = CameraSettings(1 / 6000, 8.0, 51200)
    quiet = seen(bench(), WHITE, short).sum()
    on = bench(flicker=0.1)
    gains = np.array([seen(on, WHITE, short).sum() / quiet - 1 for _ in range(60)])
    assert 0.095 < gains.max() <= 0.1 + 1e-3
    assert -0.1 - 1e-3 <= gains.min() < -0.095
    whole = CameraSettings(6 / 60, 8.0, 200)
    np.testing.assert_allclose(seen(on, WHITE, whole), seen(bench(), WHITE, whole), atol=STEP)


def test_noise_follows_the_photon_transfer_curve() -> None:
    full_well_e, read_noise_e = 20_000.0, 12.0
    on = bench(frames_in_run=40, full_well_e=full_well_e, read_noise_e=read_noise_e)
    for raster in (WHITE, BLACK):
        stack = np.stack([seen(on, raster)[..., 0] for _ in range(40)])
        mean = seen(bench(), raster)[..., 0]
        expected = mean / full_well_e + (read_noise_e / full_well_e) ** 2 + STEP**2 / 12
        ratio = stack.var(axis=0, ddof=1) / expected
        # χ² with 39 degrees of freedom over 576 pixels: four standard errors of the mean.
        assert abs(ratio.mean() - 1) < 4 * np.sqrt(2 / 39 / ratio.size)
        error = np.sqrt(expected / 40)
        assert abs(((stack.mean(axis=0) - mean) / error).mean()) < 4 / np.sqrt(mean.size)


def rasters() -> Iterator[Raster]:
    for number in range(8):
        yield Pattern.parse(f"checker:8:{number},0").raster(PROJECTOR_PX)


EVERYTHING = {
    "late": 0.3,
    "dropped": 0.2,
    "swapped": 0.3,
    "timeouts": 0.3,
    "latency_s": 0.25,
    "full_well_e": 20_000.0,
    "read_noise_e": 5.0,
    "drift": -0.1,
    "flicker": 0.1,
    "ambient": 0.01,
    "move_px": 0.5,
    "blur_px": 0.5,
    "gamma": 2.2,
    "black_level": 0.01,
    "shade": 0.3,
    "slip_px": 3.0,
    "zoom": 1.2,
    "iso_turned": 400.0,
}


def run(on: SimulatedBench, steps: list[Raster]) -> list[RawFrame]:
    frames = []
    for raster in steps:
        on.projector.show(raster)
        frame = attempt(on)
        while frame is None:
            frame = attempt(on)
        frames.append(frame)
    return frames


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    stop=st.integers(0, 7),
    names=st.sets(st.sampled_from([name for name in EVERYTHING if name != "read_noise_e"])),
)
def test_a_run_goes_on_anywhere_as_if_it_had_not_stopped(
    seed: int, stop: int, names: set[str]
) -> None:
    defects = Defects(**{name: EVERYTHING[name] for name in names})
    config = SimulationConfig("board", seed, (12, 14), PROJECTOR_PX, defects)
    steps = list(rasters())
    whole = run(build(config, len(steps), settle_s=0.2), steps)
    position = RunPosition()
    if stop:
        last = whole[stop - 1]
        position = RunPosition(stop, last.finished_s, steps[stop - 1], last.data)
    rest = run(build(config, len(steps), settle_s=0.2, position=position), steps[stop:])
    assert rest == whole[stop:]


def test_a_run_with_swapped_files_does_not_go_on_without_the_last_one() -> None:
    config = SimulationConfig("board", 0, (12, 14), PROJECTOR_PX, Defects(swapped=0.1))
    with pytest.raises(ValueError, match="delivered last"):
        build(config, 8, position=RunPosition(1, 0.0, WHITE))


def test_seeds_differ_and_repeat() -> None:
    def noisy(seed: int) -> bytes:
        config = SimulationConfig(
            "board", seed, (12, 14), PROJECTOR_PX, Defects(full_well_e=20_000.0)
        )
        return run(build(config), [WHITE])[0].data

    assert noisy(1) == noisy(1)
    assert noisy(1) != noisy(2)


DIGEST = """
import hashlib
from drivers.protocols import CameraSettings
from drivers.sim.devices import SimulationConfig, build
from processing.patterns import Pattern
bench = build(SimulationConfig("corner", 1, (24, 24), (72, 96)))
bench.projector.show(Pattern.parse("checker:16").raster((72, 96)))
print(hashlib.sha256(bench.camera.capture(CameraSettings(0.1, 8.0, 200)).data).hexdigest())
"""


def test_the_bytes_do_not_depend_on_the_number_of_threads() -> None:
    config = SimulationConfig("corner", 1, (24, 24), PROJECTOR_PX)
    here = hashlib.sha256(run(build(config), [CHECKER])[0].data).hexdigest()
    four_threads = {"OPENBLAS_NUM_THREADS": "4"}
    there = subprocess.run(
        [sys.executable, "-c", DIGEST],
        env={**os.environ, **four_threads},
        check=True,
        capture_output=True,
        text=True,
    )
    assert there.stdout.strip() == here


@pytest.mark.parametrize(
    ("settings_of_it", "named"),
    [
        pytest.param({"scene": "kitchen"}, "corner, groove, board", id="scene"),
        pytest.param({"camera_px": (1, 10)}, "camera_px", id="camera"),
        pytest.param({"projector_px": (10, 10_000)}, "projector_px", id="projector"),
        pytest.param({"seed": -1}, "seed", id="seed"),
    ],
)
def test_what_cannot_be_simulated_is_refused_by_name(
    settings_of_it: dict[str, object], named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        SimulationConfig(**settings_of_it)  # type: ignore[arg-type]


def test_looking_does_not_change_what_is_captured() -> None:
    noisy = {"full_well_e": 20000.0, "read_noise_e": 5.0, "late": 0.5, "drift": 0.1}
    looked, straight = (bench("board", 3, **noisy) for _ in range(2))
    frames = []
    for on in (looked, straight):
        for raster in (WHITE, CHECKER, BLACK):
            on.projector.show(raster)
            if on is looked:
                view = on.camera.live_view()
                assert next(view) != next(view)
                view.close()
            frames.append(counts(on.camera.capture(EXPOSURE).data))
    assert frames[:3] == frames[3:]


def test_live_view_shows_the_raster_at_the_settings() -> None:
    on = bench()
    on.projector.show(CHECKER)
    expected = decode_raw(on.camera.capture(EXPOSURE).data).values
    half = CameraSettings(0.05, 8.0, 200)
    live = decode_raw(next(on.camera.live_view(half))).values
    np.testing.assert_allclose(live, expected / 2, atol=STEP)
    assert on.camera.read_back() == half


def test_in_real_time_waiting_takes_its_time_and_files_are_the_same() -> None:
    config = SimulationConfig("board", 7, (24, 24), PROJECTOR_PX)
    quick, paced = build(config), build(config, real_time=True)
    before_s = time.monotonic()
    frames = [on.camera.capture(EXPOSURE) for on in (paced, quick)]
    assert time.monotonic() - before_s >= EXPOSURE.exposure_s
    assert frames[0] == frames[1]


def test_files_tell_when_they_were_exposed_by_the_cameras_clock() -> None:
    on = bench()
    on.camera.ahead_s = 1.25
    told = []
    for _ in range(2):
        file = tifffile.TiffFile(io.BytesIO(on.camera.capture(EXPOSURE).data))
        told.append([file.pages.first.tags[code].value for code in (306, 36867, 37521)])
    # Simulated runs begin with 2026; a frame takes 0.1 s and 0.05 s to be delivered.
    second = "2026:01:01 00:00:01"
    assert told == [[second, second, "25"], [second, second, "40"]]
