"""Radiosity patches: the surfaces cut up, and how light goes from patch to patch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from drivers.sim.geometry import point_form_factors
from drivers.sim.scene import Surface


@dataclass(frozen=True, slots=True)
class Mesh:
    """All patches of a scene, surface by surface, v slowest.

    Parameters
    ----------
    surfaces
        The scene's surfaces.
    offsets
        Index of each surface's first patch, and the number of all patches; (surfaces + 1,).
    polygons
        (patches, 4, 3) corners in metres.
    areas_m2
        (patches,).
    """

    surfaces: tuple[Surface, ...]
    offsets: NDArray[np.int64]
    polygons: NDArray[np.float64]
    areas_m2: NDArray[np.float64]

    @classmethod
    def of(cls, surfaces: tuple[Surface, ...]) -> Self:
        """Cut every surface into its patches."""
        polygons, areas = [], []
        for surface in surfaces:
            count_u, count_v = surface.patches
            u, v = np.meshgrid(np.arange(count_u), np.arange(count_v))
            around_u = np.array([0, 1, 1, 0]) + u.reshape(-1, 1)
            around_v = np.array([0, 0, 1, 1]) + v.reshape(-1, 1)
            polygons.append(surface.shape.at(around_u / count_u, around_v / count_v))
            area = np.prod(surface.shape.sides_m) / (count_u * count_v)
            areas.append(np.full(count_u * count_v, area))
        counts = [len(part) for part in areas]
        offsets = np.concatenate([[0], np.cumsum(counts)])
        return cls(surfaces, offsets, np.concatenate(polygons), np.concatenate(areas))

    def index(
        self, surface: int, u: NDArray[np.float64], v: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """The patch at each (u, v) of a surface."""
        count_u, count_v = self.surfaces[surface].patches
        column = np.minimum((u * count_u).astype(np.int64), count_u - 1)
        row = np.minimum((v * count_v).astype(np.int64), count_v - 1)
        place: NDArray[np.int64] = self.offsets[surface] + row * count_u + column
        return place

    def factors_at(
        self, surface: int, u: NDArray[np.float64], v: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Form factors (n, patches) from points of a surface; 0 to the patches in its plane."""
        points = self.surfaces[surface].shape.at(u, v)
        normals = np.broadcast_to(self.surfaces[surface].shape.normal, points.shape)
        factors = np.zeros((len(points), len(self.areas_m2)))
        for other in range(len(self.surfaces)):
            if other != surface:
                part = slice(self.offsets[other], self.offsets[other + 1])
                factors[:, part] = point_form_factors(
                    points, np.ascontiguousarray(normals), self.polygons[part]
                )
        return factors

    def form_factors(self, points: int = 3) -> NDArray[np.float64]:
        """(patches, patches): light on a patch, per area, over the radiosity of another.

        The exact factor of a point, averaged over points × points Gauss nodes of the receiver.
        """
        nodes, weights = np.polynomial.legendre.leggauss(points)
        rows = []
        for index, surface in enumerate(self.surfaces):
            count_u, count_v = surface.patches
            u = (np.arange(count_u)[:, np.newaxis] + (nodes + 1) / 2) / count_u
            v = (np.arange(count_v)[:, np.newaxis] + (nodes + 1) / 2) / count_v
            all_v, all_u = np.meshgrid(v.ravel(), u.ravel(), indexing="ij")
            factors = self.factors_at(index, all_u.ravel(), all_v.ravel())
            shape = (count_v, points, count_u, points, -1)
            mean = np.einsum("vaubp,a,b->vup", factors.reshape(shape), weights / 2, weights / 2)
            rows.append(mean.reshape(count_u * count_v, -1))
        return np.concatenate(rows)


@dataclass(frozen=True, slots=True)
class NodeGrid:
    """Places of a surface at which a smooth field is known: corners, edges, centres of patches.

    Parameters
    ----------
    along_u, along_v
        Coordinates of the columns and rows of nodes, in [0, 1], evenly spaced but for the outer
        ones.
    """

    along_u: NDArray[np.float64]
    along_v: NDArray[np.float64]

    @classmethod
    def of(cls, patches: tuple[int, int]) -> Self:
        """Two nodes a patch; the outer ones just inside, off the creases."""
        lines = [np.linspace(0, 1, 2 * count + 1) for count in patches]
        for line in lines:
            line[0], line[-1] = 1e-6, 1 - 1e-6
        return cls(lines[0], lines[1])

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.along_u) * len(self.along_v)

    def places(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates u and v of every node, v slowest, (size,) each."""
        v, u = np.meshgrid(self.along_v, self.along_u, indexing="ij")
        return u.ravel(), v.ravel()

    def interpolation(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> sparse.csr_array:
        """Bilinear weights, (n, size), that carry a field from the nodes to (u, v), (n,) each."""
        return bilinear(
            v * (len(self.along_v) - 1),
            u * (len(self.along_u) - 1),
            (len(self.along_v), len(self.along_u)),
        )


def bilinear(
    rows: NDArray[np.float64], columns: NDArray[np.float64], shape: tuple[int, int]
) -> sparse.csr_array:
    """Weights (n, rows·columns) of a grid's values at fractional places, clamped to the grid."""
    place, left, part = [], [], []
    for at, count in ((rows, shape[0]), (columns, shape[1])):
        at_grid = np.clip(at, 0, count - 1)
        first = np.minimum(at_grid.astype(np.int64), max(count - 2, 0))
        left.append(first)
        part.append(at_grid - first)
    n = len(rows)
    weights = []
    for down in (0, 1):
        for right in (0, 1):
            row = np.minimum(left[0] + down, shape[0] - 1)
            column = np.minimum(left[1] + right, shape[1] - 1)
            place.append(row * shape[1] + column)
            along = part[0] if down else 1 - part[0]
            weights.append(along * (part[1] if right else 1 - part[1]))
    index = (np.concatenate(weights), (np.tile(np.arange(n), 4), np.concatenate(place)))
    return sparse.csr_array(index, shape=(n, shape[0] * shape[1]))
