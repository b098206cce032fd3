from __future__ import annotations

import numpy as np
import pytest

from calibration.projector import measure_leak

RNG = np.random.default_rng(5)
SCENE = RNG.uniform(0.1, 1, (20, 30, 3)).astype(np.float32)
EVERYWHERE = np.ones((20, 30), bool)


@pytest.mark.parametrize("fraction", [0.0, 0.01, 0.2])
def test_leak_of_a_dark_room_is_exact(fraction: float) -> None:
    leak = measure_leak(SCENE, np.float32(fraction) * SCENE, EVERYWHERE)
    assert leak.fraction == pytest.approx(fraction, abs=1e-6)
    assert leak.spread == pytest.approx(0, abs=1e-6)


def test_room_light_shows_as_spread() -> None:
    leak = measure_leak(SCENE + 0.1, 0.01 * SCENE + 0.1, EVERYWHERE)
    assert leak.fraction > 0.01
    assert leak.spread > 0.05


def test_pixels_left_out_do_not_count() -> None:
    usable = EVERYWHERE.copy()
    usable[:, 15:] = False
    black = np.where(usable[..., np.newaxis], 0.02, 0.9).astype(np.float32) * SCENE
    assert measure_leak(SCENE, black, usable).fraction == pytest.approx(0.02, abs=1e-6)


@pytest.mark.parametrize(
    ("black", "usable", "message"),
    [
        pytest.param(SCENE[:5], EVERYWHERE, "must agree", id="shapes"),
        pytest.param(SCENE, ~EVERYWHERE, "no usable pixel", id="nothing usable"),
    ],
)
def test_bad_arguments(black: np.ndarray, usable: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measure_leak(SCENE, black, usable)
