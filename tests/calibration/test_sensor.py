from __future__ import annotations

import numpy as np
import pytest

from calibration.dark import DarkFrames
from calibration.errors import UnsupportedError
from calibration.photon_transfer import TransferPairs, fit_linearity, fit_noise_line

SHAPE = (40, 50, 3)


def dark_frames(count: int = 12, level: float = 0.001, noise: float = 5e-4) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    offsets = rng.normal(0, 2e-5, SHAPE)
    offsets[3, 4] += 0.02
    frames = level + offsets + rng.normal(0, noise, (count, *SHAPE))
    frames[:, 7, 8] += rng.normal(0, 0.02, (count, 3))
    return list(frames.astype(np.float32))


def test_level_noise_and_hot_pixels_are_found() -> None:
    frames = DarkFrames()
    for frame in dark_frames():
        frames.add(frame)
    found = frames.fit()
    # Four standard errors each: level of n pixels' median over 12 frames, noise of 2000 × 11.
    assert found.level == pytest.approx([0.001] * 3, abs=4 * 5e-4 / np.sqrt(12 * 2000) * 1.26)
    assert found.read_noise == pytest.approx([5e-4] * 3, rel=4 / np.sqrt(2 * 2000 * 11))
    assert np.argwhere(found.hot).tolist() == [[3, 4], [7, 8]]


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        pytest.param(dark_frames(3), "too few", id="three frames"),
        pytest.param(dark_frames(6, level=0.05), "cap on the lens", id="light"),
        pytest.param(
            [frame + 0.01 * (np.indices(SHAPE)[0] < 10) for frame in dark_frames(6)],
            "a picture",
            id="a lit part",
        ),
    ],
)
def test_what_is_not_dark_is_refused(frames: list[np.ndarray], message: str) -> None:
    collected = DarkFrames()
    for frame in frames:
        collected.add(frame.astype(np.float32))
    with pytest.raises(UnsupportedError, match=message):
        collected.fit()


def pairs(range_e: float, read_e: float, count: int = 4) -> TransferPairs:
    rng = np.random.default_rng(2)
    scene = rng.uniform(0, 0.9, (80, 90, 1)) * np.ones(3)
    collected = TransferPairs()
    for _ in range(count):
        both = (
            rng.poisson(scene * range_e, (2, *scene.shape))
            + rng.normal(0, read_e, (2, *scene.shape))
        ) / range_e
        first, second = both.astype(np.float32)
        collected.add(first, second, np.ones((80, 90), bool))
    return collected


@pytest.mark.parametrize(("range_e", "read_e"), [(20_000, 5), (100_000, 30), (3_000, 2)])
def test_electrons_and_read_noise_come_out_within_four_standard_errors(
    range_e: float, read_e: float
) -> None:
    for points in pairs(range_e, read_e).points():
        line = fit_noise_line(points)
        errors = np.sqrt(np.diag(line.covariance))
        assert abs(line.rise - 1 / range_e) < 4 * errors[1]
        assert abs(line.constant - (read_e / range_e) ** 2) < 4 * errors[0]
        assert errors[1] * range_e < 0.02
        assert line.reduced_chi_square < 2


def test_frames_without_shot_noise_are_refused() -> None:
    rng = np.random.default_rng(3)
    scene = rng.uniform(0, 0.9, (80, 90, 1)) * np.ones(3)
    collected = TransferPairs()
    for _ in range(3):
        first, second = scene + rng.normal(0, 1e-3, (2, *scene.shape))
        collected.add(first.astype(np.float32), second.astype(np.float32), np.ones((80, 90), bool))
    with pytest.raises(UnsupportedError, match="does not rise with the light"):
        fit_noise_line(collected.points()[0])


def test_a_camera_that_bends_is_linear_only_so_far() -> None:
    times = [0.1, 0.2, 0.4, 0.8]
    rates = np.linspace(0.1, 1.2, 400)
    light = np.array(times)[:, np.newaxis] * rates
    seen = np.where(light > 0.6, light - 0.2 * (light - 0.6), light)
    found = fit_linearity(times, seen, seen < 0.99)
    # 1 % is missed at light 0.6/0.95 = 0.632; a bin is 0.05 wide.
    assert found.linear_to == pytest.approx(0.632, abs=0.05)
    assert fit_linearity(times, light, light < 0.99).linear_to == pytest.approx(0.96, abs=0.03)
