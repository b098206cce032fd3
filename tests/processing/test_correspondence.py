"""Places decoded from the harmonics of known scenes."""

from __future__ import annotations

import numpy as np
import pytest

from processing.frames.gathering import HarmonicsStack
from processing.patterns import Family, Pattern
from processing.ranges.correspondence import decode
from processing.ranges.response import ResponseTables
from tests.processing.light import PROJECTOR_PX, Scene, checkers, slanted, waves

SHAPE = (24, 30)
BOTH_STRIPES = waves(Family.STRIPES_ROWS, 12) + waves(Family.STRIPES_COLUMNS, 12)
BOTH_WAVES = waves(Family.SINUSOID_ROWS, 4) + waves(Family.SINUSOID_COLUMNS, 4)


@pytest.mark.parametrize(
    ("patterns", "axes"),
    [
        pytest.param(checkers(), (0, 1), id="checkers"),
        pytest.param(BOTH_STRIPES, (0, 1), id="stripes-both-ways"),
        pytest.param(BOTH_WAVES, (0, 1), id="sinusoids-both-ways"),
        pytest.param(waves(Family.STRIPES_COLUMNS, 12), (1,), id="stripes-one-way"),
    ],
)
def test_places_are_found_to_a_tenth_of_a_pixel(
    patterns: list[Pattern], axes: tuple[int, ...]
) -> None:
    """With as much light from everywhere as is direct, half as much from near, and noise."""
    places = slanted(SHAPE)
    ones = np.ones((*SHAPE, 3))
    scene = Scene(places, {0.0: 0.4 * ones, 24.0: 0.2 * ones, np.inf: 0.4 * ones})
    rng = np.random.default_rng(0)
    stack = HarmonicsStack(patterns, ones.shape, PROJECTOR_PX)
    for pattern in patterns:
        noise = rng.normal(0, 0.003, ones.shape)
        stack.add((scene.frame(pattern) + noise).astype(np.float32), pattern)
    tables = [ResponseTables.of(stack.designs, [0.0], scene.blur_px**2)] * 3
    harmonics = stack.harmonics(stack.white(), slice(None)).reshape(len(stack.designs), 2, -1, 3)
    found = decode(harmonics, stack.designs, tables, PROJECTOR_PX)
    for axis in axes:
        expected = places[axis].reshape(-1, 1) + 0.5
        errors = np.abs(found.place_px[axis] - expected)
        assert np.median(errors) < 0.1
        assert np.max(errors) < 0.6
    assert np.min(found.coherence) > 0.9


def test_two_places_in_a_pixel_do_not_cohere() -> None:
    places = slanted(SHAPE)
    near = Scene(places, {0.0: 0.5 * np.ones((*SHAPE, 1))})
    far = Scene(places[::-1] + 37.0, {0.0: 0.5 * np.ones((*SHAPE, 1))})
    stack = HarmonicsStack(checkers(), (*SHAPE, 1), PROJECTOR_PX)
    for pattern in checkers():
        stack.add(near.frame(pattern) + far.frame(pattern), pattern)
    tables = [ResponseTables.of(stack.designs, [0.0], 0.64)]
    harmonics = stack.harmonics(stack.white(), slice(None)).reshape(len(stack.designs), 2, -1, 1)
    found = decode(harmonics, stack.designs, tables, PROJECTOR_PX)
    assert np.median(found.coherence) < 0.85


def test_pixels_that_see_nothing_mislead_none_beside_them() -> None:
    places = slanted(SHAPE)
    scene = Scene(places, {0.0: 0.4 * np.ones((*SHAPE, 3)), np.inf: 0.4 * np.ones((*SHAPE, 3))})
    stack = HarmonicsStack(checkers(), (*SHAPE, 3), PROJECTOR_PX)
    rng = np.random.default_rng(4)
    lost = rng.random(SHAPE) < 0.5
    for pattern in checkers():
        frame = scene.frame(pattern).astype(np.float32)
        frame[lost] = rng.random((np.count_nonzero(lost), 3), np.float32)
        stack.add(frame, pattern)
    tables = [ResponseTables.of(stack.designs, [0.0], scene.blur_px**2)] * 3
    harmonics = stack.harmonics(stack.white(), slice(None)).reshape(len(stack.designs), 2, -1, 3)
    found = decode(harmonics, stack.designs, tables, PROJECTOR_PX).place_px[:, ~lost.ravel()]
    expected = places[:, ~lost][..., np.newaxis] + 0.5
    assert np.max(np.abs(found - expected)) < 0.6
