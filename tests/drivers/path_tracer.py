"""An independent way to the light of a scene: random paths, for the tests of the exact one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.sim.scene import Scene, Surface

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Traced:
    """Radiance of every path, (photosites, paths) each, by what happened to it."""

    direct: Array
    subsurface: Array
    interreflection: Array


def hits(scene: Scene, origins: Array, directions: Array) -> tuple[NDArray[np.int64], Array]:
    """Surface (−1: none) and place of each ray, by the triangle-free test of a parallelogram."""
    which, best = np.full(len(origins), -1), np.full(len(origins), np.inf)
    for index, surface in enumerate(scene.surfaces):
        corner, u, v = (
            np.asarray(part)
            for part in (surface.shape.corner, surface.shape.edge_u, surface.shape.edge_v)
        )
        normal = np.cross(u, v)
        slope = directions @ normal
        slope = np.where(slope < -1e-12, slope, np.nan)
        distance = ((corner - origins) @ normal) / slope
        place = origins + distance[:, np.newaxis] * directions - corner
        along = np.stack([place @ u / (u @ u), place @ v / (v @ v)])
        inside = (along >= 0).all(axis=0) & (along <= 1).all(axis=0)
        nearer = inside & (distance > 1e-9) & (distance < best)
        which[nearer], best[nearer] = index, distance[nearer]
    distances = np.where(which >= 0, best, 0.0)
    return which, origins + distances[:, np.newaxis] * directions


def coordinates(surface: Surface, points: Array) -> tuple[Array, Array]:
    """Place on a surface as u, v in [0, 1]."""
    place = points - np.asarray(surface.shape.corner)
    u, v = np.asarray(surface.shape.edge_u), np.asarray(surface.shape.edge_v)
    return place @ u / (u @ u), place @ v / (v @ v)


def on_tile(surface: Surface, points: Array) -> NDArray[np.bool_]:
    """Whether points of a surface lie on its tile."""
    if surface.tile is None:
        return np.zeros(len(points), bool)
    u, v = coordinates(surface, points)
    (u0, u1), (v0, v1) = surface.tile.patches_u, surface.tile.patches_v
    nu, nv = surface.patches
    inside_u = (u >= u0 / nu) & (u < u1 / nu)
    return inside_u & (v >= v0 / nv) & (v < v1 / nv)


def projected(scene: Scene, code: Array, points: Array, normals: Array) -> Array:
    """Irradiance by the projector: intensity 1/cos³ of the angle to the axis, over r²."""
    projector = scene.projector(code.shape)
    away = np.asarray(scene.projector_m) - points
    distance = np.linalg.norm(away, axis=1)
    right, down, axis = projector.frame()
    along = -(away @ axis) / distance
    column = -(away @ right) / (along * distance) * projector.focal_px + code.shape[1] / 2
    row = -(away @ down) / (along * distance) * projector.focal_px + code.shape[0] / 2
    inside = (row >= 0) & (row < code.shape[0]) & (column >= 0) & (column < code.shape[1])
    light = np.zeros(len(points))
    light[inside] = code[row[inside].astype(int), column[inside].astype(int)]
    facing = np.maximum((away * normals).sum(axis=1), 0) / distance
    irradiance: Array = light / along**3 * facing / distance**2
    return irradiance


def trace(
    scene: Scene, camera_px: tuple[int, int], code: Array, paths: int, rng: np.random.Generator
) -> Traced:
    """Follow `paths` random paths from every photosite."""
    camera = scene.camera(camera_px)
    height, width = camera.size_px
    site = np.repeat(np.arange(height * width), paths)
    row, column = np.divmod(site, width)
    colour = row % 2 + column % 2
    jitter = rng.random((2, len(site))) - 0.5
    directions = camera.rays(row + jitter[0], column + jitter[1])
    points = np.broadcast_to(np.asarray(scene.camera_m), directions.shape)
    parts = np.zeros((3, len(site)))
    path, weight = np.arange(len(site)), np.ones(len(site))
    for bounce in range(24):
        which, points = hits(scene, points, directions)
        alive = (which >= 0) & (weight > 0)
        path, weight, which, points = path[alive], weight[alive], which[alive], points[alive]
        scattered, points, gain = _met(scene, which, points, colour[path], rng)
        weight = weight * gain
        normals = np.stack([surface.shape.normal for surface in scene.surfaces])[which]
        seen = weight * projected(scene, code, points, normals) / np.pi
        kind = np.full(len(path), 2) if bounce else scattered.astype(int)
        np.add.at(parts, (kind, path), seen)
        directions = _cosine_lobe(normals, rng)
        points = points + 1e-9 * normals
    return Traced(*parts.reshape(3, height * width, paths))


def _met(
    scene: Scene,
    which: NDArray[np.int64],
    points: Array,
    colour: NDArray[np.int64],
    rng: np.random.Generator,
) -> tuple[NDArray[np.bool_], Array, Array]:
    """Whether the light came from below the surface, where it entered, and its weight."""
    scattered, gain = np.zeros(len(which), bool), np.zeros(len(which))
    entered = points.copy()
    for index, surface in enumerate(scene.surfaces):
        here = np.flatnonzero(which == index)
        gain[here] = surface.texture(*coordinates(surface, points[here]))[
            np.arange(len(here)), colour[here]
        ]
        here = here[on_tile(surface, points[here])]
        if surface.tile is None or not len(here):
            continue
        below = rng.random(len(here)) < 0.5
        surface_gain = np.asarray(surface.tile.surface)[colour[here]]
        albedo = np.asarray(surface.tile.albedo)[colour[here]]
        gain[here] = 2 * np.where(below, albedo, surface_gain)
        scattered[here] = below
        deep = here[below]
        # 2π r R(r) is a quarter of an exponential of mean d and three quarters of one of 3d.
        stretch = np.where(rng.random(len(deep)) < 0.25, 1.0, 3.0)
        radius_m = rng.exponential(stretch * np.asarray(surface.tile.range_m)[colour[deep]])
        turn = 2 * np.pi * rng.random(len(deep))
        u, v = (
            np.asarray(edge) / np.linalg.norm(edge)
            for edge in (surface.shape.edge_u, surface.shape.edge_v)
        )
        entered[deep] += radius_m[:, np.newaxis] * (
            np.cos(turn)[:, np.newaxis] * u + np.sin(turn)[:, np.newaxis] * v
        )
        gain[deep[~on_tile(surface, entered[deep])]] = 0
    return scattered, entered, gain


def _cosine_lobe(normals: Array, rng: np.random.Generator) -> Array:
    """Directions with density cos/π: the normal plus a random point of the unit sphere."""
    sphere = rng.standard_normal(normals.shape)
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    directions: Array = normals + sphere
    return directions
