"""Ranges from direct images alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from processing.frames.separation import ExtremaSeparation
from processing.metrics import relative_error
from processing.patterns import Family, Pattern
from processing.ranges.extrema import decompose_extrema, raised_by_noise
from tests.processing.light import PITCHES_PX, Scene, checkers, slanted

SHAPE = (40, 48)
EVERYWHERE = np.ones(SHAPE, bool)
CHECKERS = [Family.CHECKER] * len(PITCHES_PX)


def scene() -> Scene:
    ones = np.ones((*SHAPE, 3)) * np.array([1.0, 0.7, 0.4])
    return Scene(slanted(SHAPE), {0.0: 0.5 * ones, 32.0: 0.1 * ones, np.inf: 0.2 * ones}, 0.5)


def test_direct_light_is_what_is_left_at_range_zero() -> None:
    """Better than the finest direct image, which holds a part of what came from 32 px."""
    light = scene()
    white = light.frame(Pattern(Family.WHITE))
    rng = np.random.default_rng(0)
    rows = []
    for pitch_px in PITCHES_PX:
        extrema = ExtremaSeparation(white.shape)
        for pattern in checkers([pitch_px]):
            noise = rng.normal(0, 1e-3, white.shape)
            extrema.add((light.frame(pattern) + noise).astype(np.float32))
        rows.append(extrema.separate(white).direct_light)
    found = decompose_extrema(rows, PITCHES_PX, CHECKERS, white, EVERYWHERE)
    assert found.names == ("direct", "interreflection")
    truth = light.parts[0.0].astype(np.float32)
    assert relative_error(found.components[0], truth, EVERYWHERE) < 0.03
    assert relative_error(found.components[1], white - truth, EVERYWHERE) < 0.05
    np.testing.assert_allclose(found.components.sum(axis=0), white, atol=1e-6)


def test_what_shot_noise_adds_to_extremes_is_taken_off() -> None:
    """A full well of 20 000 electrons, as `benchmarks` has it: the bias is 5 % of direct light."""
    light, rng = scene(), np.random.default_rng(1)
    white = light.frame(Pattern(Family.WHITE))
    rows, raised = [], []
    for pitch_px in PITCHES_PX:
        frames = np.stack([light.frame(pattern) for pattern in checkers([pitch_px])])
        frames = (rng.poisson(frames * 20_000) / 20_000).astype(np.float32)
        largest, smallest = frames.max(axis=0), frames.min(axis=0)
        rows.append(2 * np.maximum(largest, white - smallest) - white)
        raised.append(raised_by_noise(*(one.reshape(-1, 3) for one in (largest, smallest, white))))
    truth = light.parts[0.0].astype(np.float32)
    told, untold = (
        decompose_extrema(rows, PITCHES_PX, CHECKERS, white, EVERYWHERE, one)
        for one in (np.stack(raised), None)
    )
    errors = [relative_error(one.components[0], truth, EVERYWHERE) for one in (told, untold)]
    assert errors[0] < 0.5 * errors[1]
    covered = [np.mean(np.abs(o.components[0] - truth) <= o.deviations[0]) for o in (told, untold)]
    assert covered[0] > 0.6 > covered[1]


def test_without_noise_extremes_add_up_to_white() -> None:
    light = scene()
    white = light.frame(Pattern(Family.WHITE)).reshape(-1, 3)
    frames = np.stack([light.frame(pattern) for pattern in checkers([24])]).reshape(36, -1, 3)
    raised = raised_by_noise(frames.max(axis=0), frames.min(axis=0), white)
    np.testing.assert_allclose(raised, 0, atol=1e-3)


def test_a_camera_out_of_focus_is_no_translucent_object() -> None:
    """Opaque waves: half of their light passed for subsurface scattering with one blur for all."""
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    places = slanted(SHAPE) + 8 * np.sin(down / 5) * np.sin(right / 6)
    light = Scene(places, {0.0: np.full((*SHAPE, 3), 0.7), np.inf: np.full((*SHAPE, 3), 0.1)}, 0.5)

    def seen(pattern: Pattern) -> NDArray[np.float32]:
        sharp = light.frame(pattern)
        return np.asarray(ndimage.gaussian_filter(sharp, (1, 1, 0)), np.float32)

    white = seen(Pattern(Family.WHITE))
    rows = []
    for pitch_px in PITCHES_PX:
        frames = np.stack([seen(pattern) for pattern in checkers([pitch_px])])
        rows.append(frames.max(axis=0) - frames.min(axis=0))
    found = decompose_extrema(rows, PITCHES_PX, CHECKERS, white, EVERYWHERE)
    assert any("not equally sharp" in warning.what for warning in found.warnings)
    assert found.names == ("direct", "interreflection")
    truth = ndimage.gaussian_filter(light.parts[0.0], (1, 1, 0)).astype(np.float32)
    assert relative_error(found.components[0], truth, EVERYWHERE) < 0.1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        pytest.param({"pitch_px": [8.0]}, "11 rows.* 1 pitches", id="pitches"),
        pytest.param({"white": np.ones((4, 5, 3), "f4")}, r"\(4, 5, 3\)", id="white"),
        pytest.param({"mask": np.ones((4, 5), bool)}, r"\(4, 5\).*\(40, 48, 3\)", id="mask"),
        pytest.param({"mask": np.zeros(SHAPE, bool)}, "no usable pixel", id="all-masked"),
    ],
)
def test_what_does_not_belong_together_is_refused(change: dict[str, Any], said: str) -> None:
    arguments: dict[str, Any] = {
        "rows": np.ones((len(PITCHES_PX), *SHAPE, 3), np.float32),
        "pitch_px": PITCHES_PX,
        "families": CHECKERS,
        "white": np.ones((*SHAPE, 3), np.float32),
        "mask": EVERYWHERE,
    }
    with pytest.raises(ValueError, match=said):
        decompose_extrema(**(arguments | change))
