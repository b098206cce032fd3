"""Light transport of a scene: from projector pixels to photosites, part by part.

Let e be the light of the projector's pixels. Per colour, with everything linear,

- direct: a photosite sees ρ E / π of the surfaces in it, E the projector's irradiance there;
- subsurface: E on a tile's texels, scattered (`Scatterer`), leaves as radiosity V; V / π;
- inter-reflection: the first bounce B₁ (ρE and V, averaged over patches) starts the exchange
  B = B₁ + (ρ + S) F B, F the form factors and S a tile's scattering of indirect light. The
  indirect irradiance F B is evaluated with exact factors at nodes twice as fine as the patches;
  a photosite sees ρ F B / π, and on a tile also what S makes of it.

The exchange is solved once and kept as a matrix from B₁ to the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from drivers.sim.exchange import Exchange
from drivers.sim.geometry import check_concave
from drivers.sim.sampling import (
    bayer_colours,
    first_bounces,
    narrowed,
    photosite_views,
    projector_coordinates,
    texel_irradiance,
)
from drivers.sim.scene import Scene

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Light:
    """What the photosites receive, split by its way; (2·height, 2·width) each, RGGB.

    The unit is the brightest photosite under white.
    """

    direct: Array
    subsurface: Array
    interreflection: Array


@dataclass(frozen=True, slots=True)
class _Colour:
    """Transport of one colour: to its photosites, and to the first bounce."""

    sites: NDArray[np.int64]
    direct: sparse.csr_array
    exit: sparse.csr_array
    bounced: sparse.csr_array
    first_bounce: sparse.csr_array


@dataclass(frozen=True, slots=True)
class Transport:
    """The scene as a linear map, see the module.

    Parameters
    ----------
    camera_px, projector_px
        (height, width) of the measured image and of the projector.
    projector_px_per_camera_px
        Median scale of the map from camera pixels to projector pixels.
    coordinates
        (height, width, 2) projector (row, column) at the centre of each camera pixel; NaN where
        it sees no surface.
    exchange
        Light between the surfaces.
    texels
        (texels, projector pixels): irradiance of the tile.
    colours
        Red, green, blue.
    unit
        The brightest photosite under white, before scaling to 1.
    """

    camera_px: tuple[int, int]
    projector_px: tuple[int, int]
    projector_px_per_camera_px: float
    coordinates: Array
    exchange: Exchange
    texels: sparse.csr_array
    colours: tuple[_Colour, ...]
    unit: float

    @classmethod
    def of(
        cls, scene: Scene, camera_px: tuple[int, int], projector_px: tuple[int, int]
    ) -> Transport:
        """The transport of a scene; built once for each size."""
        return _built(scene, tuple(camera_px), tuple(projector_px))

    def parts(self, emission: Array) -> Light:
        """What the photosites receive from the projector's light, part by part.

        Parameters
        ----------
        emission
            (height, width) or (height, width, 3) of the projector, fraction of white.
        """
        count = 4 * self.camera_px[0] * self.camera_px[1]
        direct, subsurface, bounced = np.zeros(count), np.zeros(count), np.zeros(count)
        pixels = self.projector_px[0] * self.projector_px[1]
        lights = emission.reshape(pixels, -1).T
        tile = self.exchange.tile
        if tile is not None:
            irradiance = np.stack([self.texels @ light for light in lights])
            exitance = tile.scatterer.exitance(irradiance.reshape(-1, *tile.shape))
        for index, colour in enumerate(self.colours):
            light = lights[min(index, len(lights) - 1)]
            first_bounce = colour.first_bounce @ light
            direct[colour.sites] = colour.direct @ light
            if tile is not None:
                first_bounce[tile.patches] += tile.pooled(exitance[index])
                subsurface[colour.sites] = colour.exit @ exitance[index].ravel()
            indirect = weighted_sum(self.exchange.by_patch[index], first_bounce)
            bounced[colour.sites] = colour.bounced @ indirect
        size = (2 * self.camera_px[0], 2 * self.camera_px[1])
        return Light(*(part.reshape(size) / self.unit for part in (direct, subsurface, bounced)))

    def photosites(self, emission: Array) -> Array:
        """All light on the photosites, (2·height, 2·width); see `parts`."""
        light = self.parts(emission)
        return light.direct + light.subsurface + light.interreflection


@njit(cache=True)
def weighted_sum(rows: NDArray[np.float32], weights: Array) -> Array:  # pragma: no cover - compiled
    """Σ_i weights[i] · rows[i], always added in this order, whatever the number of threads."""
    total = np.zeros(rows.shape[1])
    for i in range(len(rows)):
        weight = weights[i]
        for j in range(rows.shape[1]):
            total[j] += weight * rows[i, j]
    return total


def superpixels(mosaic: Array) -> Array:
    """Red, mean of the two greens, blue of every RGGB quad: (height, width, 3)."""
    green = (mosaic[0::2, 1::2] + mosaic[1::2, 0::2]) / 2
    return np.stack([mosaic[0::2, 0::2], green, mosaic[1::2, 1::2]], axis=-1)


@lru_cache(maxsize=8)
def _built(scene: Scene, camera_px: tuple[int, int], projector_px: tuple[int, int]) -> Transport:
    camera, projector = scene.camera(camera_px), scene.projector(projector_px)
    check_concave(
        tuple(surface.shape for surface in scene.surfaces),
        [np.asarray(scene.camera_m), np.asarray(scene.projector_m)],
    )
    exchange = Exchange.of(scene)
    views = photosite_views(exchange, camera, projector)
    bounces = first_bounces(exchange, projector)
    mosaic = bayer_colours(camera.size_px).ravel()
    colours = []
    for index, first_bounce in enumerate(bounces):
        sites = np.flatnonzero(mosaic == index)
        parts = (views.direct[sites], views.exit[sites], views.bounced[sites], first_bounce)
        colours.append(_Colour(sites, *(narrowed(part) for part in parts)))
    coordinates = projector_coordinates(exchange, camera, projector)
    scale = _scale(coordinates)
    texels = narrowed(texel_irradiance(exchange, projector))
    draft = Transport(
        camera_px, projector_px, scale, coordinates, exchange, texels, tuple(colours), 1.0
    )
    unit = float(draft.photosites(np.ones(projector_px)).max())
    return replace(draft, unit=unit)


def _scale(coordinates: Array) -> float:
    """Median over the picture of the root of the map's Jacobian."""
    down, right = np.gradient(coordinates, axis=0), np.gradient(coordinates, axis=1)
    area = down[..., 0] * right[..., 1] - down[..., 1] * right[..., 0]
    return float(np.sqrt(np.nanmedian(np.abs(area))))
