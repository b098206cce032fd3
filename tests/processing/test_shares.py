"""Shares of light, freed from what single pixels scatter by."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.ranges.blur import PIXEL_PX2, Blur
from processing.ranges.shares import smoothed, unsharpness

Image = NDArray[np.float32]

SHAPE = (40, 48)
EVERYWHERE = np.ones(SHAPE, bool)
SCATTER = 0.05


def scattered(share: NDArray[np.float64]) -> tuple[Image, Image]:
    """Light of which a part has a share that scatters from pixel to pixel."""
    rng = np.random.default_rng(2)
    whole = rng.uniform(0.5, 1, SHAPE).astype(np.float32)
    seen = np.clip(share + rng.normal(0, SCATTER, SHAPE), 0, 1)
    return (seen * whole).astype(np.float32), whole


@pytest.mark.parametrize("edges", [0.0, 0.5, 1.0])
def test_a_steady_share_loses_most_of_its_scatter(edges: float) -> None:
    """The mean of 25 has a fifth of it; to tell that it is scatter costs as much again."""
    part, whole = scattered(np.full(SHAPE, 0.4))
    left = (smoothed(part, whole, EVERYWHERE, edges=edges) / whole)[3:-3, 3:-3]
    assert abs(left.mean() - 0.4) < 0.003
    assert left.std() < 0.4 * SCATTER


@pytest.mark.parametrize("turned", [False, True], ids=["upright", "lying"])
def test_an_edge_stays_where_the_share_may_have_edges(turned: bool) -> None:
    """From 0.8 to 0.4, eight times the scatter: half of it stays between neighbours, at least."""
    share = np.full(SHAPE, 0.8)
    if turned:
        share[20:] = 0.4
    else:
        share[:, 24:] = 0.4
    part, whole = scattered(share)
    steps = []
    for edges in (1.0, 0.0):
        found = smoothed(part, whole, EVERYWHERE, edges=edges) / whole
        found = found.T if turned else found
        last = 19 if turned else 23
        steps.append(found[3:-3, last].mean() - found[3:-3, last + 1].mean())
        away = found[6:-6, last + 5 : last + 12] - 0.4
        assert np.sqrt(np.mean(away**2)) < 0.5 * SCATTER
    assert steps[0] > 0.5 * 0.4
    assert steps[1] < steps[0]


def test_only_the_region_changes_and_by_itself_alone() -> None:
    part, whole = scattered(np.full(SHAPE, 0.4))
    region = np.zeros(SHAPE, bool)
    region[10:30, 12:36] = True
    found = smoothed(part, whole, region)
    np.testing.assert_array_equal(found[~region], part[~region])
    elsewhere = np.where(region, part, whole).astype(np.float32)
    np.testing.assert_array_equal(smoothed(elsewhere, whole, region)[region], found[region])
    none = np.zeros(SHAPE, bool)
    np.testing.assert_array_equal(smoothed(part, whole, none), part)
    np.testing.assert_array_equal(smoothed(part, whole, region, freed=0.0), part)


def test_a_share_is_taken_of_what_is_asked() -> None:
    part, whole = scattered(np.full(SHAPE, 0.4))
    found = smoothed(part, whole, EVERYWHERE, of=2 * whole)
    np.testing.assert_allclose(found, 2 * smoothed(part, whole, EVERYWHERE), rtol=1e-6)


@pytest.mark.parametrize(
    ("camera_px2", "expected"),
    [(0.0, 0.0), (PIXEL_PX2, 0.0), (0.1, 0.0), (4 * PIXEL_PX2, 0.5), (20 * PIXEL_PX2, 0.9)],
    ids=["unknown", "a pixel", "what sharp ones were measured at", "twice", "far out"],
)
def test_a_camera_is_out_of_focus_by_what_its_pixels_do_not_blur(
    camera_px2: float, expected: float
) -> None:
    assert unsharpness(Blur(8.0, camera_px2=camera_px2)) == pytest.approx(expected)
