"""Pixels across a depth edge, whose two places are known."""

from __future__ import annotations

import numpy as np

from processing.frames.gathering import HarmonicsStack
from processing.patterns import Family, Pattern
from processing.ranges.decomposition import decompose_ranges
from tests.processing.light import PROJECTOR_PX, Scene, checkers, slanted

SHAPE = (24, 32)
EDGE = 16


def test_pixels_that_see_two_surfaces_have_the_direct_light_of_both() -> None:
    """One column is divided; 0.3 % noise, a fifth of the light from everywhere."""
    share = np.zeros(SHAPE)
    share[:, :EDGE] = 1
    share[:, EDGE] = np.linspace(0.2, 0.8, SHAPE[0])
    near, far = slanted(SHAPE), slanted(SHAPE) + np.array([11.0, 47.0])[:, None, None]
    ones = np.ones((1, 1, 1))
    scenes = [
        Scene(places, {0.0: 0.4 * part[..., None] * ones, np.inf: 0.1 * part[..., None] * ones})
        for places, part in ((near, share), (far, 1 - share))
    ]
    rng = np.random.default_rng(3)
    patterns = checkers()
    stack = HarmonicsStack(patterns, (*SHAPE, 1), PROJECTOR_PX)
    for pattern in [Pattern(Family.WHITE), *patterns]:
        frame = scenes[0].frame(pattern) + scenes[1].frame(pattern)
        stack.add((frame + rng.normal(0, 0.003, frame.shape)).astype(np.float32), pattern)
    found = decompose_ranges(stack, np.ones(SHAPE, bool))
    assert found.names == ("direct", "interreflection")
    divided = found.components[0][:, EDGE, 0]
    # A single place gives them 0.2 to 0.35.
    assert np.mean(np.abs(divided - 0.4) < 0.02) > 0.8
    others = np.delete(found.components[0], EDGE, axis=1)
    np.testing.assert_allclose(others, 0.4, atol=0.02)
