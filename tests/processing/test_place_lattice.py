"""Places that no pattern tells apart are one place."""

from __future__ import annotations

import numpy as np
import pytest

from processing.frames.gathering import HarmonicsStack
from processing.frames.harmonics import PitchDesign
from processing.patterns import Family, Pattern
from processing.ranges.correspondence import decode
from processing.ranges.jumps import near_jumps
from processing.ranges.place_lattice import UNIQUE, PlaceLattice
from processing.ranges.response import ResponseTables
from tests.processing.light import PITCHES_PX, PROJECTOR_PX, Scene, checkers, slanted

SHAPE = (40, 48)
EVERYWHERE = np.ones(SHAPE, bool)
OCTAVES_PX = (8, 16, 32, 64)


def designs(pitches_px: tuple[int, ...]) -> list[PitchDesign]:
    return [PitchDesign.of(checkers([one])) for one in pitches_px]


@pytest.mark.parametrize(
    "step_px", [(64.0, 64.0), (64, -64), (128, 0), (0, 128), (192, 64), (-64, 64)]
)
def test_checkers_of_octaves_repeat_along_the_diagonals(step_px: tuple[float, float]) -> None:
    alike = PlaceLattice.of(designs(OCTAVES_PX), PROJECTOR_PX)
    step = np.array([[1.5], [-2.0]])
    np.testing.assert_array_equal(alike.shortest(step + np.array(step_px)[:, None]), step)
    down, right = 400 + np.array([[0, step_px[0]], [0, step_px[1]]]).astype(int)
    for pattern in checkers(OCTAVES_PX):
        code = pattern.code((int(down.max()) + 1, int(right.max()) + 1))
        assert code[down[0], right[0]] == code[down[1], right[1]]


def test_stripes_repeat_each_way_alone() -> None:
    stripes = [
        PitchDesign.of([Pattern(Family.STRIPES_ROWS, pitch, k, 0) for k in range(0, 2 * pitch, 4)])
        for pitch in (8, 16)
    ]
    alike = PlaceLattice.of(stripes, PROJECTOR_PX)
    np.testing.assert_array_equal(alike.shortest(np.array([[33.0], [16.0]])), [[1.0], [16.0]])


def test_the_papers_pitches_leave_every_place_its_own() -> None:
    alike = PlaceLattice.of(designs(PITCHES_PX), PROJECTOR_PX)
    step = np.array([[900.0], [0.1]])
    assert alike.shortest(step) is step


def test_a_wall_under_octaves_has_no_depth_edges() -> None:
    light = Scene(
        slanted(SHAPE), {0.0: np.full((*SHAPE, 1), 0.6), np.inf: np.full((*SHAPE, 1), 0.2)}
    )
    patterns = checkers(OCTAVES_PX)
    stack = HarmonicsStack(patterns, (*SHAPE, 1), PROJECTOR_PX)
    for pattern in patterns:
        stack.add(light.frame(pattern), pattern)
    white = stack.white()
    harmonics = stack.harmonics(white, slice(None)).reshape(len(OCTAVES_PX), 2, -1, 1)
    tables = [ResponseTables.of(stack.designs, np.zeros(1), 1.0)]
    found = decode(harmonics, stack.designs, tables, PROJECTOR_PX)
    places = found.place_px.mean(axis=-1).reshape(2, *SHAPE)
    alike = PlaceLattice.of(stack.designs, PROJECTOR_PX)
    assert near_jumps(places, EVERYWHERE, 2.7, UNIQUE).any()
    assert not near_jumps(places, EVERYWHERE, 2.7, alike).any()
