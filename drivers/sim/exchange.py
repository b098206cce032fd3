"""The exchange of light between the patches of a scene, solved once as a matrix.

B = B₁ + (ρ + S) F B: radiosity after all bounces from that after the first (Goral et al. 1984,
with S the subsurface transfer of a tile). Out of B come the indirect irradiance at the nodes of
every surface, G B, and on a tile's nodes the exitance that scattering makes of it, Q G B.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    """

    mesh: Mesh
    grids: tuple[NodeGrid, ...]
    node_offsets: NDArray[np.int64]
    tile: TexelGrid | None
    tile_nodes: NDArray[np.int64]
    by_patch: NDArray[np.float64]

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Solve the exchange of a scene."""
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
        by_patch = np.stack(
            [
                _solved(colour, reflectance, between, at_nodes, tile, grids, tile_nodes)
                for colour in range(3)
            ]
        )
        ends = np.concatenate([offsets, [offsets[-1] + len(tile_nodes)]])
        return cls(mesh, grids, ends, tile, tile_nodes, by_patch)


def reflectance_at(
    mesh: Mesh, surface: int, u: NDArray[np.float64], v: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Reflectance of the very surface, (n, 3), at (u, v), (n,) each; a tile's where there is one."""
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


def _solved(
    colour: int,
    reflectance: NDArray[np.float64],
    between: NDArray[np.float64],
    at_nodes: NDArray[np.float64],
    tile: TexelGrid | None,
    grids: tuple[NodeGrid, ...],
    tile_nodes: NDArray[np.int64],
) -> NDArray[np.float64]:
    """One colour's matrix, (patches, nodes + tile nodes)."""
    bounce = reflectance[:, colour, np.newaxis] * between
    outputs = at_nodes
    if tile is not None:
        to_nodes, to_patches = _indirect_scattering(tile, grids[tile.surface], colour)
        bounce[tile.patches] += to_patches @ at_nodes[tile_nodes]
        outputs = np.concatenate([at_nodes, to_nodes @ at_nodes[tile_nodes]])
    exchange = np.eye(len(bounce)) - bounce
    return np.ascontiguousarray(np.linalg.solve(exchange.T, outputs.T))


def _indirect_scattering(
    tile: TexelGrid, grid: NodeGrid, colour: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a tile makes of irradiance given at its nodes (m of them).

    Returns
    -------
    (m, m) exitance at the nodes and (tile patches, m) mean exitance of the patches.
    """
    nodes = tile.nodes_within(grid)
    u, v = tile.samples(1)
    spread = grid.interpolation(u.ravel(), v.ravel()).tocsc()[:, nodes].toarray()
    exitance = tile.scatterers[colour].exitance(spread.T.reshape(len(nodes), *tile.shape))
    node_u, node_v = (place[nodes] for place in grid.places())
    to_nodes = tile.interpolation(node_u, node_v) @ exitance.reshape(len(nodes), -1).T
    return to_nodes, tile.pooled(exitance).T
