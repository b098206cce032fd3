"""A translucent tile as a grid of texels on its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from drivers.sim.patches import Mesh, NodeGrid, bilinear
from drivers.sim.scatter import Scatterer
from drivers.sim.scene import Surface, Tile

TEXELS_PER_PATCH = 12


@dataclass(frozen=True, slots=True)
class TexelGrid:
    """Texels of a tile, v slowest, and the scattering between them.

    Parameters
    ----------
    surface
        Index of the surface that the tile is part of.
    tile
        Its optical properties.
    shape
        (rows, columns) of texels, along v and u.
    lower_uv, upper_uv
        Its bounds on the surface.
    patches
        Indices of the patches that it covers, v slowest.
    scatterer
        Subsurface transfer between them.
    """

    surface: int
    tile: Tile
    shape: tuple[int, int]
    lower_uv: tuple[float, float]
    upper_uv: tuple[float, float]
    patches: NDArray[np.int64]
    scatterer: Scatterer

    @classmethod
    def of(cls, mesh: Mesh) -> Self | None:
        """The tile of a scene, None where it has none."""
        for index, surface in enumerate(mesh.surfaces):
            if surface.tile is not None:
                return cls._on(mesh, index, surface, surface.tile)
        return None

    @classmethod
    def _on(cls, mesh: Mesh, index: int, surface: Surface, tile: Tile) -> Self:
        (u_first, u_end), (v_first, v_end) = tile.patches_u, tile.patches_v
        count_u, count_v = surface.patches
        rows, columns = np.mgrid[v_first:v_end, u_first:u_end]
        shape = (TEXELS_PER_PATCH * (v_end - v_first), TEXELS_PER_PATCH * (u_end - u_first))
        side_u_m, side_v_m = surface.shape.sides_m
        texel_m = (side_v_m / (TEXELS_PER_PATCH * count_v), side_u_m / (TEXELS_PER_PATCH * count_u))
        return cls(
            surface=index,
            tile=tile,
            shape=shape,
            lower_uv=(u_first / count_u, v_first / count_v),
            upper_uv=(u_end / count_u, v_end / count_v),
            patches=(mesh.offsets[index] + rows * count_u + columns).ravel(),
            scatterer=Scatterer.of(tile.albedo, tile.range_m, shape, texel_m),
        )

    def holds(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether (u, v) of the surface lies on the tile."""
        along_u = (u >= self.lower_uv[0]) & (u < self.upper_uv[0])
        return along_u & (v >= self.lower_uv[1]) & (v < self.upper_uv[1])

    def interpolation(self, u: NDArray[np.float64], v: NDArray[np.float64]) -> sparse.csr_array:
        """Weights (n, texels) that carry a field from the texels' centres to (u, v), (n,) each."""
        part_u = (u - self.lower_uv[0]) / (self.upper_uv[0] - self.lower_uv[0])
        part_v = (v - self.lower_uv[1]) / (self.upper_uv[1] - self.lower_uv[1])
        return bilinear(part_v * self.shape[0] - 0.5, part_u * self.shape[1] - 0.5, self.shape)

    def samples(self, points: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates u and v of points × points places in every texel, (texels, points²) each."""
        rows, columns = np.mgrid[: self.shape[0], : self.shape[1]]
        offsets = (np.arange(points) + 0.5) / points
        down, right = (part.ravel() for part in np.meshgrid(offsets, offsets, indexing="ij"))
        part_v = (rows.reshape(-1, 1) + down) / self.shape[0]
        part_u = (columns.reshape(-1, 1) + right) / self.shape[1]
        return (
            self.lower_uv[0] + part_u * (self.upper_uv[0] - self.lower_uv[0]),
            self.lower_uv[1] + part_v * (self.upper_uv[1] - self.lower_uv[1]),
        )

    def pooled(self, texels: NDArray[np.float64]) -> NDArray[np.float64]:
        """Means over the tile's patches, (..., patches), of a field (..., rows, columns)."""
        side = TEXELS_PER_PATCH
        blocks = (self.shape[0] // side, side, self.shape[1] // side, side)
        means: NDArray[np.float64] = texels.reshape(*texels.shape[:-2], *blocks).mean(axis=(-3, -1))
        return means.reshape(*texels.shape[:-2], -1)

    def nodes_within(self, grid: NodeGrid) -> NDArray[np.int64]:
        """Those nodes of the surface's grid that lie on the tile or its border."""
        u, v = grid.places()
        slack = 1e-5
        within = (u > self.lower_uv[0] - slack) & (u < self.upper_uv[0] + slack)
        within &= (v > self.lower_uv[1] - slack) & (v < self.upper_uv[1] + slack)
        return np.flatnonzero(within)
