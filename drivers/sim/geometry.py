"""Rectangles, pinholes, rays, and the form factors between rectangles.

A scene is concave: every rectangle lies in front of every other one's plane, and so do the
projector and the camera. Nothing then stands between any two of them, light throws no shadow on
another rectangle, and form factors need no visibility.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

Points: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle in space; its front is the side to which edge_u × edge_v points.

    Parameters
    ----------
    corner, edge_u, edge_v
        (x, y, z) in metres; the edges are at right angles. A point on it is
        corner + u·edge_u + v·edge_v with u and v in [0, 1].
    """

    corner: tuple[float, float, float]
    edge_u: tuple[float, float, float]
    edge_v: tuple[float, float, float]

    @property
    def normal(self) -> Points:
        """Unit vector (3,) to the front."""
        across = np.asarray(np.cross(self.edge_u, self.edge_v), np.float64)
        unit: Points = across / np.linalg.norm(across)
        return unit

    @property
    def sides_m(self) -> tuple[float, float]:
        """Lengths of edge_u and edge_v in metres."""
        return float(np.linalg.norm(self.edge_u)), float(np.linalg.norm(self.edge_v))

    def at(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> Points:
        """Points (..., 3) in metres at (u, v) of equal shapes."""
        along_u: Points = u[..., np.newaxis] * np.asarray(self.edge_u)
        along_v: Points = v[..., np.newaxis] * np.asarray(self.edge_v)
        return np.asarray(self.corner) + along_u + along_v


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A pinhole camera or projector.

    Parameters
    ----------
    position, target
        (x, y, z) in metres: where it stands and what its axis points at; z is up.
    size_px
        (height, width) of its raster, row 0 on top.
    focal_px
        Focal length in pixels.
    """

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    size_px: tuple[int, int]
    focal_px: float

    def frame(self) -> Points:
        """(3, 3) unit vectors: right, down, along the axis."""
        axis = np.subtract(self.target, self.position)
        axis = axis / np.linalg.norm(axis)
        right = np.cross(axis, (0.0, 0.0, 1.0))
        right = right / np.linalg.norm(right)
        return np.stack([right, np.cross(axis, right), axis])

    def rays(self, rows: NDArray[np.float64], columns: NDArray[np.float64]) -> Points:
        """Directions (n, 3), of length 1 along the axis, through places in pixels (n,).

        The upper left corner of the raster is at (−½, −½): pixel centres are whole numbers.
        """
        height, width = self.size_px
        x = (columns - (width - 1) / 2) / self.focal_px
        y = (rows - (height - 1) / 2) / self.focal_px
        right, down, axis = self.frame()
        directions: Points = x[:, np.newaxis] * right + y[:, np.newaxis] * down + axis
        return directions

    def project(
        self, points: Points
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Rows and columns in pixels and depth along the axis in metres, (n,) each, of (n, 3)."""
        away = points - np.asarray(self.position)
        x, y, depth = ((away * direction).sum(axis=-1) for direction in self.frame())
        height, width = self.size_px
        rows = self.focal_px * y / depth + (height - 1) / 2
        columns = self.focal_px * x / depth + (width - 1) / 2
        return rows, columns, depth

    def irradiance(self, points: Points, normal: Points) -> NDArray[np.float64]:
        """Irradiance (n,) at (n, 3) points of a surface when the pixels there emit 1.

        Every pixel carries the same flux, 1 for each unit of the image plane at distance 1:
        E = cos(incidence) · r / depth³, with r the distance to the projector.
        """
        away = np.asarray(self.position) - points
        _, _, depth = self.project(points)
        facing: NDArray[np.float64] = np.maximum((away * normal).sum(axis=-1), 0)
        return facing / depth**3


def nearest_hits(
    rectangles: tuple[Rectangle, ...], origin: Points, directions: Points
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Index of the rectangle that each ray meets first (−1 for none), and u and v on it; (n,)."""
    axes, offsets = np.empty((len(rectangles), 3, 3)), np.empty((len(rectangles), 3))
    for index, rectangle in enumerate(rectangles):
        edge_u, edge_v = np.asarray(rectangle.edge_u), np.asarray(rectangle.edge_v)
        axes[index] = rectangle.normal, edge_u / (edge_u @ edge_u), edge_v / (edge_v @ edge_v)
        offsets[index] = axes[index] @ (np.asarray(rectangle.corner) - origin)
    return _nearest_hits(axes, offsets, directions)


@njit(cache=True)
def _nearest_hits(
    axes: Points, offsets: Points, directions: Points
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:  # pragma: no cover
    """`nearest_hits` in the rectangles' own coordinates: axes (m, 3, 3), offsets (m, 3)."""
    which = np.full(len(directions), -1)
    at_u, at_v = np.zeros(len(directions)), np.zeros(len(directions))
    along = np.empty(3)
    for i in range(len(directions)):
        best = np.inf
        for j in range(len(axes)):
            for k in range(3):
                along[k] = 0.0
                for xyz in range(3):
                    along[k] += directions[i, xyz] * axes[j, k, xyz]
            if along[0] >= 0:
                continue
            distance = offsets[j, 0] / along[0]
            u = distance * along[1] - offsets[j, 1]
            v = distance * along[2] - offsets[j, 2]
            if 0 < distance < best and 0 <= u <= 1 and 0 <= v <= 1:
                best, which[i], at_u[i], at_v[i] = distance, j, u, v
    return which, at_u, at_v


def check_concave(rectangles: tuple[Rectangle, ...], viewpoints: list[Points]) -> None:
    """Raise ValueError unless everything lies in front of every rectangle's plane."""
    corner_uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    corners = [rectangle.at(corner_uv[:, 0], corner_uv[:, 1]) for rectangle in rectangles]
    everything = np.concatenate([*corners, np.stack(viewpoints)])
    for rectangle in rectangles:
        height = (everything - np.asarray(rectangle.corner)) @ rectangle.normal
        if height.min() < -1e-9:
            raise ValueError(f"the scene is not concave: something lies behind {rectangle}")


@njit(cache=True)
def point_form_factors(
    points: Points, normals: Points, polygons: Points
) -> NDArray[np.float64]:  # pragma: no cover - compiled
    """Form factors from points to polygons, Lambert's formula.

    F = 1/(2π) Σ_k γ_k n·Γ_k over the edges k of the polygon, γ_k the angle that the edge spans
    at the point and Γ_k the unit normal of the plane through edge and point (Lambert 1760; e.g.
    Baum, Rushmeier, Winget 1989, eq. 8). Exact where the whole polygon is above the point's
    horizon.

    Parameters
    ----------
    points, normals
        (n, 3).
    polygons
        (m, 4, 3) corners, counter-clockwise seen from the front.

    Returns
    -------
    (n, m): irradiance at the point over the polygon's radiosity, in [0, 1].
    """
    factors = np.zeros((len(points), len(polygons)))
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for j in range(len(polygons)):
            total = 0.0
            bx, by, bz = polygons[j, 0, 0] - x, polygons[j, 0, 1] - y, polygons[j, 0, 2] - z
            for k in range(4):
                corner = polygons[j, (k + 1) % 4]
                ax, ay, az = corner[0] - x, corner[1] - y, corner[2] - z
                cx = ay * bz - az * by
                cy = az * bx - ax * bz
                cz = ax * by - ay * bx
                sine = np.sqrt(cx * cx + cy * cy + cz * cz)
                if sine > 1e-15:
                    cosine = ax * bx + ay * by + az * bz
                    lean = normals[i, 0] * cx + normals[i, 1] * cy + normals[i, 2] * cz
                    total += np.arctan2(sine, cosine) * lean / sine
                bx, by, bz = ax, ay, az
            factors[i, j] = max(total / (2 * np.pi), 0.0)
    return factors
