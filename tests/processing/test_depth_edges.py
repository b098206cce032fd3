"""Pixels across a depth edge, whose two places are known."""

from __future__ import annotations

import numpy as np

from processing.frames.gathering import HarmonicsStack
from processing.patterns import Family, Pattern
from processing.ranges.decomposition import decompose_ranges
from tests.processing.light import PROJECTOR_PX, Scene, checkers, slanted

SHAPE = (24, 32)
EDGE = 16


def gathered(scenes: list[Scene]) -> HarmonicsStack:
    """Frames of scenes one over the other, 0.3 % noise."""
    rng = np.random.default_rng(3)
    patterns = checkers()
    stack = HarmonicsStack(patterns, (*SHAPE, 1), PROJECTOR_PX)
    for pattern in [Pattern(Family.WHITE), *patterns]:
        frame = np.sum([scene.frame(pattern) for scene in scenes], axis=0)
        stack.add((frame + rng.normal(0, 0.003, frame.shape)).astype(np.float32), pattern)
    return stack


def test_pixels_that_see_two_surfaces_have_the_direct_light_of_both() -> None:
    """One column is divided; a fifth of the light from everywhere."""
    share = np.zeros(SHAPE)
    share[:, :EDGE] = 1
    share[:, EDGE] = np.linspace(0.2, 0.8, SHAPE[0])
    near, far = slanted(SHAPE), slanted(SHAPE) + np.array([11.0, 47.0])[:, None, None]
    ones = np.ones((1, 1, 1))
    scenes = [
        Scene(places, {0.0: 0.4 * part[..., None] * ones, np.inf: 0.1 * part[..., None] * ones})
        for places, part in ((near, share), (far, 1 - share))
    ]
    found = decompose_ranges(gathered(scenes), np.ones(SHAPE, bool))
    assert found.names == ("direct", "interreflection")
    divided = found.components[0][:, EDGE, 0]
    # A single place gives them 0.2 to 0.35.
    assert np.mean(np.abs(divided - 0.4) < 0.02) > 0.8
    others = np.delete(found.components[0], EDGE, axis=1)
    np.testing.assert_allclose(others, 0.4, atol=0.02)


def test_a_rim_drawn_out_over_many_projector_pixels_keeps_half_of_its_direct_light() -> None:
    """One column, the rim of a round object, sees 13 projector pixels in place of 3."""
    near, far = slanted(SHAPE), slanted(SHAPE) + np.array([11.0, 47.0])[:, None, None]
    column = np.arange(SHAPE[1])
    drawn_out = [near + np.array([0.0, 3.0 * k])[:, None, None] for k in range(5)]
    parts = [
        (near, (column < EDGE) * 1.0),
        (far, (column > EDGE) * 1.0),
        *((places, (column == EDGE) / 5) for places in drawn_out),
    ]
    scenes = []
    for places, part in parts:
        light = np.broadcast_to(part, SHAPE)[..., None]
        scenes.append(Scene(places, {0.0: 0.4 * light, np.inf: 0.1 * light}))
    found = decompose_ranges(gathered(scenes), np.ones(SHAPE, bool))
    # Of 0.4; a single place gives 0.15.
    assert np.mean(found.components[0][:, EDGE, 0]) > 0.2
    others = np.delete(found.components[0], EDGE, axis=1)
    np.testing.assert_allclose(others, 0.4, atol=0.02)
