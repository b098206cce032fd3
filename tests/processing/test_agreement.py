"""Pitches that do not agree with the others on where samples look."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from processing.patterns import Family, Pattern, shift_grid
from processing.proof.agreement import Disagreement, PitchPhases, disagreements, pitch_phases

PROJECTOR_PX = 120, 160
NOISE = 0.02
PITCHES_PX = 8, 10, 12, 16, 20
Array = NDArray[np.float64]


def places(side: int = 40) -> tuple[Array, Array]:
    """A surface seen askew, 2 projector pixels a sample."""
    down, right = np.mgrid[:side, :side] * 1.0
    return 10 + 2.1 * down + 0.2 * right, 12 + 2.3 * right + 0.1 * down + 0.01 * right**2


def phases(
    family: Family, pitch: int, moved: tuple[int, int] = (0, 0), flipped: tuple[int, ...] = ()
) -> PitchPhases:
    """Of 4 × 3 shifts of a checker or 6 of others."""
    chance = np.random.default_rng(pitch)
    if family is Family.CHECKER:
        shifts = shift_grid(pitch, (4, 3))
    else:
        counts = (6, 1) if family.varies_down else (1, 6)
        shifts = shift_grid(pitch, counts, (2, 2))
    patterns = [Pattern(family, pitch, *shift) for shift in shifts]
    light = []
    for pattern in patterns:
        raster = np.flip(np.roll(pattern.code(PROJECTOR_PX), moved, (0, 1)), flipped)
        seen = map_coordinates(gaussian_filter(raster, 0.7), places(), order=1).ravel()
        light.append(seen + chance.normal(0, NOISE, seen.shape))
    found = pitch_phases(patterns, np.stack(light), np.full(len(light[0]), NOISE**2))
    assert found is not None
    return found


FAMILIES = [Family.CHECKER, Family.STRIPES_COLUMNS, Family.SINUSOID_ROWS]


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("number", [1, 2, 3, 5])
def test_right_pitches_agree(family: Family, number: int) -> None:
    pitches = [phases(family, pitch) for pitch in PITCHES_PX[:number]]
    assert disagreements(pitches, PROJECTOR_PX) == []


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("odd", PITCHES_PX)
def test_a_pitch_that_stands_elsewhere_is_named_and_where(family: Family, odd: int) -> None:
    moved = odd // 2 * family.varies_down, (1 - odd // 2) * family.varies_right
    pitches = [phases(family, pitch, moved if pitch == odd else (0, 0)) for pitch in PITCHES_PX]
    found = disagreements(pitches, PROJECTOR_PX)
    assert odd in {one.pitch_px for one in found}
    # With checkers that are moved by half of their period another pitch may explain it as well.
    assert len(found) <= (2 if family is Family.CHECKER else 1)
    assert all(one.is_certain == (len(found) == 1) for one in found)
    if odd == 10 and family is not Family.CHECKER:
        assert found[0].displaced_px is not None
    if found[0].displaced_px is not None:
        turns = (0, odd) if family is Family.CHECKER else (0,)
        away = np.subtract(found[0].displaced_px, moved)
        assert min(np.abs((away + turn + odd) % (2 * odd) - odd).max() for turn in turns) < 1


def test_a_pitch_that_is_turned_over_is_named() -> None:
    pitches = [phases(Family.CHECKER, p, flipped=(1,) if p == 10 else ()) for p in PITCHES_PX]
    assert disagreements(pitches, PROJECTOR_PX) == [Disagreement(Family.CHECKER, 10, None)]


def test_of_two_pitches_it_is_not_known_which_is_off() -> None:
    pitches = [phases(Family.STRIPES_ROWS, 8), phases(Family.STRIPES_ROWS, 12, (4, 0))]
    found = disagreements(pitches, PROJECTOR_PX)
    assert [(one.pitch_px, one.is_certain) for one in found] == [(8, False), (12, False)]


def test_patterns_along_different_directions_are_not_compared() -> None:
    pitches = [phases(Family.STRIPES_ROWS, 8), phases(Family.STRIPES_COLUMNS, 12, (0, 5))]
    assert disagreements(pitches, PROJECTOR_PX) == []


def test_shifts_that_fix_no_phase_and_pitches_that_faded_tell_nothing() -> None:
    patterns = [Pattern(Family.CHECKER, 8, 0, 0), Pattern(Family.CHECKER, 8, 8, 0)]
    flat = np.full((2, 400), 0.5)
    assert pitch_phases(patterns, flat, np.full(400, NOISE**2)) is None
    grid = [Pattern(Family.CHECKER, 8, *shift) for shift in shift_grid(8, (4, 3))]
    faded = np.random.default_rng(1).normal(0.5, NOISE, (12, 400))
    assert pitch_phases(grid, faded, np.full(400, NOISE**2)) is None
