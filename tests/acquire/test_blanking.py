"""What could not be measured, blanked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquire.blanking import Unusable
from acquire.result import PixelClass, read_tiff, write_tiff

SHAPE = (20, 30)


@pytest.mark.parametrize("spoilt", [True, False], ids=["some pixels", "no pixel"])
def test_a_file_is_blanked_where_its_image_is(tmp_path: Path, spoilt: bool) -> None:
    rng = np.random.default_rng(0)
    image = rng.random((*SHAPE, 3)).astype(np.float32)
    mask = np.full(SHAPE, PixelClass.MEASURED, np.uint8)
    if spoilt:
        mask[3, 4:9], mask[15:] = PixelClass.SATURATED, PixelClass.UNLIT
    path = tmp_path / "one.tiff"
    write_tiff(path, image)
    size = path.stat().st_size
    Unusable.of(mask).blank_file(path)
    found = read_tiff(path, image.shape, np.float32)
    assert path.stat().st_size == size
    expected = image.copy()
    expected[mask == PixelClass.SATURATED] = np.nan
    expected[mask == PixelClass.UNLIT] = 0
    np.testing.assert_array_equal(found, expected)
    Unusable.of(mask).blank(image)
    np.testing.assert_array_equal(image, expected)
