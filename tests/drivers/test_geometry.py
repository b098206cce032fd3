from __future__ import annotations

import numpy as np
import pytest

from drivers.sim.geometry import (
    Pinhole,
    Rectangle,
    check_concave,
    nearest_hits,
    point_form_factors,
)
from drivers.sim.patches import Mesh
from drivers.sim.scene import SCENES, Surface, plain

FLOOR = Rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))
CEILING = Rectangle((0, 0, 1), (0, 1, 0), (1, 0, 0))
WALLS = (
    Rectangle((0, 0, 0), (0, 0, 1), (1, 0, 0)),
    Rectangle((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    Rectangle((0, 0, 0), (0, 1, 0), (0, 0, 1)),
    Rectangle((1, 0, 0), (0, 0, 1), (0, 1, 0)),
)
BOX = (FLOOR, CEILING, *WALLS)


def mesh_of(*rectangles: Rectangle, patches: int) -> Mesh:
    grey = plain(0.5, 0.5, 0.5)
    return Mesh.of(tuple(Surface(shape, (patches, patches), grey) for shape in rectangles))


def test_a_closed_box_is_all_that_a_point_in_it_sees() -> None:
    mesh = mesh_of(*BOX, patches=3)
    place = np.array([0.03, 0.4, 0.98])
    for surface in range(6):
        seen = mesh.factors_at(surface, place, place[::-1].copy())
        np.testing.assert_allclose(seen.sum(axis=1), 1, atol=1e-12)


def test_patches_of_a_closed_box_give_all_their_light_to_each_other() -> None:
    factors = mesh_of(*BOX, patches=4).form_factors()
    np.testing.assert_allclose(factors.sum(axis=1), 1, atol=1e-12)


@pytest.mark.parametrize(
    ("other", "expected"),
    # Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11 and C-14.
    [
        pytest.param(CEILING, 0.199825, id="opposite-squares"),
        pytest.param(WALLS[0], 0.200044, id="squares-with-a-common-edge"),
    ],
)
def test_form_factors_agree_with_closed_forms(other: Rectangle, expected: float) -> None:
    mesh = mesh_of(FLOOR, other, patches=8)
    factors = mesh.form_factors()
    half = len(factors) // 2
    whole = factors[:half, half:].sum(axis=1).mean()
    assert whole == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_exchange_light_both_ways_and_make_none(name: str) -> None:
    mesh = Mesh.of(SCENES[name].surfaces)
    factors = mesh.form_factors()
    assert factors.sum(axis=1).max() <= 1 + 1e-12
    flow = mesh.areas_m2[:, np.newaxis] * factors
    assert np.abs(flow - flow.T).sum() <= 2e-3 * flow.sum()


def test_a_point_sees_a_small_far_polygon_as_cosines_over_distance_squared() -> None:
    side_m, distance_m = 1e-3, 2.0
    corners = np.array([[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0]]) * side_m - side_m / 2
    polygon = (corners + np.array([0, 0, distance_m + side_m / 2]))[np.newaxis]
    factor = point_form_factors(np.zeros((1, 3)), np.array([[0.6, 0.0, 0.8]]), polygon)
    assert factor[0, 0] == pytest.approx(0.8 * side_m**2 / (np.pi * distance_m**2), rel=1e-5)


def test_what_lies_behind_a_surface_is_refused() -> None:
    with pytest.raises(ValueError, match="not concave"):
        check_concave((FLOOR,), [np.array([0.5, 0.5, -0.1])])


def test_rays_of_a_pinhole_meet_the_points_that_project_to_their_pixels() -> None:
    pinhole = Pinhole((0.4, 0.6, 2.0), (0.5, 0.5, 0.0), (30, 40), 200.0)
    rows, columns = np.array([0.0, 3.25, 29.0]), np.array([0.0, 20.5, 39.0])
    which, u, v = nearest_hits(BOX, np.array(pinhole.position), pinhole.rays(rows, columns))
    assert set(which) == {0}
    at_rows, at_columns, depth_m = pinhole.project(FLOOR.at(u, v))
    np.testing.assert_allclose(at_rows, rows, atol=1e-9)
    np.testing.assert_allclose(at_columns, columns, atol=1e-9)
    assert (depth_m > 1.9).all()


def test_row_0_of_a_pinhole_is_on_top() -> None:
    pinhole = Pinhole((0.5, 2.0, 0.5), (0.5, 0.0, 0.5), (30, 40), 60.0)
    rows, _, _ = pinhole.project(np.array([[0.5, 0.0, 0.9], [0.5, 0.0, 0.1]]))
    assert rows[0] < 15 < rows[1]
