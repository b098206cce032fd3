"""Contrast that blur leaves, against rasters that were blurred."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from processing.frames.optical_contrast import OpticalContrast
from processing.patterns import Family, Pattern, shift_grid

PITCHES = np.array([4.0, 8.0, 16.0, 32.0])


def optics(blur_px: float, departure: float = 1.0, error_px2: float = 0.0) -> OpticalContrast:
    side = np.array([blur_px**2])
    fitted = np.exp(-((np.pi / PITCHES[:, np.newaxis]) ** 2) * side)
    return OpticalContrast(side, np.array([error_px2]), PITCHES, departure * fitted)


def grid(family: Family, pitch_px: int, counts: tuple[int, int]) -> list[Pattern]:
    shifts = shift_grid(pitch_px, counts, (2, 1) if family is Family.CHECKER else (2, 2))
    return list(dict.fromkeys(Pattern(family, pitch_px, *shift) for shift in shifts))


@pytest.mark.parametrize("blur_px", [1.0, 2.5])
@pytest.mark.parametrize(
    "patterns",
    [
        pytest.param(grid(Family.CHECKER, 8, (6, 6)), id="checker"),
        pytest.param(grid(Family.STRIPES_ROWS, 8, (4, 1)), id="stripes"),
        pytest.param(grid(Family.SINUSOID_COLUMNS, 8, (1, 4)), id="sinusoid"),
    ],
)
def test_what_is_left_is_what_blurred_rasters_keep(patterns: list[Pattern], blur_px: float) -> None:
    """Rasters sample places at whole pixels: 16 a period, against 24 evenly spread ones."""
    codes = [gaussian_filter(one.code((96, 96)), blur_px, mode="wrap") for one in patterns]
    seen = np.ptp(codes, axis=0)
    if not patterns[0].family.is_binary:
        # The amplitude of a sinusoid; four shifts do not meet each place's extrema.
        phases = np.array([one.phase for one in patterns])
        waves = np.tensordot(np.exp(1j * phases), np.array(codes), 1)
        seen = 4 * np.abs(waves) / len(patterns)
    found = optics(blur_px).left(patterns, with_white=True)
    assert found[0] == pytest.approx(float(seen.mean()), abs=0.015)


def test_sharp_optics_leave_everything() -> None:
    contrast = optics(0.0)
    checkers = grid(Family.CHECKER, 12, (6, 6))
    assert contrast.left(checkers, with_white=True)[0] == pytest.approx(1)
    assert contrast.relative_error(checkers, with_white=True)[0] == pytest.approx(0, abs=1e-9)


def test_white_stands_in_for_complements() -> None:
    half = grid(Family.CHECKER, 8, (6, 6))[:18]
    whole = grid(Family.CHECKER, 8, (6, 6))
    contrast = optics(2.0)
    completed = contrast.left(half, with_white=True)
    assert completed == pytest.approx(contrast.left(whole, with_white=True))
    assert contrast.left(half, with_white=False)[0] < completed[0] - 0.02


def test_where_the_blur_is_no_gaussian_the_measurement_counts() -> None:
    checkers = grid(Family.CHECKER, 16, (6, 6))
    plain, departing = optics(3.0), optics(3.0, departure=0.9)
    ratio = departing.left(checkers, with_white=True) / plain.left(checkers, with_white=True)
    assert ratio[0] == pytest.approx(0.9)


def test_the_error_of_the_blur_is_in_the_error() -> None:
    sinusoids = grid(Family.SINUSOID_ROWS, 8, (4, 1))
    error = optics(2.0, error_px2=0.1).relative_error(sinusoids, with_white=True)
    assert error[0] == pytest.approx((np.pi / 8) ** 2 * 0.1)
