from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
import rawpy
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from drivers.errors import DecodeError
from drivers.image import Demosaic, LinearImage
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.dng import encode_dng

EXPOSURE = CameraSettings(0.1, 8.0, 200)
PHASES = {"RGGB": (0, 1, 1, 2), "GRBG": (1, 0, 2, 1), "GBRG": (1, 2, 0, 1), "BGGR": (2, 1, 1, 0)}
CFA = 32803
LINEAR_RAW = 34892
GREY = 1


def counts(height: int = 40, width: int = 60) -> NDArray[np.uint16]:
    return np.random.default_rng(5).integers(300, 16000, (height, width)).astype(np.uint16)


def dng(
    mosaic: NDArray[np.uint16],
    pattern: tuple[int, ...] = PHASES["RGGB"],
    black: tuple[int, ...] = (512,),
    photometric: int = CFA,
) -> bytes:
    """A DNG as another maker would write it."""
    tags: list[tuple[int, str, int, Any, bool]] = [
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),
        (50708, "s", 0, "test camera", True),
        (50721, "2i", 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1), True),
        (50717, "H", 1, 16000, True),
    ]
    if photometric == CFA:
        side = round(len(pattern) ** 0.5)
        tags += [
            (33421, "H", 2, (side, side), True),
            (33422, "B", len(pattern), bytes(pattern), True),
        ]
        if len(black) == 4:
            tags.append((50713, "H", 2, (2, 2), True))
        tags.append((50714, "H", len(black), black if len(black) > 1 else black[0], True))
    buffer = io.BytesIO()
    tifffile.imwrite(
        buffer,
        mosaic,
        photometric=photometric,
        metadata=None,
        extratags=tags,
        planarconfig="contig" if mosaic.ndim == 3 else None,
    )
    return buffer.getvalue()


def monochrome_dng() -> bytes:
    """A linear DNG of one channel, as monochrome cameras write it."""
    entry = (262).to_bytes(2, "little") + b"\x03\x00\x01\x00\x00\x00"
    grey = entry + GREY.to_bytes(4, "little")
    return dng(counts(), photometric=GREY).replace(grey, entry + LINEAR_RAW.to_bytes(4, "little"))


def test_a_simulated_file_holds_the_counts_unchanged_and_libraw_agrees_on_its_levels() -> None:
    mosaic = counts()
    with rawpy.imread(io.BytesIO(encode_dng(mosaic, EXPOSURE))) as raw:
        np.testing.assert_array_equal(raw.raw_image_visible, mosaic)
        assert raw.black_level_per_channel == [512] * 4
        assert raw.white_level == 16383
        assert raw.color_desc == b"RGBG"
        assert raw.other.shutter_speed == pytest.approx(0.1)
        assert raw.other.aperture == 8


def test_a_simulated_file_is_the_same_whenever_it_is_written() -> None:
    assert encode_dng(counts(), EXPOSURE) == encode_dng(counts().copy(), EXPOSURE)


def test_a_mosaic_with_an_odd_side_is_not_written() -> None:
    with pytest.raises(ValueError, match="41, 60"):
        encode_dng(counts(41), EXPOSURE)


@pytest.mark.parametrize("pattern", PHASES.values(), ids=PHASES.keys())
@pytest.mark.parametrize(
    ("height", "width"), [(40, 60), pytest.param(41, 61, id="odd"), (40, 61), (41, 60)]
)
@pytest.mark.parametrize(
    "black", [pytest.param((512,), id="one-black"), pytest.param((500, 510, 520, 530), id="four")]
)
def test_quads_become_pixels(
    pattern: tuple[int, ...], height: int, width: int, black: tuple[int, ...]
) -> None:
    mosaic = counts(height, width)
    image = decode_raw(dng(mosaic, pattern, black))
    levels = black if len(black) == 4 else black * 4
    planes: dict[int, list[NDArray[np.float64]]] = {0: [], 1: [], 2: []}
    for site, (colour, level) in enumerate(zip(pattern, levels, strict=True)):
        plane = mosaic[site // 2 : height // 2 * 2 : 2, site % 2 : width // 2 * 2 : 2]
        planes[colour].append((plane - float(level)) / (16000 - level))
    expected = np.stack([np.mean(planes[colour], axis=0) for colour in range(3)], axis=-1)
    assert image.values.dtype == np.float32
    np.testing.assert_allclose(image.values, expected, atol=2e-7)


@pytest.mark.parametrize("demosaic", Demosaic)
def test_memory_that_is_given_is_written_over(demosaic: Demosaic) -> None:
    data, larger = (encode_dng(counts(*size), EXPOSURE) for size in ((40, 60), (44, 60)))
    image = decode_raw(data, demosaic)
    room = LinearImage(np.full_like(image.values, np.nan), ~image.saturated)
    again = decode_raw(data, demosaic, room)
    assert again.values is room.values
    np.testing.assert_array_equal(again.values, image.values)
    np.testing.assert_array_equal(again.saturated, image.saturated)
    assert len(decode_raw(larger, demosaic, room).values) > len(room.values)
    np.testing.assert_array_equal(room.values, image.values)


def test_values_below_black_stay_negative() -> None:
    image = decode_raw(encode_dng(np.full((40, 60), 507, np.uint16), EXPOSURE))
    np.testing.assert_allclose(image.values, -5 / (16383 - 512), rtol=1e-6)


@pytest.mark.parametrize("site", [(10, 20), (10, 21), (11, 20), (11, 21)])
@pytest.mark.parametrize(
    ("count", "saturated"),
    # 99 % of the range above black: 512 + 0.99 · 15871 = 16224.3.
    [(16383, True), (16225, True), (16224, False), (9000, False)],
)
def test_one_photosite_near_the_white_level_marks_its_pixel(
    site: tuple[int, int], count: int, saturated: bool
) -> None:
    mosaic = np.full((40, 60), 2000, np.uint16)
    mosaic[site] = count
    marked = decode_raw(encode_dng(mosaic, EXPOSURE)).saturated
    assert marked[5, 10] == saturated
    assert marked.sum() == int(saturated)


# Of a plane that is 0 where it has no photosites: a mean of the two or four nearest that it has.
GREEN_WEIGHTS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]]) / 4
RED_OR_BLUE_WEIGHTS = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4


@pytest.mark.parametrize("pattern", PHASES.values(), ids=PHASES.keys())
@pytest.mark.parametrize(
    ("height", "width"), [(40, 60), pytest.param(41, 61, id="odd"), (40, 61), (41, 60)]
)
@pytest.mark.parametrize(
    "black", [pytest.param((512,), id="one-black"), pytest.param((500, 510, 520, 530), id="four")]
)
def test_missing_colours_are_means_of_the_nearest_that_have_them(
    pattern: tuple[int, ...], height: int, width: int, black: tuple[int, ...]
) -> None:
    mosaic = counts(height, width)
    image = decode_raw(dng(mosaic, pattern, black), Demosaic.BILINEAR)
    tiles = height // 2 + 1, width // 2 + 1
    levels = np.tile(np.reshape(black if len(black) == 4 else black * 4, (2, 2)), tiles)
    colours = np.tile(np.reshape(pattern, (2, 2)), tiles)[:height, :width]
    levels = levels[:height, :width].astype(float)
    light = (mosaic - levels) / (16000 - levels)
    expected = [
        ndimage.convolve(np.where(colours == colour, light, 0), weights, mode="mirror")
        for colour, weights in enumerate((RED_OR_BLUE_WEIGHTS, GREEN_WEIGHTS, RED_OR_BLUE_WEIGHTS))
    ]
    assert image.values.dtype == np.float32
    np.testing.assert_allclose(image.values, np.stack(expected, axis=-1), atol=3e-7)


def test_interpolation_keeps_a_ramp_and_values_below_black() -> None:
    down, right = np.mgrid[:40, :60]
    ramp = (500 + 30 * down + 40 * right).astype(np.uint16)
    values = decode_raw(encode_dng(ramp, EXPOSURE), Demosaic.BILINEAR).values
    expected = (ramp - 512.0) / (16383 - 512)
    for colour in range(3):
        np.testing.assert_allclose(values[1:-1, 1:-1, colour], expected[1:-1, 1:-1], atol=2e-7)
    dark = encode_dng(np.full((40, 60), 507, np.uint16), EXPOSURE)
    below = decode_raw(dark, Demosaic.BILINEAR).values
    np.testing.assert_allclose(below, -5 / (16383 - 512), rtol=1e-6)


@pytest.mark.parametrize("pattern", PHASES.values(), ids=PHASES.keys())
@pytest.mark.parametrize(
    "site",
    [(10, 20), (10, 21), (11, 20), (11, 21), (0, 0), (0, 60), (40, 0), (40, 60), (0, 7), (39, 60)],
)
def test_a_saturated_photosite_marks_every_pixel_that_it_went_into(
    pattern: tuple[int, ...], site: tuple[int, int]
) -> None:
    mosaic = np.full((41, 61), 2000, np.uint16)
    before = decode_raw(dng(mosaic, pattern), Demosaic.BILINEAR)
    mosaic[site] = 16000
    after = decode_raw(dng(mosaic, pattern), Demosaic.BILINEAR)
    touched = np.any(after.values != before.values, axis=-1)
    assert touched.sum() >= 3
    np.testing.assert_array_equal(after.saturated, touched)
    assert not before.saturated.any()


XTRANS = (1, 1, 0, 1, 1, 2, 1, 1, 2, 1, 1, 0, 2, 0, 1, 0, 2, 1) * 2
JPEG = b"\xff\xd8\xff\xe1" + bytes(range(256)) * 20


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        pytest.param(b"", "empty", id="empty"),
        pytest.param(b"not a picture at all" * 500, "no raw|not a raw", id="text"),
        pytest.param(JPEG, "is a JPEG", id="jpeg"),
        pytest.param(b"\x89PNG\r\n" + bytes(5000), "is a PNG", id="png"),
        pytest.param(encode_dng(counts(), EXPOSURE)[:-500], "ends too early", id="cut-short"),
        pytest.param(encode_dng(counts(), EXPOSURE)[:300], "not a raw|ends too early", id="stump"),
        pytest.param(dng(np.zeros((40, 60), np.uint16)), "reads 0", id="zeros"),
        pytest.param(dng(counts(42, 60), XTRANS), "X-Trans", id="x-trans"),
        pytest.param(
            dng(np.dstack([counts()] * 3), photometric=LINEAR_RAW), "several values", id="linear"
        ),
        pytest.param(monochrome_dng(), "no 2 × 2 Bayer mosaic", id="monochrome"),
        pytest.param(dng(counts(), black=(16000,)), "not above black", id="no-range"),
    ],
)
def test_what_cannot_be_measured_is_refused_by_name(data: bytes, reason: str) -> None:
    with pytest.raises(DecodeError, match=reason):
        decode_raw(data)


def test_absurd_sizes_are_refused_before_memory_is_taken() -> None:
    data = bytearray(encode_dng(counts(), EXPOSURE))
    for tag in (256, 257):
        at = data.index(tag.to_bytes(2, "little") + b"\x04\x00\x01\x00\x00\x00")
        data[at + 8 : at + 12] = (60_000).to_bytes(4, "little")
    with pytest.raises(DecodeError, match="60000 × 60000"):
        decode_raw(bytes(data))


@settings(max_examples=60, deadline=None)
@given(place=st.integers(0, 700), value=st.integers(0, 255))
def test_a_damaged_header_is_decoded_or_refused_and_nothing_else(place: int, value: int) -> None:
    data = bytearray(encode_dng(counts(), EXPOSURE))
    data[place] = value
    try:
        image = decode_raw(bytes(data))
    except DecodeError:
        return
    assert image.values.shape == (*image.saturated.shape, 3)
