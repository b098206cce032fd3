"""Stated standard errors: their noise part on repeats, their model part by its signs."""

from __future__ import annotations

import numpy as np
import pytest

from processing.frames.gathering import HarmonicsStack
from processing.patterns import Pattern
from processing.ranges.blur import Blur
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.result import RangeDecomposition
from processing.ranges.stated_errors import defocus_px2, model_errors, signs
from tests.processing.light import PROJECTOR_PX, checkers
from tests.processing.test_ranges import EVERYWHERE, SHAPE, opaque_scene

REPEATS = 8
PITCHES_PX = (8, 12, 16, 24, 48, 96)
NOISE = 0.01
BLUR_PX = 0.8


@pytest.fixture(
    scope="module",
    params=[[Blur(BLUR_PX**2)] * 3, None],
    ids=["blur given", "blur measured"],
)
def repeats(request: pytest.FixtureRequest) -> list[RangeDecomposition]:
    """One scene, captured anew with other noise in every frame and in the one black frame."""
    scene = opaque_scene(BLUR_PX)
    patterns = checkers(PITCHES_PX)
    frames: list[tuple[Pattern, np.ndarray]] = [(one, scene.frame(one)) for one in patterns]
    found = []
    for seed in range(REPEATS):
        rng = np.random.default_rng(seed)
        black = rng.normal(0, NOISE, scene.white.shape)
        stack = HarmonicsStack(patterns, scene.white.shape, PROJECTOR_PX)
        for pattern, frame in frames:
            exposed = frame + rng.normal(0, NOISE, scene.white.shape) - black
            stack.add(exposed.astype(np.float32), pattern)
        found.append(decompose_ranges(stack, EVERYWHERE, blur=request.param))
    return found


@pytest.mark.parametrize("component", [0, 1], ids=["direct", "interreflection"])
def test_the_noise_error_covers_the_mean_of_repeats(
    repeats: list[RangeDecomposition], component: int
) -> None:
    """A value lies within one standard error of the mean of all at 68 % of the pixels, ± 3 %.

    All pixels share the error of a measured blur, so that there is little chance to average over:
    three colours of eight captures. Stated at nothing, it leaves 0.58 to 0.61 covered.
    """
    values = np.stack([found.components[component] for found in repeats])
    errors = np.stack([found.noise_errors[component] for found in repeats])
    # Each value is part of the mean that it is compared with.
    off = np.abs(values - values.mean(axis=0)) * np.sqrt(REPEATS / (REPEATS - 1))
    assert np.mean(off <= errors) == pytest.approx(0.68, abs=0.03)


def test_both_parts_make_the_whole(repeats: list[RangeDecomposition]) -> None:
    found = repeats[0]
    whole = np.hypot(found.noise_errors, found.model_errors)
    # In float32; the last bit is the library's own.
    np.testing.assert_allclose(found.deviations, whole, rtol=2.0**-22)
    assert found.noise_errors.min() > 0
    assert found.model_errors.min() > 0


def test_signs_are_nil_where_nothing_is_amiss() -> None:
    """Even light, one account, no residual, nothing near: no model error, whatever the colour."""
    nothing = np.zeros(SHAPE, np.float32)
    even = np.stack([nothing + 0.5, nothing, nothing + 0.2])
    found = signs(np.zeros_like(even), even, nothing + 0.5, nothing, nothing > 0, EVERYWHERE)
    assert not model_errors(found, 0.0).any()


def test_light_that_may_be_subsurface_is_uncertain_in_both_names() -> None:
    nothing = np.zeros(SHAPE, np.float32)
    even = np.stack([nothing + 0.5, nothing, nothing + 0.2])
    scattered = nothing + 0.1
    found = signs(np.zeros_like(even), even, nothing + 0.5, scattered, nothing > 0, EVERYWHERE)
    direct, subsurface, rest = model_errors(found, 0.0)
    # By half of it at least: the coefficient itself is what calibration says.
    assert np.all(subsurface > 0.05)
    assert np.all((rest > 0) & (direct > 0))


@pytest.mark.parametrize(
    ("camera_px2", "is_wider"),
    [(0.0, False), (1 / 12, False), (1 / 12 + 0.5, True)],
    ids=["unknown", "sharp", "out of focus"],
)
def test_a_camera_out_of_focus_widens_what_misfit_says(camera_px2: float, is_wider: bool) -> None:
    """A pixel's own width is no defocus; the light of neighbours in it is."""
    nothing = np.zeros(SHAPE, np.float32)
    even = np.stack([nothing + 0.5, nothing, nothing + 0.2])
    misfits = np.full_like(even, 0.01)
    found = signs(misfits, even, nothing + 0.5, nothing, nothing > 0, EVERYWHERE)
    beyond_px2 = defocus_px2(Blur(8.0, camera_px2=camera_px2, footprint_px2=7.8))
    direct, _, rest = model_errors(found, beyond_px2)
    sharp_direct, _, sharp_rest = model_errors(found, 0.0)
    assert np.all((direct > 1.2 * sharp_direct) == is_wider)
    assert np.all((rest > 1.2 * sharp_rest) == is_wider)
