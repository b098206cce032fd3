"""Signs of light of short range, on harmonics made from the response tables."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.frames.gathering import HarmonicsStack
from processing.patterns import Family, Pattern, shift_grid
from processing.ranges.near_light import NearLight
from processing.ranges.regions import Signs, translucent_map
from processing.ranges.response import ResponseTables
from processing.ranges.slopes import told_of_blur
from tests.processing.light import PITCHES_PX, PROJECTOR_PX, checkers

SPREAD_PX = 10.0
N = 200
# Few shifts mix harmonics of the wave up, by a fifth with six; with many, the plain formulae hold.
MANY = [
    Pattern(Family.CHECKER, pitch_px, *shift)
    for pitch_px in (12, 16, 24, 32, 48, 64, 72)
    for shift in shift_grid(pitch_px, (12, 12))
]


def tables(blur_px2: float, patterns: list[Pattern] | None = None) -> ResponseTables:
    stack = HarmonicsStack(patterns or checkers(), (1, 1, 1), PROJECTOR_PX)
    return ResponseTables.of(stack.designs, [0.0, SPREAD_PX], blur_px2)


def places() -> NDArray[np.float64]:
    return np.random.default_rng(3).uniform(20, 150, (2, N))


def harmonics(
    table: ResponseTables, at: NDArray[np.float64], spread: int
) -> NDArray[np.complex128]:
    """What unit light of a spread adds at (2, n) places, (pitches, 2, n)."""
    rows = []
    ends = [*table.first[1:], len(table.down)]
    for first, end, pitch_px in zip(table.first, ends, table.pitch_px, strict=True):
        bins = np.linspace(0, 2 * pitch_px, end - first)
        down = np.interp(at[0] % (2 * pitch_px), bins, table.down[first:end, spread])
        right = np.interp(at[1] % (2 * pitch_px), bins, table.right[first:end, spread])
        rows.append([down * right / 2, down * right.conj() / 2])
    return np.array(rows)


def near(seen: NDArray[np.complex128], table: ResponseTables) -> NearLight:
    return NearLight.of(
        seen[..., np.newaxis].astype(np.complex64),
        places()[..., np.newaxis],
        (table,),
        np.ones((N, len(table.pitch_px), 2, 1)),
        np.ones((N, 1)),
    )


@pytest.mark.parametrize("excess_px2", [-0.5, 0.0, 1.0])
def test_excess_of_blur_is_its_variance(excess_px2: float) -> None:
    """1 %, and 0.01 px² for the harmonics of the wave that shifts mix up."""
    assumed = tables(2.0)
    found = near(harmonics(tables(2.0 + excess_px2), places(), 0), assumed)
    assert np.mean(found.excess_px2) == pytest.approx(excess_px2, rel=0.01, abs=0.01)


def test_light_from_all_sides_is_lost_and_does_not_lean() -> None:
    """2 % of white: at every place a few shifts more or less catch an edge."""
    table = tables(1.0, MANY)
    here, spread = (harmonics(table, places(), one) for one in (0, 1))
    found = near(0.7 * here + 0.3 * spread, table)
    finest, second, last = (np.exp(-((np.pi * SPREAD_PX / one) ** 2)) for one in (12, 24, 72))
    expected = [0.3 * (last - finest), 0.3 * (last - second)]
    np.testing.assert_allclose(found.lost.mean(axis=1), expected, atol=0.02)
    np.testing.assert_allclose(found.lean.mean(axis=1), 0, atol=0.005)


def test_light_from_one_side_leans() -> None:
    table = tables(1.0, MANY)
    beside = places() + np.array([[10.0], [0.0]])
    found = near(0.7 * harmonics(table, places(), 0) + 0.3 * harmonics(table, beside, 1), table)
    lean = found.lean.mean(axis=1)
    assert np.all(np.abs(lean) > 0.3 * found.lost[0].mean())
    # Both diagonals see a shift down alike.
    assert lean[0] == pytest.approx(lean[1], abs=0.005)


def test_stripes_and_too_few_pitches_tell_nothing_of_sides() -> None:
    stripes = [Pattern(Family.STRIPES_ROWS, p, s * p // 3) for p in PITCHES_PX for s in range(6)]
    for patterns in (stripes, checkers((8, 64))):
        table = tables(1.0, patterns)
        found = near(harmonics(table, places(), 0), table)
        assert np.isnan(found.lost).all()
        assert np.isnan(found.lean).all()


def test_blur_takes_from_what_is_told() -> None:
    pitch_px = np.array(PITCHES_PX, np.float64)
    told = [told_of_blur(pitch_px, variance) for variance in (0.0, 0.5, 4.0, 16.0)]
    assert told[0] == 1
    assert told == sorted(told, reverse=True)


def scene(excess_px2: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Strong evidence in a square of a picture whose sharpness is given."""
    shape = excess_px2.shape
    gain = np.zeros(shape, np.float32)
    gain[20:40, 20:40] = 30
    signs = Signs(shape, 1.0, 8.0)
    none = np.zeros(excess_px2.size)
    signs.add(
        slice(0, shape[0]),
        np.ones(shape, bool),
        NearLight(excess_px2.ravel(), np.stack([none, none]), np.stack([none, none])),
    )
    return translucent_map(gain, np.ones(shape, bool), 8.0, None, signs)


def test_what_is_no_less_sharp_than_others_is_not_called_translucent() -> None:
    """Waves of ±1 px² over the picture; the square lies 0.9 or 9 px² above its average."""
    down, right = np.mgrid[:60, :60]
    excess = np.sin(down / 6) * np.cos(right / 7)
    excess[20:40, 20:40] = 0.9
    assert not scene(excess).any()
    excess[20:40, 20:40] = 9.0
    assert scene(excess)[22:38, 22:38].all()


UNEVEN = np.sin(np.arange(60) / 6)[:, np.newaxis] * np.cos(np.arange(60) / 7)


def where_light_is_lost(
    excess_px2: NDArray[np.float64], lean: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """A square that loses 0.1 of white, of which a part leans; the fit has no evidence."""
    shape = excess_px2.shape
    square = np.zeros(shape)
    square[20:40, 20:40] = 0.1
    signs = Signs(shape, 1.0, 8.0)
    signs.add(
        slice(0, shape[0]),
        np.ones(shape, bool),
        NearLight(excess_px2.ravel(), np.stack([square.ravel()] * 2), np.stack([lean.ravel()] * 2)),
    )
    return translucent_map(np.zeros(shape, np.float32), np.ones(shape, bool), 8.0, None, signs)


def test_lost_light_goes_on_where_sharpness_tells_nothing() -> None:
    """Half of the square leans by 0.025, a quarter of what it loses, as the side of a ball does.

    Where sharpness tells, such pixels must be less sharp than others; where it varies by ±1 px²
    by itself they follow their neighbours. A crease, of which all leans, is none in either.
    """
    leaning = np.zeros((60, 60))
    leaning[20:40, 30:40] = 0.025
    found = where_light_is_lost(UNEVEN, leaning)
    assert found[22:38, 22:38].all()
    assert not np.delete(found, np.s_[18:42], axis=0).any()
    even = where_light_is_lost(np.zeros((60, 60)), leaning)
    assert even[22:38, 22:27].all()
    assert not even[22:38, 34:].any()
    assert not where_light_is_lost(UNEVEN, np.full((60, 60), 0.025)).any()


def test_what_sees_two_places_follows_its_neighbours_where_sharpness_tells_nothing() -> None:
    """Discs of 8 pixels fit into a rod of 10 with its rims, which do not vote, not without."""
    shape = (60, 60)
    rod = np.zeros(shape)
    rod[:, 25:35] = 0.1
    voting = np.ones(shape, bool)
    voting[:, 23:27] = voting[:, 33:37] = False
    zero = np.zeros(rod.size)
    found = []
    for excess_px2 in (UNEVEN, np.zeros(shape)):
        signs = Signs(shape, 1.0, 8.0)
        light = NearLight(excess_px2.ravel(), np.stack([rod.ravel()] * 2), np.stack([zero] * 2))
        signs.add(slice(0, 60), np.ones(shape, bool), light)
        gain = np.zeros(shape, np.float32)
        found.append(translucent_map(gain, np.ones(shape, bool), 8.0, voting, signs))
    assert found[0][:, 25:35].all()
    assert not np.delete(found[0], np.s_[25:35], axis=1).any()
    assert not found[1].any()
