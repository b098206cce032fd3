"""Images on the disk give the parts that images in memory give."""

from pathlib import Path

import numpy as np
import pytest

from acquire.errors import StorageError
from acquire.parked import ParkedImages

SHAPE = (4, 11, 7, 3)
EVERY = slice(None)


@pytest.mark.parametrize(
    "part",
    [
        pytest.param((EVERY, EVERY, EVERY), id="all"),
        pytest.param((EVERY, slice(2, 5), EVERY), id="lines"),
        pytest.param((EVERY, slice(9, 14), EVERY), id="lines-beyond-the-last"),
        pytest.param((EVERY, slice(None, None, 3), slice(None, None, 3)), id="lattice"),
        pytest.param((slice(1, 3), slice(4, 4), EVERY), id="none"),
        pytest.param((EVERY, slice(1, 4), slice(2, 6)), id="columns"),
    ],
)
def test_parts_are_those_of_the_images(tmp_path: Path, part: tuple[slice, slice, slice]) -> None:
    images = np.random.default_rng(1).random(SHAPE, np.float32)
    parked = ParkedImages.park(tmp_path / "images", images)
    np.testing.assert_array_equal(parked[part], images[part])


def test_a_file_that_was_cut_is_no_image(tmp_path: Path) -> None:
    path = tmp_path / "images"
    parked = ParkedImages.park(path, np.ones(SHAPE, np.float32))
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 1)
    with pytest.raises(StorageError, match="images has become shorter"):
        parked[EVERY, EVERY, EVERY]
    path.unlink()
    with pytest.raises(StorageError, match="No such file"):
        parked[EVERY, EVERY, EVERY]
