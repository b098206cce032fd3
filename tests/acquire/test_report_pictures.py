"""Linear light becomes a picture: the curve, the average, the marks."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image

from acquire.remix import SATURATED_RGB
from acquire.report.pictures import (
    UNLIT_RGB,
    mask_map,
    photograph,
    reduced,
    sign_map,
)
from acquire.result import PixelClass
from acquire.tone import encode, exposure_of


@pytest.mark.parametrize(
    ("linear", "encoded"),
    [(-1.0, 0), (0.0, 0), (0.0031308, 10), (0.18, 118), (0.5, 188), (1.0, 255), (7.0, 255)],
)
def test_transfer_curve_of_srgb(linear: float, encoded: int) -> None:
    assert encode(np.array([linear]))[0] == encoded


def test_reduction_averages_linear_light() -> None:
    lit = (np.indices((8, 8)).sum(axis=0) % 2).astype(np.float32)
    checks = np.stack([lit, lit, lit], axis=2)
    picture = photograph(checks, 1.0, 4, "checks")
    pixels = np.asarray(Image.open(io.BytesIO(picture.png)))
    assert pixels.shape == (4, 4, 3)
    assert (pixels == 188).all()  # sRGB of one half, not 128


def test_reduction_leaves_out_what_was_not_measured() -> None:
    image = np.full((5, 6, 3), 0.25, np.float32)
    image[0, 0] = np.nan  # one of four: the block keeps its value
    image[2:4, 2] = np.nan  # two of four: the block is unknown
    image[4, 5, 1] = np.inf  # one of the two pixels of a smaller block
    blocks = reduced(image, 2)
    assert blocks.shape == (3, 3, 3)
    unknown = np.isnan(blocks).any(axis=2)
    assert unknown.tolist() == [[False] * 3, [False, True, False], [False, False, True]]
    assert np.all(blocks[~unknown] == 0.25)


def test_one_masked_pixel_marks_its_block() -> None:
    mask = np.zeros((8, 8), np.uint8)
    mask[0, 0], mask[0, 1], mask[7, 7] = PixelClass.UNLIT, PixelClass.SATURATED, PixelClass.UNLIT
    picture = mask_map(np.ones((8, 8, 3), np.float32), mask, 1.0, 4, "mask")
    pixels = np.asarray(Image.open(io.BytesIO(picture.png)))
    assert tuple(pixels[0, 0]) == tuple(SATURATED_RGB)
    assert tuple(pixels[3, 3]) == tuple(UNLIT_RGB)
    assert len({tuple(colour) for colour in pixels.reshape(-1, 3)}) == 3


def test_zero_is_white_in_the_map_of_signs() -> None:
    picture = sign_map(np.zeros((2, 2, 3), np.float32), 1.0, 4, "signs")
    assert (np.asarray(Image.open(io.BytesIO(picture.png))) == 255).all()


@pytest.mark.parametrize(
    ("value", "expected"), [(0.5, 2.0), (0.0, 1.0), (-1.0, 1.0), (math.nan, 1.0)]
)
def test_exposure(value: float, expected: float) -> None:
    assert exposure_of(np.full((2, 2, 3), value, np.float32)) == expected
