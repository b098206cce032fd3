"""What projector pixels light and what photosites see, by area sampling, as sparse matrices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from drivers.sim.exchange import Exchange, reflectance_at
from drivers.sim.geometry import Pinhole, nearest_hits

Array: TypeAlias = NDArray[np.float64]

_SITE_SAMPLES = 4
_PIXEL_SAMPLES = 3
_TEXEL_SAMPLES = 4
_CHUNK_RAYS = 250_000


@dataclass(frozen=True, slots=True)
class Views:
    """Where photosites get their light from; rows are photosites.

    Parameters
    ----------
    direct
        From projector pixels, reflected once.
    exit
        From the exitance of the tile's texels.
    bounced
        From the indirect irradiance at the nodes and the indirect exitance at the tile's nodes.
    """

    direct: sparse.csr_array
    exit: sparse.csr_array
    bounced: sparse.csr_array


def bayer_colours(size: tuple[int, int]) -> NDArray[np.int64]:
    """Colour (0 red, 1 green, 2 blue) of every photosite of an RGGB mosaic, (height, width)."""
    rows, columns = np.indices(size)
    return rows % 2 + columns % 2


def photosite_views(exchange: Exchange, camera: Pinhole, projector: Pinhole) -> Views:
    """Sample every photosite with 4 × 4 rays."""
    colour = bayer_colours(camera.size_px).ravel()
    blocks = []
    for first, rows, columns in _places(camera.size_px, _SITE_SAMPLES):
        count = len(rows) // _SITE_SAMPLES**2
        owner = np.repeat(np.arange(count), _SITE_SAMPLES**2)
        blocks.append(
            _block(exchange, camera, projector, (rows, columns, owner, colour[first + owner]))
        )
    return Views(
        *(
            sparse.csr_array(sparse.vstack([getattr(block, part) for block in blocks]))
            for part in ("direct", "exit", "bounced")
        )
    )


def _block(
    exchange: Exchange,
    camera: Pinhole,
    projector: Pinhole,
    rays: tuple[Array, Array, NDArray[np.int64], NDArray[np.int64]],
) -> Views:
    """Views of a run of photosites; `rays` holds rows, columns, photosite and colour of each."""
    rows, columns, owner, colour = rays
    count = int(owner[-1]) + 1
    shapes = tuple(surface.shape for surface in exchange.mesh.surfaces)
    which, at_u, at_v = nearest_hits(
        shapes, np.asarray(camera.position), camera.rays(rows, columns)
    )
    tile, offsets = exchange.tile, exchange.node_offsets
    texels = 0 if tile is None else tile.shape[0] * tile.shape[1]
    direct = sparse.csr_array((count, projector.size_px[0] * projector.size_px[1]))
    left = sparse.csr_array((count, texels))
    bounced = sparse.csr_array((count, int(offsets[-1])))
    share = 1 / (np.pi * _SITE_SAMPLES**2)
    for index in range(len(shapes)):
        seen = np.flatnonzero(which == index)
        if not len(seen):
            continue
        u, v = at_u[seen], at_v[seen]
        reflected = reflectance_at(exchange.mesh, index, u, v)
        weights = share * reflected[np.arange(len(seen)), colour[seen]]
        gathered = _gather(weights, owner[seen], count)
        direct = direct + gathered @ lit(exchange, projector, index, u, v)
        nodes = exchange.grids[index].interpolation(u, v)
        bounced = bounced + _placed(gathered @ nodes, int(offsets[index]), int(offsets[-1]))
        if tile is not None and index == tile.surface:
            on_tile = tile.holds(u, v).astype(np.float64)
            leaving = _gather(share * on_tile, owner[seen], count)
            left = left + leaving @ tile.interpolation(u, v)
            tile_nodes = nodes.tocsc()[:, exchange.tile_nodes - offsets[index]]
            bounced = bounced + _placed(leaving @ tile_nodes, int(offsets[-2]), int(offsets[-1]))
    return Views(direct, left, bounced)


def lit(
    exchange: Exchange, projector: Pinhole, surface: int, u: Array, v: Array
) -> sparse.csr_array:
    """Irradiance (n, projector pixels) at places of a surface for each pixel's emission."""
    shape = exchange.mesh.surfaces[surface].shape
    points = shape.at(u, v)
    rows, columns, _ = projector.project(points)
    row, column = np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64)
    height, width = projector.size_px
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    irradiance = projector.irradiance(points, shape.normal)[inside]
    index = (np.flatnonzero(inside), (row * width + column)[inside])
    return sparse.csr_array((irradiance, index), shape=(len(u), height * width))


def texel_irradiance(exchange: Exchange, projector: Pinhole) -> sparse.csr_array:
    """Irradiance (texels, projector pixels) of the tile; no rows where there is none."""
    tile = exchange.tile
    if tile is None:
        return sparse.csr_array((0, projector.size_px[0] * projector.size_px[1]))
    u, v = tile.samples(_TEXEL_SAMPLES)
    owner = np.repeat(np.arange(u.shape[0]), u.shape[1])
    mean = _gather(np.full(u.size, 1 / u.shape[1]), owner, u.shape[0])
    irradiance = lit(exchange, projector, tile.surface, u.ravel(), v.ravel())
    return sparse.csr_array(mean @ irradiance)


def first_bounces(exchange: Exchange, projector: Pinhole) -> tuple[sparse.csr_array, ...]:
    """Radiosity (patches, projector pixels) after the first reflection, one matrix a colour.

    Every pixel sends 3 × 3 rays of equal flux; what they meet reflects at once.
    """
    mesh = exchange.mesh
    shapes = tuple(surface.shape for surface in mesh.surfaces)
    flux = 1 / (projector.focal_px * _PIXEL_SAMPLES) ** 2
    size = (len(mesh.areas_m2), projector.size_px[0] * projector.size_px[1])
    totals = [sparse.csr_array(size)] * 3
    for first, rows, columns in _places(projector.size_px, _PIXEL_SAMPLES):
        directions = projector.rays(rows, columns)
        which, at_u, at_v = nearest_hits(shapes, np.asarray(projector.position), directions)
        pixel = first + np.arange(len(rows)) // _PIXEL_SAMPLES**2
        for index in range(len(shapes)):
            seen = np.flatnonzero(which == index)
            patch = mesh.index(index, at_u[seen], at_v[seen])
            reflected = reflectance_at(mesh, index, at_u[seen], at_v[seen])
            for colour in range(3):
                radiosity = flux * reflected[:, colour] / mesh.areas_m2[patch]
                arriving = sparse.csr_array((radiosity, (patch, pixel[seen])), shape=size)
                totals[colour] = totals[colour] + arriving
    return tuple(totals)


def projector_coordinates(exchange: Exchange, camera: Pinhole, projector: Pinhole) -> Array:
    """(height, width, 2) projector (row, column) at the centre of each quad of photosites."""
    height, width = camera.size_px[0] // 2, camera.size_px[1] // 2
    rows, columns = (2.0 * part.ravel() + 0.5 for part in np.mgrid[:height, :width])
    shapes = tuple(surface.shape for surface in exchange.mesh.surfaces)
    which, at_u, at_v = nearest_hits(
        shapes, np.asarray(camera.position), camera.rays(rows, columns)
    )
    places = np.full((height * width, 2), np.nan)
    for index, shape in enumerate(shapes):
        seen = which == index
        row, column, _ = projector.project(shape.at(at_u[seen], at_v[seen]))
        places[seen] = np.stack([row, column], axis=-1)
    return places.reshape(height, width, 2)


def _places(size: tuple[int, int], samples: int) -> Iterator[tuple[int, Array, Array]]:
    """Index of the first pixel, rows and columns of sample places, run after run of pixels."""
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    down, right = (part.ravel() for part in np.meshgrid(offsets, offsets, indexing="ij"))
    chunk = max(_CHUNK_RAYS // samples**2, 1)
    for first in range(0, size[0] * size[1], chunk):
        row, column = np.divmod(np.arange(first, min(first + chunk, size[0] * size[1])), size[1])
        rows, columns = row[:, np.newaxis] + down, column[:, np.newaxis] + right
        yield first, rows.ravel(), columns.ravel()


def _gather(weights: Array, owner: NDArray[np.int64], count: int) -> sparse.csr_array:
    """(count, n): each owner's weighted sum over its samples."""
    return sparse.csr_array((weights, (owner, np.arange(len(owner)))), shape=(count, len(owner)))


def _placed(block: sparse.csr_array, first: int, total: int) -> sparse.csr_array:
    """A block of columns within `total` columns, starting at `first`."""
    matrix = block.tocoo()
    row, column = matrix.coords
    return sparse.csr_array((matrix.data, (row, column + first)), shape=(block.shape[0], total))


def narrowed(matrix: sparse.csr_array) -> sparse.csr_array:
    """The same matrix with 32-bit indices: half as much to read in every product."""
    parts = (matrix.data, matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32))
    return sparse.csr_array(parts, shape=matrix.shape)
