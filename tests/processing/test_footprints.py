"""What a camera pixel covers on the projector, and what that does to the harmonics."""

from __future__ import annotations

import numpy as np
import pytest

from processing.frames.gathering import HarmonicsStack
from processing.ranges.blur import Blur
from processing.ranges.footprints import footprints
from processing.ranges.response import ResponseTables
from tests.processing.light import PROJECTOR_PX, checkers, slanted


def test_footprints_of_a_plane_are_its_slopes_and_depth_edges_have_none() -> None:
    places = slanted((30, 40))
    places[:, :, 20:] += 55.0
    found = footprints(places, np.ones((30, 40), bool))
    down, right = np.array([2.7, -0.15]), np.array([0.1, 0.9 * 2.7])
    expected = [
        down[0] ** 2 + right[0] ** 2,
        down[1] ** 2 + right[1] ** 2,
        down[0] * down[1] + right[0] * right[1],
    ]
    np.testing.assert_allclose(found, np.array(expected)[:, None, None] * np.ones((1, 30, 40)))


def test_pixels_of_unknown_place_have_the_typical_footprint() -> None:
    places = slanted((30, 40))
    mask = np.ones((30, 40), bool)
    mask[10:20, 10:20] = False
    found = footprints(places, mask)
    assert np.isfinite(found).all()
    assert found[:2, 15, 15].mean() == pytest.approx(found[:2, 2, 2].mean(), rel=1e-6)


def test_a_textured_surface_spreads_as_tweedie_says() -> None:
    """Under a lens of σ = 1 pixel, stripes of albedo 1 ± 0.4 every 5 pixels; mean to 4 %.

    Stronger ones look like depth edges and are taken for such.
    """
    fine = np.arange(-6, 46, 0.05)
    albedo = 1 + 0.4 * np.sin(2 * np.pi * fine / 5)
    place = 2.7 * fine
    pixels = np.arange(40)
    weight = np.exp(-((pixels[:, None] - fine) ** 2) / 2) * albedo
    weight /= weight.sum(axis=1, keepdims=True)
    mean = weight @ place
    variance = weight @ place**2 - mean**2
    down, right = np.broadcast_to(mean, (30, 40)), np.mgrid[:30, :40][0] * 2.7
    found = footprints(np.stack([right, down]), np.ones((30, 40), bool))
    inner = slice(4, -4)
    assert np.ptp(variance[inner]) > 0.2 * variance.mean()
    np.testing.assert_allclose(found[1, 15, inner].mean(), variance[inner].mean(), rtol=0.04)
    assert np.corrcoef(found[1, 15, inner], variance[inner])[0, 1] > 0.95


def tables(blur_px2: float, box_px: float = 0.0) -> ResponseTables:
    stack = HarmonicsStack(checkers((8, 16, 32)), (1, 1, 1), PROJECTOR_PX)
    return ResponseTables.of(stack.designs, [0.0], blur_px2, box_px)


def test_a_box_is_what_averaging_over_it_gives() -> None:
    """Means of the unboxed table over twelve bins of a quarter pixel: a box of 3 pixels."""
    sharp, boxed = tables(0.5).down[:, 0], tables(0.5 + 3.0**2 / 12, 3.0).down[:, 0]
    first = tables(1.0).first
    for start, end in zip(first, [*first[1:], len(sharp)], strict=True):
        period = sharp[start : end - 1]
        # Half of the outermost bins lies in the box.
        weights = np.array([0.5, *np.ones(11), 0.5]) / 12
        mean = sum(w * np.roll(period, k - 6) for k, w in enumerate(weights))
        np.testing.assert_allclose(boxed[start : end - 1], mean, atol=0.005 * np.abs(mean).max())


def test_a_larger_footprint_lowers_the_fundamental_as_more_blur_does() -> None:
    blur = Blur(1.0, camera_px2=0.25, footprint_px2=2.0)
    wider = np.array([[6.0], [6.0], [0.0]])
    base, more = tables(1.0), tables(1.0 + 0.25 * 4.0)
    gains = blur.gains(base.pitch_px, base.varies, wider)
    start = base.first[2]
    period = base.down[start:-1, 0].size
    carrier = np.exp(2j * np.pi * np.arange(period) / period)
    first, second = (np.mean(one.down[start:-1, 0] * carrier) for one in (base, more))
    assert gains[0, 2, 0] == pytest.approx(abs(second / first) ** 2, rel=1e-3)
    assert gains[0, 2, 1] == gains[0, 2, 0]
