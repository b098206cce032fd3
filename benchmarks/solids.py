"""Objects, camera and projector of a scene for `benchmarks.light_paths`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

SPHERE, BOX, CYLINDER = 0, 1, 2
UNIFORM, CHECKS, WAVES = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Solid:
    """One object.

    Parameters
    ----------
    shape
        Unit sphere, cube (−1..1 each way) or cylinder (radius 1, −1..1 along y).
    centre, size, turn_rad
        Scaled by `size`, turned about y, x and z in this order, then moved.
    colours
        Two albedos, RGB, between which the texture alternates.
    texture, scale
        Kind, and its repeats a unit of length.
    gloss, exponent
        Share of the glossy lobe, and its Phong exponent.
    extinction
        Of the medium inside, per unit of length; 0 for opaque solids.
    medium
        Single-scattering albedo, RGB.
    coat
        Share of light that a translucent solid scatters at its surface.
    is_matched
        The medium's boundary does not bend light.
    """

    shape: int
    centre: Vector
    size: Vector
    turn_rad: Vector = (0.0, 0.0, 0.0)
    colours: tuple[Vector, Vector] = ((0.7, 0.7, 0.7), (0.7, 0.7, 0.7))
    texture: int = UNIFORM
    scale: float = 4.0
    gloss: float = 0.0
    exponent: float = 30.0
    extinction: float = 0.0
    medium: Vector = (0.0, 0.0, 0.0)
    coat: float = 1.0
    is_matched: bool = False


@dataclass(frozen=True, slots=True)
class View:
    """A pinhole camera or projector that looks at a point.

    Parameters
    ----------
    place, target
        Where it stands and looks.
    half_width
        Tangent of half the horizontal angle of view.
    pixels
        (height, width).
    """

    place: Vector
    target: Vector
    half_width: float
    pixels: tuple[int, int]

    def axes(self) -> Array:
        """Rows: place, right, down, forward, (half width, height, width)."""
        place, target = np.array(self.place), np.array(self.target)
        forward = (target - place) / np.linalg.norm(target - place)
        right = np.cross(np.array([0.0, 1.0, 0.0]), forward)
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        last = np.array([self.half_width, *self.pixels], np.float64)
        return np.stack([place, right, down, forward, last])


@dataclass(frozen=True, slots=True)
class Scenery:
    """Objects, camera and projector."""

    solids: Sequence[Solid]
    camera: View
    projector: View
    seed: int = 0


def solid_table(solids: Sequence[Solid]) -> Array:
    """One row a solid, see the columns in `_trace` and below."""
    rows = []
    for one in solids:
        inverse = _rotation(one.turn_rad).T / np.array(one.size)[:, np.newaxis]
        optics = [one.texture, one.scale, one.gloss, one.exponent, one.extinction]
        rows.append(
            np.concatenate(
                [
                    [one.shape], one.centre, inverse.ravel(), one.colours[0], one.colours[1],
                    optics, one.medium, [one.coat, float(one.is_matched)],
                ]
            )
        )  # fmt: skip
    return np.array(rows, np.float64)


def _rotation(turn_rad: Vector) -> Array:
    (cy, cx, cz), (sy, sx, sz) = np.cos(turn_rad), np.sin(turn_rad)
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    turned: Array = about_z @ about_x @ about_y
    return turned
