"""The scenes that can stand on the simulated bench."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from drivers.sim.geometry import Pinhole, Rectangle

Texture: TypeAlias = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
Triple: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Tile:
    """A translucent part of a surface.

    Parameters
    ----------
    patches_u, patches_v
        First patch and the one after the last, along u and v.
    surface
        Reflectance of its very surface, red green blue.
    albedo
        Fraction of the light on it that enters and, on an unbounded slab, leaves again.
    range_m
        d of `drivers.sim.scatter.diffusion_profile` for each colour, in metres.
    """

    patches_u: tuple[int, int]
    patches_v: tuple[int, int]
    surface: Triple
    albedo: Triple
    range_m: Triple


@dataclass(frozen=True, slots=True)
class Surface:
    """A diffuse rectangle.

    Parameters
    ----------
    shape
        Where it is.
    patches
        Number of radiosity patches along u and v.
    texture
        Reflectance (n, 3) at u, v (n,), in [0, 1].
    tile
        A translucent part, in place of what the texture says there.
    """

    shape: Rectangle
    patches: tuple[int, int]
    texture: Texture
    tile: Tile | None = None


@dataclass(frozen=True, slots=True)
class Scene:
    """Surfaces and where the camera and the projector stand.

    Parameters
    ----------
    surfaces
        A concave arrangement (see `drivers.sim.geometry`).
    camera_m, projector_m, target_m
        Positions in metres; both look at the target.
    field
        Width of the picture over its distance, along the camera's longer side. The projector's
        shorter side covers an eighth more.
    """

    surfaces: tuple[Surface, ...]
    camera_m: Triple
    projector_m: Triple
    target_m: Triple
    field: float = field(default=0.6)

    def camera(self, camera_px: tuple[int, int]) -> Pinhole:
        """The sensor's pinhole: twice as many photosites each way as measured pixels."""
        size = (2 * camera_px[0], 2 * camera_px[1])
        return Pinhole(self.camera_m, self.target_m, size, max(size) / self.field)

    def projector(self, projector_px: tuple[int, int]) -> Pinhole:
        """The projector's pinhole."""
        focal_px = min(projector_px) / (1.125 * self.field)
        return Pinhole(self.projector_m, self.target_m, projector_px, focal_px)


def plain(red: float, green: float, blue: float) -> Texture:
    """The same reflectance everywhere."""

    def texture(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.broadcast_to((red, green, blue), (*np.broadcast(u, v).shape, 3))

    return texture


def printed(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reflectance of a matte board printed with soft coloured waves and sharp dots."""
    tau = 2 * np.pi
    waves = np.stack(
        [
            np.sin(tau * (3 * u + 1.5 * v)) * np.cos(tau * 2 * v),
            np.sin(tau * (2 * u - 2.5 * v) + 1) * np.cos(tau * 1.5 * u),
            np.cos(tau * (1.5 * u + 3 * v) + 2) * np.sin(tau * 2.5 * u),
        ],
        axis=-1,
    )
    dots = np.hypot((16 * u) % 1 - 0.5, (16 * v) % 1 - 0.5) < 0.18
    return np.where(dots[..., np.newaxis], 0.35, 1.0) * (0.55 + 0.3 * waves)


def _corner() -> Scene:
    """A white floor with a tile of wax between a red and a green wall."""
    side_m = 1.1
    wax = Tile((2, 7), (2, 7), (0.17, 0.15, 0.12), (0.68, 0.55, 0.36), (0.020, 0.013, 0.008))
    return Scene(
        surfaces=(
            Surface(
                Rectangle((0, 0, 0), (side_m, 0, 0), (0, side_m, 0)),
                (12, 12),
                plain(0.85, 0.84, 0.8),
                wax,
            ),
            Surface(
                Rectangle((0, 0, 0), (0, 0, side_m), (side_m, 0, 0)),
                (12, 12),
                plain(0.8, 0.13, 0.1),
            ),
            Surface(
                Rectangle((0, 0, 0), (0, side_m, 0), (0, 0, side_m)),
                (12, 12),
                plain(0.12, 0.55, 0.2),
            ),
        ),
        camera_m=(1.45, 1.45, 1.6),
        projector_m=(1.38, 1.52, 1.66),
        target_m=(0.27, 0.27, 0.11),
        field=0.5,
    )


def _groove() -> Scene:
    """A V-groove of 70° between two pale boards: strong light from wall to wall."""
    half = np.deg2rad(35)
    side = (float(np.sin(half)), float(np.cos(half)))
    return Scene(
        surfaces=(
            Surface(
                Rectangle((0, 0, -0.6), (0, 0, 1.2), (side[0], side[1], 0)),
                (14, 16),
                plain(0.85, 0.7, 0.3),
            ),
            Surface(
                Rectangle((0, 0, -0.6), (-side[0], side[1], 0), (0, 0, 1.2)),
                (16, 14),
                plain(0.35, 0.6, 0.85),
            ),
        ),
        camera_m=(0.0, 2.6, 0.0),
        projector_m=(0.1, 2.6, 0.05),
        target_m=(0.0, 0.4, 0.0),
        field=0.4,
    )


def _board() -> Scene:
    """A flat printed board: direct light and nothing else."""
    return Scene(
        surfaces=(Surface(Rectangle((-1, 0, -1), (0, 0, 2), (2, 0, 0)), (1, 1), printed),),
        camera_m=(0.0, 1.6, 0.0),
        projector_m=(0.12, 1.6, 0.06),
        target_m=(0.0, 0.0, 0.0),
    )


SCENES: dict[str, Scene] = {"corner": _corner(), "groove": _groove(), "board": _board()}


def chessboard(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Reflectance of 8 × 6 printed squares of 70 mm on a board of 0.64 × 0.50 m."""
    down, across = (u * 0.50 - 0.04) / 0.07, (v * 0.64 - 0.04) / 0.07
    printed_on = (down >= 0) & (down < 6) & (across >= 0) & (across < 8)
    ink = printed_on & ((np.floor(down) + np.floor(across)) % 2 == 0)
    return np.repeat(np.where(ink, 0.06, 0.8)[..., np.newaxis], 3, axis=-1)


# Turns about the vertical and about the horizontal in degrees, and the middle in metres.
_POSES: tuple[tuple[float, float, Triple], ...] = (
    (0, 0, (0.0, 0.0, 0.0)),
    (28, 0, (-0.05, 0.1, 0.04)),
    (-28, 5, (0.05, 0.05, -0.04)),
    (0, 28, (-0.08, 0.1, -0.05)),
    (5, -28, (0.08, 0.0, 0.05)),
    (22, -22, (0.0, 0.15, 0.0)),
)


def _posed(vertical_deg: float, horizontal_deg: float, middle_m: Triple) -> Scene:
    """A printed chessboard in front of the devices of `board`."""
    a, b = np.deg2rad(vertical_deg), np.deg2rad(horizontal_deg)
    across = 0.64 * np.array([np.cos(a), np.sin(a), 0.0])
    up = 0.50 * np.array([-np.sin(a) * np.sin(b), np.cos(a) * np.sin(b), np.cos(b)])
    corner = np.asarray(middle_m) - (across + up) / 2
    rectangle = Rectangle(_triple(corner), _triple(up), _triple(across))
    return replace(SCENES["board"], surfaces=(Surface(rectangle, (1, 1), chessboard),))


def _triple(vector: NDArray[np.float64]) -> Triple:
    return float(vector[0]), float(vector[1]), float(vector[2])


CHESSBOARDS: dict[str, Scene] = {
    f"chessboard-{number}": _posed(*pose) for number, pose in enumerate(_POSES, 1)
}


def scene_named(name: str) -> Scene:
    """The scene of that name; ValueError lists the names that are known."""
    known = SCENES | CHESSBOARDS
    if name not in known:
        raise ValueError(f"{name!r} is no scene; known are {', '.join(known)}")
    return known[name]
