from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.sim.scene import SCENES
from drivers.sim.transport import Light, Transport, superpixels
from processing.patterns import Pattern
from tests.drivers.path_tracer import Traced, trace

CAMERA_PX = (24, 24)
PROJECTOR_PX = (72, 96)
PARTS = ("direct", "subsurface", "interreflection")


def transport(name: str) -> Transport:
    return Transport.of(SCENES[name], CAMERA_PX, PROJECTOR_PX)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("colours", [pytest.param((), id="grey"), pytest.param((3,), id="colour")])
def test_light_adds_up(name: str, colours: tuple[int, ...]) -> None:
    rng = np.random.default_rng(2)
    one, other = rng.random((2, *PROJECTOR_PX, *colours))
    scene = transport(name)
    both = scene.parts(0.3 * one + 2 * other)
    for part in PARTS:
        expected = 0.3 * getattr(scene.parts(one), part) + 2 * getattr(scene.parts(other), part)
        np.testing.assert_allclose(getattr(both, part), expected, atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_a_pattern_and_its_complement_make_white(name: str) -> None:
    code = Pattern.parse("checker:8:2,3").code(PROJECTOR_PX)
    scene = transport(name)
    total = scene.photosites(code) + scene.photosites(1 - code)
    np.testing.assert_allclose(total, scene.photosites(np.ones(PROJECTOR_PX)), atol=1e-12)


@pytest.mark.parametrize("name", SCENES)
def test_grey_light_is_the_same_in_three_colours(name: str) -> None:
    code = Pattern.parse("checker:8").code(PROJECTOR_PX)
    scene = transport(name)
    in_colour = scene.photosites(np.repeat(code[..., np.newaxis], 3, axis=2))
    np.testing.assert_array_equal(in_colour, scene.photosites(code))


@pytest.mark.parametrize("name", SCENES)
def test_red_light_reaches_red_photosites_only(name: str) -> None:
    red = np.zeros((*PROJECTOR_PX, 3))
    red[..., 0] = 1
    seen = superpixels(transport(name).photosites(red))
    assert seen[..., 0].min() > 0
    assert not seen[..., 1:].any()


@pytest.mark.parametrize("name", SCENES)
def test_every_camera_pixel_sees_a_surface_that_the_projector_lights(name: str) -> None:
    scene = Transport.of(SCENES[name], (96, 96), PROJECTOR_PX)
    row, column = scene.coordinates[..., 0], scene.coordinates[..., 1]
    assert ((row > 0) & (row < PROJECTOR_PX[0] - 1)).all()
    assert ((column > 0) & (column < PROJECTOR_PX[1] - 1)).all()
    assert scene.parts(np.ones(PROJECTOR_PX)).direct.min() > 0
    assert scene.photosites(np.ones(PROJECTOR_PX)).max() == pytest.approx(1)


def test_a_flat_board_has_no_global_light() -> None:
    light = transport("board").parts(np.ones(PROJECTOR_PX))
    assert not light.subsurface.any()
    assert not light.interreflection.any()


def test_one_projector_pixel_lights_where_the_coordinates_say() -> None:
    scene = transport("board")
    code = np.zeros(PROJECTOR_PX)
    code[30, 50] = 1
    seen = superpixels(scene.parts(code).direct).sum(axis=2)
    lit = np.unravel_index(seen.argmax(), seen.shape)
    np.testing.assert_allclose(scene.coordinates[lit], (30, 50), atol=2)


def test_fine_checks_survive_in_direct_light_and_drown_in_scattered_and_exchanged_light() -> None:
    projector_px = (288, 384)
    scene = Transport.of(SCENES["corner"], (96, 96), projector_px)
    code = Pattern.parse("checker:8").code(projector_px)
    lit, dark = scene.parts(code), scene.parts(1 - code)

    def contrast(part: str) -> float:
        on, off = (superpixels(getattr(light, part))[..., 0] for light in (lit, dark))
        seen = on + off > 0.2 * (on + off).max()
        return float(np.median(np.abs(on - off)[seen] / (on + off)[seen]))

    assert contrast("direct") > 0.9
    assert 0.05 < contrast("subsurface") < 0.5
    assert contrast("interreflection") < 0.02


@pytest.mark.parametrize("name", ["corner", "groove"])
@pytest.mark.parametrize("pattern", ["white", "checker:24"])
def test_every_part_agrees_with_random_paths(name: str, pattern: str) -> None:
    code = Pattern.parse(pattern).code(PROJECTOR_PX)
    scene = transport(name)
    exact = scene.parts(code)
    traced = trace(SCENES[name], CAMERA_PX, code, 200, np.random.default_rng(3))
    rows, columns = np.indices((2 * CAMERA_PX[0], 2 * CAMERA_PX[1]))
    for part in PARTS:
        for colour in range(3):
            sites = ((rows % 2 + columns % 2) == colour).ravel()
            if getattr(exact, part).any():
                assert_within_error(exact, traced, part, sites, scene.unit)


def assert_within_error(
    exact: Light,
    traced: Traced,
    part: str,
    sites: NDArray[np.bool_],
    unit: float,
) -> None:
    """Means over the picture's photosites of one colour differ by chance alone (4 σ)."""
    expected = unit * getattr(exact, part).ravel()[sites].mean()
    paths = getattr(traced, part)[sites]
    mean = paths.mean()
    error = np.sqrt((paths.var(axis=1, ddof=1) / paths.shape[1]).sum()) / len(paths)
    assert error < 0.02 * expected
    assert abs(mean - expected) < 4 * error
