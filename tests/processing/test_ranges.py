"""The default decomposition on scenes whose light is known spread by spread."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.frames.gathering import HarmonicsStack
from processing.metrics import relative_error
from processing.patterns import Family, Pattern
from processing.ranges.accounts import spread_grid
from processing.ranges.blur import Blur
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.result import RangeDecomposition
from processing.ranges.spectrum import diffusion_mixture
from tests.processing.light import PITCHES_PX, PROJECTOR_PX, Scene, checkers, slanted, waves

SHAPE = (40, 48)
EVERYWHERE = np.ones(SHAPE, bool)
NOISE = 0.003


def textured(level: float) -> NDArray[np.float64]:
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]] / 40
    wave = 1 + 0.4 * np.sin(9 * right + 4 * down)
    light: NDArray[np.float64] = level * wave[..., np.newaxis] * np.array([1.0, 0.7, 0.4])
    return light


def opaque_scene(blur_px: float = 0.8) -> Scene:
    """Direct light, and inter-reflection from 24 px and from everywhere."""
    parts = {0.0: textured(0.5), 24.0: textured(0.1), np.inf: textured(0.15)}
    return Scene(slanted(SHAPE), parts, blur_px)


def translucent_scene() -> tuple[Scene, NDArray[np.float64]]:
    """Half of the direct light of one quarter scattered over 7 px; the rest comes from afar."""
    scene = opaque_scene()
    inside = np.zeros((*SHAPE, 1))
    inside[10:30, 12:36] = 0.5
    scattered = inside * scene.parts[0.0]
    grid = spread_grid(np.array(PITCHES_PX, float))
    parts = {
        0.0: scene.parts[0.0] - scattered,
        64.0: scene.parts[24.0],
        np.inf: scene.parts[np.inf],
    }
    for spread_px, share in zip(grid, diffusion_mixture(grid, 7.0), strict=True):
        if share > 0:
            parts[spread_px] = parts.get(spread_px, 0) + share * scattered
    return Scene(scene.places_px, parts), scattered


def gathered(
    scene: Scene, patterns: list[Pattern], noise: float = NOISE, out: Any = None
) -> HarmonicsStack:
    rng = np.random.default_rng(5)
    stack = HarmonicsStack(patterns, scene.white.shape, PROJECTOR_PX, out)
    white = Pattern(Family.WHITE)
    for pattern in [white, *patterns]:
        frame = scene.frame(pattern) + rng.normal(0, noise, scene.white.shape)
        stack.add(frame.astype(np.float32), pattern)
    return stack


def errors(found: RangeDecomposition, truth: dict[str, NDArray[np.float64]]) -> dict[str, float]:
    parts = dict(zip(found.names, found.components, strict=True))
    return {
        name: relative_error(parts[name], light.astype(np.float32), EVERYWHERE)
        for name, light in truth.items()
    }


@pytest.mark.parametrize("blur_px", [0.8, 2.5])
def test_an_opaque_scene_has_direct_light_and_interreflection(blur_px: float) -> None:
    scene = opaque_scene(blur_px)
    found = decompose_ranges(gathered(scene, checkers()), EVERYWHERE)
    assert found.names == ("direct", "interreflection")
    wrong = errors(
        found, {"direct": scene.parts[0.0], "interreflection": scene.white - scene.parts[0.0]}
    )
    assert wrong["direct"] < 0.02
    assert wrong["interreflection"] < 0.04
    assert found.warnings == ()
    for blur in found.blur:
        assert np.sqrt(blur.side_px2) == pytest.approx(blur_px, abs=0.1)
    np.testing.assert_allclose(found.noise, NOISE, rtol=0.1)


def test_a_translucent_part_is_found_and_named() -> None:
    scene, scattered = translucent_scene()
    found = decompose_ranges(gathered(scene, checkers()), EVERYWHERE)
    assert found.names == ("direct", "subsurface", "interreflection")
    inside = scattered[..., 0] > 0
    assert np.mean(found.translucent == inside) > 0.95
    far = scene.parts[64.0] + scene.parts[np.inf]
    wrong = errors(
        found,
        {
            "direct": scene.white - far - scattered,
            "subsurface": scattered,
            "interreflection": far,
        },
    )
    assert wrong["direct"] < 0.06
    assert wrong["subsurface"] < 0.2
    assert wrong["interreflection"] < 0.1


def test_components_are_light_and_add_up() -> None:
    scene, _ = translucent_scene()
    mask = EVERYWHERE.copy()
    mask[5:9, 7:20] = False
    found = decompose_ranges(gathered(scene, checkers(), noise=0.03), mask)
    assert found.components.min() >= 0
    total = found.components.sum(axis=0)
    np.testing.assert_allclose(total[mask], np.maximum(found.white[mask], 0), atol=1e-6)
    assert not found.components[:, ~mask].any()
    assert found.deviations.shape == found.components.shape
    assert np.all(found.mixing[:, -1] == 1)
    assert np.all(found.mixing[..., 0] == 1)
    rising = np.diff(found.mixing[..., 1:], axis=1)
    assert np.all(rising > -1e-6)


@pytest.mark.parametrize(
    "patterns",
    [
        pytest.param(
            waves(Family.STRIPES_ROWS, 12) + waves(Family.STRIPES_COLUMNS, 12), id="stripes"
        ),
        pytest.param(waves(Family.STRIPES_COLUMNS, 12), id="stripes-one-way"),
        pytest.param(
            waves(Family.SINUSOID_ROWS, 8) + waves(Family.SINUSOID_COLUMNS, 8), id="sinusoids"
        ),
        pytest.param(
            [
                pattern
                for pattern, drawn in zip(
                    checkers(), np.random.default_rng(0).random(len(checkers())), strict=True
                )
                if drawn < 0.7
            ],
            id="two-thirds-of-the-checkers",
        ),
    ],
)
def test_other_patterns_and_shifts_will_do(patterns: list[Pattern]) -> None:
    scene = opaque_scene()
    found = decompose_ranges(gathered(scene, patterns), EVERYWHERE)
    wrong = errors(found, {"direct": scene.parts[0.0]})
    assert found.names == ("direct", "interreflection")
    assert wrong["direct"] < 0.05


def test_a_known_blur_is_taken_as_it_is() -> None:
    scene = opaque_scene(2.0)
    blur = [Blur(4.0)] * 3
    found = decompose_ranges(gathered(scene, checkers()), EVERYWHERE, blur=blur)
    assert found.blur == tuple(blur)
    assert errors(found, {"direct": scene.parts[0.0]})["direct"] < 0.02


def test_one_colour_will_do_and_harmonics_may_be_a_file(tmp_path: Path) -> None:
    scene = opaque_scene()
    grey = Scene(scene.places_px, {k: v[..., :1] for k, v in scene.parts.items()})
    shape = (len(PITCHES_PX), 4, *SHAPE, 1)
    out = np.memmap(tmp_path / "harmonics", np.float32, "w+", shape=shape)
    found = decompose_ranges(gathered(grey, checkers(), out=out), EVERYWHERE)
    assert found.components.shape == (2, *SHAPE, 1)
    assert errors(found, {"direct": grey.parts[0.0]})["direct"] < 0.02


@pytest.mark.parametrize(
    ("mask", "blur", "said"),
    [
        pytest.param(np.ones((3, 4), bool), None, r"\(3, 4\).*\(40, 48, 3\)", id="mask"),
        pytest.param(np.zeros(SHAPE, bool), None, "no usable pixel", id="all-masked"),
        pytest.param(EVERYWHERE, [Blur(1.0)], "1 for frames", id="blurs"),
    ],
)
def test_what_cannot_be_decomposed_is_refused(mask: Any, blur: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        decompose_ranges(gathered(opaque_scene(), checkers((8, 16))), mask, blur=blur)
