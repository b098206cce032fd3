"""Rendered pictures of every kind that is read, and every kind that is refused."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image, ImageCms

from drivers.errors import DecodeError
from drivers.media import media_type
from drivers.picture import decode_picture, read_header
from drivers.protocols import CameraSettings
from drivers.sim.dng import encode_dng

HEIGHT, WIDTH = 5, 7
RNG = np.random.default_rng(20)
COLOR_8 = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
COLOR_16 = RNG.integers(0, 65536, (HEIGHT, WIDTH, 3), np.uint16)
OPAQUE = np.dstack([COLOR_8, np.full((HEIGHT, WIDTH), 255, np.uint8)])
COLOR_F = RNG.normal(0.3, 0.5, (HEIGHT, WIDTH, 3)).astype(np.float32)


def tiff(pixels: NDArray[Any], **options: Any) -> bytes:
    buffer = io.BytesIO()
    color = pixels.ndim == 3
    tifffile.imwrite(
        buffer, pixels, **({"photometric": "rgb" if color else "minisblack"} | options)
    )
    return buffer.getvalue()


def png(pixels: NDArray[Any]) -> bytes:
    """With OpenCV, which takes blue first."""
    order = {3: [2, 1, 0], 4: [2, 1, 0, 3]}
    stored = pixels[..., order[pixels.shape[2]]] if pixels.ndim == 3 else pixels
    return cv2.imencode(".png", stored)[1].tobytes()


def pillow(pixels: NDArray[np.uint8], kind: str, mode: str | None = None, **options: Any) -> bytes:
    buffer = io.BytesIO()
    picture = Image.fromarray(pixels)
    (picture.convert(mode) if mode else picture).save(buffer, kind, **options)
    return buffer.getvalue()


def png_of(width: int, height: int, depth: int, color_type: int, raw: bytes) -> bytes:
    """A PNG put together by hand, so that it can lie."""

    def chunk(name: bytes, body: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(name + body))
        return struct.pack(">I", len(body)) + name + body + check

    header = struct.pack(">IIBBBBB", width, height, depth, color_type, 0, 0, 0)
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(raw)), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def claiming(jpeg: bytes, height: int, width: int) -> bytes:
    """A JPEG with another size in its header."""
    start = jpeg.index(b"\xff\xc0") + 5
    return jpeg[:start] + struct.pack(">HH", height, width) + jpeg[start + 4 :]


def with_tag(data: bytes, name: str, value: int) -> bytes:
    """A little-endian TIFF with the single number of a tag overwritten."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        tag = file.pages.first.tags[name]
        changed = bytearray(data)
        size = {3: "<H", 4: "<I"}[int(tag.dtype)]
        struct.pack_into(size, changed, tag.valueoffset, value)
    return bytes(changed)


def srgb(encoded: NDArray[np.float64]) -> NDArray[np.float64]:
    """IEC 61966-2-1 once more, value by value."""
    light = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in encoded.flat]
    return np.array(light).reshape(encoded.shape)


STORED = {
    "tiff-8": (tiff(COLOR_8), COLOR_8),
    "tiff-8-deflate": (tiff(COLOR_8, compression="deflate", predictor=True), COLOR_8),
    "tiff-8-lzw": (tiff(COLOR_8, compression="lzw"), COLOR_8),
    "tiff-8-tiled": (tiff(COLOR_8, tile=(16, 16)), COLOR_8),
    "tiff-8-planar": (tiff(np.moveaxis(COLOR_8, -1, 0), planarconfig="separate"), COLOR_8),
    "tiff-8-bigtiff": (tiff(COLOR_8, bigtiff=True), COLOR_8),
    "tiff-16": (tiff(COLOR_16), COLOR_16),
    "tiff-16-big-endian": (tiff(COLOR_16, byteorder=">"), COLOR_16),
    "tiff-16-zstd-strips": (tiff(COLOR_16, compression="zstd", rowsperstrip=2), COLOR_16),
    "png-8": (png(COLOR_8), COLOR_8),
    "png-16": (png(COLOR_16), COLOR_16),
}


@pytest.mark.parametrize(("data", "codes"), STORED.values(), ids=STORED)
@pytest.mark.parametrize("transfer", ["linear", "srgb"])
def test_integers_become_fractions_of_their_largest_value(
    data: bytes, codes: NDArray[Any], transfer: str
) -> None:
    largest = np.iinfo(codes.dtype).max
    image = decode_picture(data, "srgb" if transfer == "srgb" else "linear")
    encoded = codes / largest
    expected = srgb(encoded) if transfer == "srgb" else encoded
    assert image.values.dtype == np.float32
    assert image.values.flags.c_contiguous
    np.testing.assert_array_equal(image.values, expected.astype(np.float32))
    np.testing.assert_array_equal(image.saturated, (codes == largest).any(axis=2))


@pytest.mark.parametrize(
    "data",
    [
        tiff(COLOR_F),
        tiff(COLOR_F, compression="deflate", predictor=True),
        tiff(COLOR_F.astype(np.float64)),
    ],
    ids=["float32", "float32-deflate", "float64"],
)
def test_floating_point_is_taken_as_it_is(data: bytes) -> None:
    image = decode_picture(data, "linear")
    np.testing.assert_array_equal(image.values, COLOR_F)
    assert not image.saturated.any()


@pytest.mark.parametrize("encode", [tiff, png], ids=["tiff", "png"])
def test_grey_is_repeated_in_three_channels(encode: Callable[..., bytes]) -> None:
    grey = COLOR_16[..., 0]
    image = decode_picture(encode(grey), "linear")
    np.testing.assert_array_equal(
        image.values, np.repeat(grey[..., None] / 65535, 3, axis=2).astype(np.float32)
    )


def test_srgb_has_the_known_values() -> None:
    # 10 is the last code of the straight part; 188 is the well-known middle, 50.3 % of the light.
    codes = np.array([[0, 10, 11, 188, 255]], np.uint8)
    values = decode_picture(png(codes), "srgb").values[0, :, 0]
    np.testing.assert_allclose(values, [0, 0.003035270, 0.003346536, 0.502886458, 1], rtol=1e-6)


def test_jpeg_keeps_colors_apart_and_marks_clipped_light_with_a_margin() -> None:
    codes = np.zeros((16, 96, 3), np.uint8)
    for place, color in enumerate([(200, 30, 30), (30, 200, 30), (30, 30, 200)]):
        codes[:, 16 * place : 16 * place + 16] = color
    for place, level in enumerate([249, 250, 255]):
        codes[:, 48 + 16 * place : 64 + 16 * place] = level
    image = decode_picture(pillow(codes, "JPEG", quality=100, subsampling=0), "linear")
    # One unit of rounding in each of YCbCr and back.
    np.testing.assert_allclose(image.values * 255, codes, atol=2.01)
    np.testing.assert_array_equal(image.saturated[0], np.arange(96) >= 64)


def test_orientation_is_ignored() -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    turned, plain = pillow(COLOR_8, "PNG", exif=exif), pillow(COLOR_8, "PNG")
    assert turned != plain
    for data in (turned, plain):
        np.testing.assert_array_equal(decode_picture(data, "linear").values * 255, COLOR_8)
    jpeg = decode_picture(pillow(COLOR_8, "JPEG", exif=exif), "linear")
    assert jpeg.values.shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize(
    "data",
    [png(OPAQUE), tiff(OPAQUE, extrasamples=["unassalpha"])],
    ids=["png", "tiff"],
)
def test_an_opaque_transparency_channel_is_dropped(data: bytes) -> None:
    assert read_header(data).has_alpha
    np.testing.assert_array_equal(decode_picture(data, "linear").values * 255, COLOR_8)


def test_grey_with_opaque_transparency_is_grey() -> None:
    codes = np.dstack([COLOR_8[..., 0], np.full((HEIGHT, WIDTH), 255, np.uint8)])
    values = decode_picture(pillow(codes, "PNG", mode="LA"), "linear").values
    np.testing.assert_array_equal(values * 255, np.repeat(COLOR_8[..., :1], 3, axis=2))


def test_a_reduced_page_beside_the_full_one_is_no_obstacle() -> None:
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer) as writer:
        writer.write(COLOR_8, photometric="rgb")
        writer.write(COLOR_8[::2, ::2], photometric="rgb", subfiletype=1)
    np.testing.assert_array_equal(decode_picture(buffer.getvalue(), "linear").values * 255, COLOR_8)


@pytest.mark.parametrize(
    ("data", "kind", "dtype"),
    [
        (STORED["tiff-16"][0], "image/tiff", "uint16"),
        (tiff(COLOR_F), "image/tiff", "float32"),
        (STORED["png-16"][0], "image/png", "uint16"),
        (pillow(COLOR_8, "JPEG"), "image/jpeg", "uint8"),
    ],
    ids=["tiff-16", "tiff-float", "png-16", "jpeg"],
)
def test_the_header_is_known_before_decoding(data: bytes, kind: str, dtype: str) -> None:
    header = read_header(data)
    assert (header.media_type, header.dtype) == (kind, dtype)
    assert (header.height, header.width, header.channels) == (HEIGHT, WIDTH, 3)
    assert header.profile is None


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "TIFF"])
def test_the_header_names_the_color_profile(kind: str) -> None:
    icc = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    assert "sRGB" in str(read_header(pillow(COLOR_8, kind, icc_profile=icc)).profile)
    assert read_header(pillow(COLOR_8, kind, icc_profile=b"no profile")).profile == "unreadable"


def _pages() -> bytes:
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer) as writer:
        writer.write(COLOR_8, photometric="rgb")
        writer.write(COLOR_8, photometric="rgb")
    return buffer.getvalue()


def _holed(value: float) -> bytes:
    pixels = COLOR_F.copy()
    pixels[1, 2, 0] = value
    return tiff(pixels)


HALF_CLEAR = np.dstack([COLOR_8, np.full((HEIGHT, WIDTH), 128, np.uint8)])
FRAMES = [Image.fromarray(COLOR_8), Image.fromarray(255 - COLOR_8)]
JPEG = pillow(COLOR_8, "JPEG")
REFUSED = {
    "empty": (b"", "empty"),
    "text": (b"file,role\n", "neither TIFF, PNG or JPEG"),
    "gif": (pillow(COLOR_8, "GIF"), "neither TIFF, PNG or JPEG"),
    "raw": (
        encode_dng(np.full((4, 6), 900, np.uint16), CameraSettings(0.1)),
        "raw file (image/x-adobe-dng)",
    ),
    "png-palette": (pillow(COLOR_8, "PNG", mode="P"), "palette"),
    "png-1-bit": (pillow(COLOR_8, "PNG", mode="1"), "1 bit(s)"),
    "png-4-bit": (png_of(2, 2, 4, 0, bytes(4)), "4 bit(s)"),
    "png-transparent": (png(HALF_CLEAR), "partly transparent"),
    "png-color-key": (pillow(COLOR_8, "PNG", transparency=(1, 2, 3)), "one colour as transparent"),
    "png-animated": (
        pillow(COLOR_8, "PNG", save_all=True, append_images=FRAMES),
        "animated",
    ),
    "png-absurd": (png_of(1 << 30, 1 << 30, 8, 2, bytes(9)), "1073741824 × 1073741824"),
    "png-no-size": (png_of(0, 5, 8, 2, bytes(9)), "claims 0 × 5"),
    "png-too-few-rows": (png_of(20, 20, 8, 2, bytes(61)), "damaged"),
    "png-bomb": (png_of(20000, 20000, 16, 2, bytes(61)), "cannot hold"),
    "jpeg-bomb": (claiming(JPEG, 60000, 6000), "cannot hold"),
    "png-cut-off": (STORED["png-16"][0][:-6], "cut off"),
    "png-cut-in-header": (STORED["png-16"][0][:20], "damaged header"),
    "jpeg-cmyk": (pillow(COLOR_8, "JPEG", mode="CMYK"), "CMYK"),
    "jpeg-cut-off": (JPEG[: len(JPEG) - 30], "cut off"),
    "jpeg-cut-in-header": (JPEG[:100], "damaged header"),
    "tiff-1-bit": (pillow(COLOR_8, "TIFF", mode="1"), "1 bit(s)"),
    "tiff-12-bit": (with_tag(tiff(COLOR_16[..., 0]), "BitsPerSample", 12), "12 bit(s)"),
    "tiff-signed": (tiff(COLOR_16.astype(np.int16)), "type int16"),
    "tiff-32-bit": (tiff(COLOR_16.astype(np.uint32)), "type uint32"),
    "tiff-white-is-zero": (tiff(COLOR_8[..., 0], photometric="miniswhite"), "white-is-zero"),
    "tiff-palette": (pillow(COLOR_8, "TIFF", mode="P"), "palette"),
    "tiff-cmyk": (pillow(COLOR_8, "TIFF", mode="CMYK"), "CMYK"),
    "tiff-jpeg": (
        tiff(RNG.integers(0, 9, (64, 64, 3), np.uint8), compression="jpeg"),
        "JPEG",
    ),
    "tiff-transparent": (tiff(HALF_CLEAR, extrasamples=["unassalpha"]), "partly transparent"),
    "tiff-five-channels": (tiff(np.dstack([COLOR_8, COLOR_8[..., :2]])), "5 channels"),
    "tiff-pages": (_pages(), "several pages"),
    "tiff-nan": (_holed(np.nan), "1 values of the picture are not finite"),
    "tiff-infinite": (_holed(-np.inf), "not finite"),
    "tiff-too-large-for-float32": (tiff(COLOR_F * np.float64(1e300)), "not finite"),
    "tiff-absurd": (
        with_tag(with_tag(tiff(COLOR_8), "ImageWidth", 65535), "ImageLength", 65535),
        "65535 × 65535",
    ),
    "tiff-taller-than-its-bytes": (with_tag(tiff(COLOR_8), "ImageLength", 60000), "damaged"),
    "tiff-cut-off": (tiff(COLOR_8)[:-9], "cut off"),
    "tiff-empty-strip": (with_tag(tiff(COLOR_8), "StripByteCounts", 0), "cut off"),
    "tiff-cut-in-header": (tiff(COLOR_8)[:40], "damaged"),
    "tiff-damaged-deflate": (
        tiff(COLOR_8, compression="deflate")[:-40] + bytes(40),
        "damaged",
    ),
}


@pytest.mark.parametrize(("data", "words"), REFUSED.values(), ids=REFUSED)
def test_what_holds_no_light_is_refused_by_name(data: bytes, words: str) -> None:
    with pytest.raises(DecodeError) as caught:
        decode_picture(data, "linear")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_floating_point_cannot_have_the_srgb_curve() -> None:
    with pytest.raises(DecodeError, match="sRGB"):
        decode_picture(tiff(COLOR_F), "srgb")


def test_an_unknown_transfer_is_a_bad_argument() -> None:
    with pytest.raises(ValueError, match="'gamma'"):
        decode_picture(png(COLOR_8), "gamma")  # type: ignore[arg-type] # the point of the test


@pytest.mark.parametrize(
    "case", ["png-absurd", "png-bomb", "jpeg-bomb", "tiff-absurd", "tiff-taller-than-its-bytes"]
)
def test_an_absurd_size_takes_no_memory(case: str) -> None:
    data, _ = REFUSED[case]
    tracemalloc.start()
    try:
        with pytest.raises(DecodeError):
            decode_picture(data, "linear")
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak_bytes < 1_000_000


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"II\x1a\x00\x00\x00HEAPCCDR" + bytes(9), "image/x-canon-crw"),
        (b"II*\x00\x10\x00\x00\x00CR\x02\x00" + bytes(9), "image/x-canon-cr2"),
        (b"\x00\x00\x00\x18ftypcrx " + bytes(9), "image/x-canon-cr3"),
        (b"FUJIFILMCCD-RAW 0201", "image/x-fuji-raf"),
        (b"IIRO\x08\x00\x00\x00", "image/x-olympus-orf"),
        (b"IIU\x00\x08\x00\x00\x00", "image/x-panasonic-rw2"),
        (REFUSED["raw"][0], "image/x-adobe-dng"),
        (tiff(COLOR_8), "image/tiff"),
    ],
    ids=["crw", "cr2", "cr3", "raf", "orf", "rw2", "dng", "tiff"],
)
def test_content_tells_the_kind_of_file(data: bytes, expected: str) -> None:
    assert media_type(data) == expected


@pytest.mark.parametrize(
    ("maker", "expected"),
    [
        ("NIKON CORPORATION", "image/x-nikon-nef"),
        ("SONY", "image/x-sony-arw"),
        ("PENTAX", "image/x-pentax-pef"),
        ("Other", "image/x-raw"),
    ],
)
def test_a_mosaic_in_a_subfile_makes_a_tiff_a_raw(maker: str, expected: str) -> None:
    buffer = io.BytesIO()
    with tifffile.TiffWriter(buffer) as writer:
        make = [(271, "s", 0, maker, True)]
        writer.write(COLOR_8, photometric="rgb", subifds=1, extratags=make, metadata=None)
        writer.write(COLOR_16[..., 0], photometric=32803, metadata=None)
    assert media_type(buffer.getvalue()) == expected
    assert media_type(tiff(COLOR_8, extratags=make)) == "image/tiff"


BLACK = np.zeros((2000, 2000), np.uint8)
UNIFORM = {
    "png": pillow(BLACK, "PNG", compress_level=9),
    "jpeg": pillow(BLACK, "JPEG", quality=1),
    "jpeg-progressive": pillow(BLACK, "JPEG", quality=1, progressive=True, optimize=True),
}


@pytest.mark.parametrize("data", UNIFORM.values(), ids=UNIFORM)
def test_the_best_possible_compression_is_not_taken_for_damage(data: bytes) -> None:
    assert np.ptp(decode_picture(data, "srgb").values) == 0


SEEDS = [data for data, _ in STORED.values()] + [JPEG, tiff(COLOR_F), pillow(COLOR_8, "PNG")]


@given(
    seed=st.sampled_from(SEEDS),
    edits=st.lists(
        st.tuples(st.integers(0, 1 << 12), st.binary(min_size=1, max_size=4)), max_size=6
    ),
    kept=st.integers(0, 1 << 12),
)
def test_whatever_the_bytes_only_a_decode_error_comes_out(
    seed: bytes, edits: list[tuple[int, bytes]], kept: int
) -> None:
    changed = bytearray(seed)
    for place, new in edits:
        start = place % len(changed)
        changed[start : start + len(new)] = new
    if kept < len(changed):
        del changed[len(changed) - kept :]
    try:
        image = decode_picture(bytes(changed), "linear")
    except DecodeError:
        return
    assert image.values.shape == (*image.saturated.shape, 3)
    assert np.isfinite(image.values).all()
