"""Translucent regions: where they end, and how their light divides."""

from __future__ import annotations

import numpy as np

from processing.ranges.account_fit import AccountFit
from processing.ranges.jumps import near_jumps, up_to_jumps
from processing.ranges.scattering import RivalFits
from tests.processing.light import slanted

SHAPE = (24, 32)
EDGE = 16


def test_a_region_reaches_its_depth_edge_and_no_farther() -> None:
    """Two planes, the left one translucent; beside the edge nothing was decided."""
    places = slanted(SHAPE)
    places[:, :, EDGE:] += 40
    undecided = near_jumps(places, np.ones(SHAPE, bool), 2.7)
    left = np.arange(SHAPE[1]) < EDGE
    region = left & ~undecided
    assert not region[:, EDGE - 2 : EDGE].any()
    for _ in range(2):
        region = up_to_jumps(region, undecided, places, 2.7)
    np.testing.assert_array_equal(region, np.broadcast_to(left, SHAPE))


def test_what_is_decided_is_not_taken() -> None:
    region = np.zeros(SHAPE, bool)
    region[:, :4] = True
    none = np.zeros(SHAPE, bool)
    np.testing.assert_array_equal(up_to_jumps(region, none, slanted(SHAPE), 2.7), region)


def test_a_region_divides_its_light_by_neighbourhoods() -> None:
    """Of 0.6 that is not direct two thirds scatter below the surface, in single pixels ± 0.05.

    The mean of 25 of them has a fifth of that scatter; direct light varies and must not change.
    """
    rng = np.random.default_rng(8)
    n = SHAPE[0] * SHAPE[1]
    white = rng.uniform(0.5, 1.0, n)
    direct = 0.4 * white
    scattered = (0.4 + rng.normal(0, 0.05, n)) * white
    none = np.zeros((n, 3))
    fit = AccountFit(np.zeros((n, 2)), direct, scattered, none, none, np.zeros(n))
    rivals = RivalFits((*SHAPE, 1))
    everywhere = np.ones(SHAPE, bool)
    rivals.add(slice(0, SHAPE[0]), everywhere, white[:, np.newaxis], [(fit, fit)])
    lit = white.reshape(*SHAPE, 1).astype(np.float32)
    parts = rivals.colour(everywhere, everywhere, lit, 0).components
    np.testing.assert_allclose(parts.sum(axis=0), lit[..., 0], rtol=1e-5)
    np.testing.assert_allclose(parts[0].ravel(), direct, rtol=1e-5)
    inner = (parts[1] / lit[..., 0])[2:-2, 2:-2]
    assert abs(inner.mean() - 0.4) < 0.01
    assert inner.std() < 0.05 / 4
    away = rivals.colour(np.zeros(SHAPE, bool), everywhere, lit, 0).components
    assert not away[1].any()


def test_a_division_that_changes_smoothly_stays_the_pixels_own() -> None:
    """From none below the surface at the left to all at the right, without scatter."""
    n = SHAPE[0] * SHAPE[1]
    share = np.broadcast_to(np.linspace(0, 1, SHAPE[1]) ** 2, SHAPE)
    rest = np.full(n, 0.5)
    none = np.zeros((n, 3))
    fit = AccountFit(np.zeros((n, 2)), rest, share.ravel() * rest, none, none, np.zeros(n))
    rivals = RivalFits((*SHAPE, 1))
    everywhere = np.ones(SHAPE, bool)
    lit = np.ones((*SHAPE, 1), np.float32)
    rivals.add(slice(0, SHAPE[0]), everywhere, lit.reshape(n, 1), [(fit, fit)])
    parts = rivals.colour(everywhere, everywhere, lit, 0).components
    # The mean of five columns alone would be off by 0.02 where the region ends.
    np.testing.assert_allclose(2 * parts[1][2:-2, 2:-2], share[2:-2, 2:-2], atol=0.005)
