"""Where the simulated camera's pictures come from."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np

from drivers.errors import DriverError
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.devices import SimulationConfig, build

# (the file's bytes, its media type) of one exposure.
ImageSource: TypeAlias = Callable[[CameraSettings], tuple[bytes, str]]

THUMBNAIL_PX = (120, 160)
_GAMMA = 2.2


def simulated_scene(config: SimulationConfig | None = None) -> ImageSource:
    """Exposures of a simulated scene under a white projector, as DNG files."""
    bench = build(SimulationConfig() if config is None else config)
    bench.projector.show(np.full(bench.projector.resolution, 255, np.uint8))

    def source(settings: CameraSettings) -> tuple[bytes, str]:
        frame = bench.camera.capture(settings)
        return frame.data, frame.media_type

    return source


def developed(data: bytes, media_type: str) -> bytes:
    """A raw file as a JPEG of half its size, gamma 2.2; a JPEG as it is; grey where it is neither.

    Parameters
    ----------
    data, media_type
        A file and what it is.
    """
    if media_type == "image/jpeg":
        return data
    try:
        values = decode_raw(data).values
    except DriverError:
        values = np.full((*THUMBNAIL_PX, 3), 0.18, np.float32)
    shades = 255 * np.clip(values[..., ::-1], 0, 1) ** (1 / _GAMMA)
    return _jpeg(np.rint(shades).astype(np.uint8))


def thumbnail(jpeg: bytes) -> bytes:
    """A JPEG reduced to 160 × 120 pixels, as cameras show it."""
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        picture = np.full((*THUMBNAIL_PX, 3), 118, np.uint8)
    return _jpeg(cv2.resize(picture, THUMBNAIL_PX[::-1], interpolation=cv2.INTER_AREA))


def _jpeg(picture: cv2.typing.MatLike) -> bytes:
    done, data = cv2.imencode(".jpg", picture)
    if not done:
        raise ValueError(f"no JPEG can be made of {picture.shape} {picture.dtype}")
    return data.tobytes()
