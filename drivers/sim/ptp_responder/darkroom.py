"""JPEGs of the simulated camera's raw files."""

from __future__ import annotations

import cv2
import numpy as np

from drivers.errors import DriverError
from drivers.raw import decode_raw
from drivers.sim.ptp_responder.source import JPEG, THUMBNAIL_PX

_GAMMA = 2.2


class Darkroom:
    """Develops with LibRaw (see `drivers.sim.ptp_responder.source.Developer`)."""

    def jpeg(self, data: bytes, media_type: str) -> bytes:
        """A raw file at half its size, gamma 2.2; a JPEG as it is; grey where it is neither."""
        if media_type == JPEG:
            return data
        try:
            values = decode_raw(data).values
        except DriverError:
            values = np.full((*THUMBNAIL_PX, 3), 0.18, np.float32)
        shades = 255 * np.clip(values[..., ::-1], 0, 1) ** (1 / _GAMMA)
        return _encoded(np.rint(shades).astype(np.uint8))

    def thumbnail(self, data: bytes, media_type: str) -> bytes:
        """A file reduced to 160 × 120 pixels, as cameras show it."""
        developed = np.frombuffer(self.jpeg(data, media_type), np.uint8)
        picture = cv2.imdecode(developed, cv2.IMREAD_COLOR)
        if picture is None:
            picture = np.full((*THUMBNAIL_PX, 3), 118, np.uint8)
        return _encoded(cv2.resize(picture, THUMBNAIL_PX[::-1], interpolation=cv2.INTER_AREA))


def _encoded(picture: cv2.typing.MatLike) -> bytes:
    done, data = cv2.imencode(".jpg", picture)
    if not done:
        raise ValueError(f"no JPEG can be made of {picture.shape} {picture.dtype}")
    return data.tobytes()
