"""The path tracer of the benchmarks against what is known of light."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.rendering import Rendered, render
from benchmarks.solids import BOX, SPHERE, Scenery, Solid, View
from processing.patterns import Family, Pattern, shift_grid

CAMERA = View((0.0, 0.0, 0.0), (0.0, 0.0, 3.0), 0.2, (8, 8))
PROJECTOR = View((0.3, 0.0, 0.0), (0.3, 0.0, 3.0), 0.6, (60, 60))
WALL = Solid(BOX, (0.0, 0.0, 4.0), (5.0, 5.0, 1.0), colours=((0.5, 0.4, 0.3),) * 2)
BALL = Solid(
    SPHERE, (0.0, 0.0, 2.5), (0.6, 0.6, 0.6), extinction=20.0, medium=(0.99, 0.95, 0.9), coat=0.3,
    is_matched=True,
)  # fmt: skip
CHECKERS = [Pattern(Family.CHECKER, 4, *shift) for shift in shift_grid(4, (2, 2))]


@pytest.fixture(scope="module")
def ball() -> Rendered:
    return render(Scenery([WALL, BALL], CAMERA, PROJECTOR), CHECKERS, 64)


def test_a_plain_wall_reflects_what_lambert_says() -> None:
    seen = render(Scenery([WALL], CAMERA, PROJECTOR), CHECKERS, 16)
    # Radiance albedo/π · cos θ/r² towards (0.3, 0, 0), at the middle of the wall, z = 3.
    square = 9 + 0.3**2
    expected = np.array([0.5, 0.4, 0.3]) / np.pi * 3 / square**1.5
    np.testing.assert_allclose(seen.truth["direct"][3:5, 3:5].mean((0, 1)), expected, rtol=0.01)
    assert not seen.truth["interreflection"].any()
    assert not seen.truth["subsurface"].any()


def test_a_pattern_and_its_complement_make_white(ball: Rendered) -> None:
    frames = [ball.frame(index) for index in range(len(CHECKERS))]
    np.testing.assert_allclose(frames[0] + frames[2], ball.white, rtol=1e-4)
    assert all(np.all(frame > -1e-6) for frame in frames)


def test_light_below_the_surface_is_told_apart_and_loses_colour(ball: Rendered) -> None:
    below = ball.truth["subsurface"].mean((0, 1))
    assert below[0] > below[1] > below[2] > 0
    assert below.sum() < ball.white.mean((0, 1)).sum()


def test_a_scene_renders_alike_every_time(ball: Rendered) -> None:
    again = render(Scenery([WALL, BALL], CAMERA, PROJECTOR), CHECKERS, 64)
    np.testing.assert_array_equal(again.contrast, ball.contrast)
