"""Ranges from direct images alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from processing.frames.separation import ExtremaSeparation
from processing.metrics import relative_error
from processing.patterns import Family, Pattern
from processing.ranges.extrema import decompose_extrema
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
