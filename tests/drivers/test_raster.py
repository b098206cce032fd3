from __future__ import annotations

import hashlib

import numpy as np

from drivers.raster import raster_digest


def test_a_digest_covers_shape_type_and_values() -> None:
    raster = np.arange(6, dtype=np.uint8).reshape(2, 3)
    expected = hashlib.sha256(b"2x3 uint8\n" + bytes(range(6))).hexdigest()
    assert raster_digest(raster) == expected
    assert raster_digest(raster.reshape(3, 2)) != expected
    assert raster_digest(raster + np.uint8(1)) != expected


def test_the_layout_in_memory_does_not_matter() -> None:
    raster = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert raster_digest(np.asfortranarray(raster)) == raster_digest(raster)
    assert raster_digest(np.repeat(raster, 2, axis=1)[:, ::2]) == raster_digest(raster)
