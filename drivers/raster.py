"""What a raster must be, and the digest by which one is recognised."""

from __future__ import annotations

import hashlib

import numpy as np

from drivers.protocols import Raster


def check_raster(raster: Raster, resolution: tuple[int, int]) -> None:
    """Raise ValueError unless `raster` is uint8 and fits `resolution`.

    Parameters
    ----------
    raster
        uint8, (height, width) or (height, width, 3).
    resolution
        (height, width) of the projector in pixels.
    """
    if raster.dtype != np.uint8:
        raise ValueError(f"a raster is uint8, not {raster.dtype}")
    if raster.shape not in {resolution, (*resolution, 3)}:
        raise ValueError(
            f"raster {raster.shape} does not fit the projector: "
            f"it takes {resolution} or {(*resolution, 3)}"
        )


def raster_digest(raster: Raster) -> str:
    """SHA-256 over a raster's shape, dtype and values, as 64 hexadecimal digits.

    The same light in another memory layout has the same digest; a grey raster and its copy in
    three colours have different ones.
    """
    head = f"{'x'.join(map(str, raster.shape))} {raster.dtype.name}\n".encode()
    return hashlib.sha256(head + np.ascontiguousarray(raster).tobytes()).hexdigest()
