"""The exchange of light between the patches of a scene, solved once as a matrix.

B = B₁ + (ρ + S) F B: radiosity after all bounces from that after the first (Goral et al. 1984,
with S the subsurface transfer of a tile). Out of B come the indirect irradiance at the nodes of
every surface, G B, and on a tile's nodes the exitance that scattering makes of it, Q G B.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.sim.patches import Mesh, NodeGrid
from drivers.sim.scene import Scene
from drivers.sim.tile import TexelGrid


@dataclass(frozen=True, slots=True)
class Exchange:
    """Indirect light of a scene as a linear function of its first bounce.

    Parameters
    ----------
    mesh
        The patches.
    grids
        Nodes of each surface.
    node_offsets
        Index of each surface's first node, then of the tile's first, then their number.
    tile
        The translucent tile, if the scene has one.
    tile_nodes
        Those nodes that lie on it.
    by_patch
        (colours, patches, nodes + tile nodes): the indirect irradiance at every node and the
        exitance at every tile node that a unit of first-bounce radiosity on a patch causes.
        Kept in float32, which is finer than the patches are exact and half as much to read.
    """

    mesh: Mesh
    grids: tuple[NodeGrid, ...]
    node_offsets: NDArray[np.int64]
    tile: TexelGrid | None
    tile_nodes: NDArray[np.int64]
    by_patch: NDArray[np.float32]

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, scene: Scene) -> Self:
        """Solve the exchange of a scene; once, whatever looks at it."""
        mesh = Mesh.of(scene.surfaces)
        grids = tuple(NodeGrid.of(surface.patches) for surface in scene.surfaces)
        tile = TexelGrid.of(mesh)
        offsets = np.concatenate([[0], np.cumsum([grid.size for grid in grids])])
        tile_nodes = np.empty(0, np.int64)
        if tile is not None:
            tile_nodes = offsets[tile.surface] + tile.nodes_within(grids[tile.surface])
        at_nodes = np.concatenate(
            [mesh.factors_at(index, *grid.places()) for index, grid in enumerate(grids)]
        )
        between = mesh.form_factors()
        reflectance = mean_reflectance(mesh)
        scattering = np.zeros((0, 3, 0)), np.zeros((0, 3, 0))
        if tile is not None:
            scattering = _indirect_scattering(tile, grids[tile.surface])
        by_patch = []
        for colour in range(3):
            bounce = reflectance[:, colour, np.newaxis] * between
            outputs = at_nodes
            if tile is not None:
                to_nodes, to_patches = (
                    part[:, colour].T @ at_nodes[tile_nodes] for part in scattering
                )
                bounce[tile.patches] += to_patches
                outputs = np.concatenate([at_nodes, to_nodes])
            solved = np.linalg.solve((np.eye(len(bounce)) - bounce).T, outputs.T)
            by_patch.append(solved.astype(np.float32))
        ends = np.concatenate([offsets, [offsets[-1] + len(tile_nodes)]])
        return cls(mesh, grids, ends, tile, tile_nodes, np.stack(by_patch))


def reflectance_at(
    mesh: Mesh, surface: int, u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Reflectance of the very surface, (n, 3), at (u, v), (n,) each; on a tile the tile's."""
    it = mesh.surfaces[surface]
    values = it.texture(u, v)
    if it.tile is None:
        return values
    place = mesh.index(surface, u, v) - mesh.offsets[surface]
    row, column = np.divmod(place, it.patches[0])
    on_tile = (column >= it.tile.patches_u[0]) & (column < it.tile.patches_u[1])
    on_tile &= (row >= it.tile.patches_v[0]) & (row < it.tile.patches_v[1])
    return np.where(on_tile[:, np.newaxis], it.tile.surface, values)


def mean_reflectance(mesh: Mesh) -> NDArray[np.float64]:
    """Mean reflectance of every patch, (patches, 3)."""
    points = 8
    means = []
    for index, surface in enumerate(mesh.surfaces):
        count_u, count_v = surface.patches
        u, v = ((np.arange(points * count) + 0.5) / (points * count) for count in surface.patches)
        all_v, all_u = np.meshgrid(v, u, indexing="ij")
        values = reflectance_at(mesh, index, all_u.ravel(), all_v.ravel())
        blocks = values.reshape(count_v, points, count_u, points, 3).mean(axis=(1, 3))
        means.append(blocks.reshape(-1, 3))
    return np.concatenate(means)


def _indirect_scattering(
    tile: TexelGrid, grid: NodeGrid
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a tile makes of irradiance given at its nodes (m of them).

    Returns
    -------
    For a unit at each node, the exitance at all nodes, (m, colours, m), and the mean exitance of
    the tile's patches, (m, colours, patches).
    """
    nodes = tile.nodes_within(grid)
    u, v = tile.samples(1)
    spread = grid.interpolation(u.ravel(), v.ravel()).tocsc()[:, nodes].toarray()
    exitance = tile.scatterer.exitance(spread.T.reshape(len(nodes), 1, *tile.shape))
    to_nodes = tile.interpolation(*(place[nodes] for place in grid.places()))
    flat = exitance.reshape(-1, to_nodes.shape[1])
    at_nodes = (to_nodes @ flat.T).T.reshape(len(nodes), 3, len(nodes))
    return at_nodes, tile.pooled(exitance)
