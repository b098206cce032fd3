"""A camera whose lens is out of focus: every frame is blurred, and so is what is true."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from processing.frames.gathering import HarmonicsStack
from processing.metrics import relative_error
from processing.patterns import Family, Pattern
from processing.ranges.accounts import spread_grid
from processing.ranges.blur import PIXEL_PX2, Blur
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.result import RangeDecomposition
from processing.ranges.spectrum import diffusion_mixture
from tests.processing.light import PITCHES_PX, PROJECTOR_PX, Scene, checkers

SHAPE = (56, 72)
EVERYWHERE = np.ones(SHAPE, bool)
LENS_PX = 1.0
NOISE = 0.003


def seen(light: NDArray[np.floating]) -> NDArray[np.floating]:
    """Through the lens."""
    blurred: NDArray[np.floating] = ndimage.gaussian_filter(
        light, (LENS_PX, LENS_PX, 0), mode="nearest"
    )
    return blurred


def kinds_of_light() -> tuple[Scene, dict[str, NDArray[np.floating]]]:
    """A textured surface that curves; half of the direct light of a part scatters over 7 px.

    A camera's blur is told by growing with the footprint: that doubles from left to right.
    """
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    across = 1.6 * right + 0.8 * right**2 / SHAPE[1]
    places = np.stack([15 + 2.6 * down + 0.1 * right, 20 + across - 0.1 * down])
    texture = 1 + 0.3 * np.sin(0.225 * right + 0.2 * down) * np.sin(0.15 * down)
    light = texture[..., np.newaxis] * np.array([1.0, 0.7, 0.4])
    inside = np.zeros((*SHAPE, 1))
    inside[14:42, 20:54] = 0.25
    below = inside * light
    parts = {0.0: 0.5 * light - below, 64.0: 0.1 * light, np.inf: 0.15 * light}
    grid = spread_grid(np.array(PITCHES_PX, float))
    for spread_px, share in zip(grid, diffusion_mixture(grid, 7.0), strict=True):
        if share > 0:
            parts[spread_px] = parts.get(spread_px, 0) + share * below
    scene = Scene(places, parts)
    truth = {"direct": 0.5 * light - below, "subsurface": below, "interreflection": 0.25 * light}
    return scene, {name: seen(part) for name, part in truth.items()}


@pytest.fixture(scope="module")
def found() -> RangeDecomposition:
    scene, _ = kinds_of_light()
    rng = np.random.default_rng(5)
    stack = HarmonicsStack(checkers(), scene.white.shape, PROJECTOR_PX)
    for pattern in [Pattern(Family.WHITE), *checkers()]:
        frame = seen(scene.frame(pattern)) + rng.normal(0, NOISE, scene.white.shape)
        stack.add(frame.astype(np.float32), pattern)
    return decompose_ranges(stack, EVERYWHERE)


def test_light_is_taken_apart_as_through_a_sharp_lens(found: RangeDecomposition) -> None:
    """In focus, direct light of such scenes is off by 0.02, what is near and far by 0.15."""
    assert found.names == ("direct", "subsurface", "interreflection")
    _, truth = kinds_of_light()
    wrong = [
        relative_error(part, truth[name].astype(np.float32), EVERYWHERE)
        for name, part in zip(found.names, found.components, strict=True)
    ]
    assert wrong[0] < 0.035
    assert wrong[1] < 0.15
    assert wrong[2] < 0.03


def test_the_blur_is_known_for_the_lens_s(found: RangeDecomposition) -> None:
    for blur in found.blur:
        assert blur.camera_px2 == pytest.approx(LENS_PX**2 + PIXEL_PX2, abs=0.2)


def test_a_camera_out_of_focus_makes_a_pixel_s_blur_unsure() -> None:
    """2 % of what all share, 6 % of the camera's part, which is each pixel's own footprint."""
    projector, camera = (Blur(8.0, camera_px2=part, footprint_px2=8.0) for part in (0.0, 1.0))
    assert projector.error_px2 == pytest.approx(0.16)
    assert camera.error_px2 == pytest.approx(np.hypot(0.16, 0.48))
