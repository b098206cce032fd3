from __future__ import annotations

import numpy as np
import pytest

from calibration.contrast import CheckerContrast, fit_contrast
from calibration.errors import UnsupportedError
from calibration.exposure import advise, signal_rate
from calibration.projector import white_excess
from calibration.response import fit_response
from calibration.timing import fit_latency

LEVELS = np.round(np.linspace(0, 255, 33)).astype(np.int64)


def curve(level: np.ndarray) -> np.ndarray:
    """A response that is no power: an S, flat above 230."""
    told = np.clip(level / 230, 0, 1)
    return np.asarray(told**2 * (3 - 2 * told))


@pytest.mark.parametrize(
    "response",
    [
        pytest.param(lambda level: (level / 255) ** 2.2, id="power"),
        pytest.param(curve, id="s with a flat top"),
        pytest.param(lambda level: level / 255, id="straight"),
    ],
)
def test_any_rising_curve_is_recovered(response) -> None:  # type: ignore[no-untyped-def]
    noise = np.random.default_rng(4).normal(0, 2e-4, len(LEVELS))
    found = fit_response(LEVELS, 0.02 + 0.7 * response(LEVELS) + noise, 2e-4)
    # Half a per cent of white, as asked for.
    assert np.abs(found.light - response(np.arange(256))).max() < 0.005
    assert np.all(np.diff(found.light) >= 0)


def test_saturation_and_gamma_are_named() -> None:
    assert abs(fit_response(LEVELS, curve(LEVELS), 1e-5).saturated_from - 230) <= 16
    found = fit_response(LEVELS, (LEVELS / 255) ** 2.2, 1e-5)
    assert found.gamma == pytest.approx(2.2, abs=0.01)
    assert found.power_misfit < 1e-3


@pytest.mark.parametrize(
    ("light", "message"),
    [
        pytest.param(np.zeros(33), "hardly brighter", id="lamp off"),
        pytest.param(np.sin(LEVELS / 255 * 2.2), "falls by", id="falls"),
    ],
)
def test_ramps_that_are_no_response(light: np.ndarray, message: str) -> None:
    with pytest.raises(UnsupportedError, match=message):
        fit_response(LEVELS, light, 1e-4)


def test_a_delay_is_read_off_the_share_of_old_light() -> None:
    rising = np.array([True, False, True])
    delays = np.array([0.1, 0.12, 0.14])
    share = delays / 0.5
    changing = np.where(rising, 0.8 - 0.75 * share, 0.05 + 0.75 * share)
    found = fit_latency(changing, rising, 0.05, 0.8, 0.5)
    assert found.delays_s == pytest.approx(delays, abs=1e-12)
    assert found.longest_s == pytest.approx(0.14)


@pytest.mark.parametrize(
    ("changing", "white", "message"),
    [
        pytest.param([0.05, 0.8], 0.8, "fills the whole exposure", id="later than the exposure"),
        pytest.param([0.9, 0.05], 0.8, "outside black and white", id="brighter than white"),
        pytest.param([0.05, 0.05], 0.06, "brighter than black", id="no contrast"),
    ],
)
def test_delays_that_cannot_be_told(changing: list[float], white: float, message: str) -> None:
    with pytest.raises(UnsupportedError, match=message):
        fit_latency(np.array(changing), np.array([True, False]), 0.05, white, 0.5)


def test_the_exposure_is_a_whole_number_of_refreshes() -> None:
    rate = signal_rate(np.array([0.4, 0.5, 0.1]), np.zeros(3), 0.05)
    found = advise(rate, np.zeros(3), 0.8, 60.0, 0.0)
    assert found.refreshes == 4
    assert found.exposure_s == pytest.approx(4 / 60)
    assert found.expected_signal.max() <= 0.8
    assert found.colours_s == pytest.approx([0.1, 0.08, 0.4])
    with pytest.raises(UnsupportedError, match="before one refresh"):
        advise(rate * 100, np.zeros(3), 0.8, 60.0, 0.0)
    with pytest.raises(UnsupportedError, match="no light"):
        signal_rate(np.zeros(3), np.zeros(3), 0.05)


def blurred_checker(pitch_px: int, deviation_px: float) -> tuple[CheckerContrast, np.ndarray]:
    """A checker blurred by a Gaussian: all harmonics, at places that fall anywhere."""
    rng = np.random.default_rng(pitch_px)
    y, x = rng.uniform(0, 2 * pitch_px, (2, 40, 40))
    white = rng.uniform(0.3, 1, (40, 40, 3)).astype(np.float32)
    contrast = CheckerContrast(pitch_px, (40, 40, 3))

    def wave(place: np.ndarray) -> np.ndarray:
        total = np.zeros_like(place)
        for m in range(1, 40, 2):
            faded = np.exp(-0.5 * (np.pi * m * deviation_px / pitch_px) ** 2)
            total += 4 / (np.pi * m) * faded * np.sin(np.pi * m * place / pitch_px)
        return total

    for down in range(8):
        for right in range(4):
            shift = (2 * pitch_px * down // 8, pitch_px * right // 4)
            code = 0.5 * (1 + wave(y + shift[0]) * wave(x + shift[1]))
            contrast.add((code[..., np.newaxis] * white).astype(np.float32), shift)
    return contrast, white


@pytest.mark.parametrize("deviation_px", [1.0, 2.5])
def test_modulation_of_a_blurred_checker_is_the_gaussians(deviation_px: float) -> None:
    pitches = np.array([4.0, 8.0, 16.0, 32.0])
    everywhere = np.ones((40, 40), bool)
    measured, extremes = [], []
    for pitch_px in pitches:
        contrast, white = blurred_checker(int(pitch_px), deviation_px)
        measured.append(contrast.modulation(white, everywhere))
        extremes.append(contrast.extremes(white, everywhere))
    truth = np.exp(-((np.pi * deviation_px / pitches) ** 2))
    found = fit_contrast(pitches, np.array(measured), np.array(extremes))
    # 1 % of white, as asked for.
    assert np.abs(found.modulation - truth[:, np.newaxis, np.newaxis]).max() < 0.01
    assert found.side_px2 == pytest.approx([deviation_px**2] * 3, rel=0.03)


@pytest.mark.parametrize(
    ("modulation", "message"),
    [
        pytest.param([0.5, 1.1], "of the contrast that there is", id="too much"),
        pytest.param([0.1, 0.4], "keeps only", id="scatters"),
    ],
)
def test_boards_that_are_none(modulation: list[float], message: str) -> None:
    curve_ = np.repeat(np.array(modulation), 6).reshape(2, 2, 3)
    with pytest.raises(UnsupportedError, match=message):
        fit_contrast(np.array([8.0, 32.0]), curve_, np.ones((2, 3)))


def test_a_white_segment_is_what_white_has_over_its_primaries() -> None:
    # Overlapping camera channels, as every camera has.
    primaries = np.array([[0.3, 0.05, 0.01], [0.04, 0.5, 0.06], [0.0, 0.03, 0.25]])
    assert white_excess(primaries.sum(axis=0), primaries) == pytest.approx(0, abs=1e-12)
    segment = 0.3 * primaries.sum(axis=0)
    assert white_excess(primaries.sum(axis=0) + segment, primaries) == pytest.approx(0.3)
    with pytest.raises(ValueError, match=r"\(2,\) does not fit"):
        white_excess(np.ones(2), primaries)
