from __future__ import annotations

import numpy as np
import pytest

from processing.frames.soundness import additivity_error, direct_peak, resolved_pitches

RNG = np.random.default_rng(8)
WHITE = RNG.uniform(0.2, 1, (24, 32, 3)).astype(np.float32)
MASK = np.ones((24, 32), bool)


@pytest.mark.parametrize("gain", [0.9, 1.0, 1.08])
def test_a_gain_between_frames_and_white_is_the_additivity_error(gain: float) -> None:
    error = additivity_error(np.float32(gain / 2) * WHITE, WHITE, MASK)
    assert error == pytest.approx(gain - 1, abs=1e-6)


def test_pixels_outside_the_mask_do_not_count() -> None:
    mask = MASK.copy()
    mask[:, :20] = False
    mean = np.where(mask[..., np.newaxis], 0.5 * WHITE, 9).astype(np.float32)
    assert additivity_error(mean, WHITE, mask) == pytest.approx(0, abs=1e-6)
    assert np.isnan(additivity_error(mean, WHITE, ~MASK))


def test_the_peak_looks_at_the_most_direct_pixels() -> None:
    fraction = np.full((24, 32, 1), 0.3, np.float32)
    fraction[:3] = 0.9
    assert direct_peak(fraction * WHITE, WHITE, MASK) == pytest.approx(0.9, abs=1e-6)


@pytest.mark.parametrize(
    ("peaks", "resolved"),
    [
        pytest.param([0.93, 0.93, 0.94], (True, True, True), id="sharp"),
        pytest.param([0.48, 0.82, 0.92, 0.94], (False, False, True, True), id="blurred"),
        pytest.param([0.7], (True,), id="one pitch"),
        pytest.param([float("nan"), 0.9], (True, True), id="nothing measured"),
        pytest.param([float("nan")], (True,), id="nothing measured at all"),
    ],
)
def test_unresolved_pitches(peaks: list[float], resolved: tuple[bool, ...]) -> None:
    assert resolved_pitches(peaks) == resolved


def test_shapes_are_named() -> None:
    with pytest.raises(ValueError, match=r"\(24, 31, 3\)"):
        additivity_error(WHITE[:, :31], WHITE, MASK)
