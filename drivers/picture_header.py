"""What a TIFF, PNG or JPEG says about itself, checked before any memory is taken for it."""

from __future__ import annotations

import io
import math
import struct
from dataclasses import dataclass

import tifffile
from PIL import ImageCms, JpegImagePlugin, PngImagePlugin

from drivers.errors import DecodeError
from drivers.media import PICTURE_TYPES, media_type, open_tiff

MAX_PIXELS = 400_000_000
NAMES = {"image/tiff": "TIFF", "image/png": "PNG", "image/jpeg": "JPEG"}

# None, LZW, deflate (twice), PackBits, LZMA, Zstandard. Lossless ones only: a damaged JPEG strip
# would decode to wrong values without an error.
_COMPRESSIONS = {1, 5, 8, 32946, 32773, 34925, 50000}
_TIFF_TYPES = {"uint8", "uint16", "float16", "float32", "float64"}
_PHOTOMETRIC = {0: "white-is-zero", 3: "palette", 4: "mask", 5: "CMYK", 6: "YCbCr", 8: "CIE L*a*b*"}
_JPEG_MODES = {"L": 1, "RGB": 3}
_PNG_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}
_END_OF_PNG = b"\x00\x00\x00\x00IEND\xaeB`\x82"
_END_OF_JPEG = b"\xff\xd9"


@dataclass(frozen=True, slots=True)
class PictureHeader:
    """What a picture says about itself before a pixel is decoded.

    Parameters
    ----------
    media_type
        ``image/tiff``, ``image/png`` or ``image/jpeg``.
    height, width
        In pixels, not turned by any orientation tag.
    channels
        1 grey, 2 grey and transparency, 3 colour, 4 colour and transparency.
    dtype
        Type of a stored value: uint8, uint16, float16, float32 or float64.
    profile
        Description of the embedded ICC profile, None without one.
    """

    media_type: str
    height: int
    width: int
    channels: int
    dtype: str
    profile: str | None

    @property
    def is_float(self) -> bool:
        """Whether values are taken as they are."""
        return self.dtype.startswith("float")

    @property
    def has_alpha(self) -> bool:
        """Whether the last channel is transparency."""
        return self.channels in {2, 4}


def read_header(data: bytes) -> PictureHeader:
    """Read and check a picture's header; no memory is taken for its pixels.

    Parameters
    ----------
    data
        The whole file.

    Raises
    ------
    DecodeError
        No picture, one that was cut off, has more than 400 million pixels, or a kind whose
        numbers are no light: palette, CMYK, YCbCr, white-is-zero, fewer than 8 bits, several
        pages.
    """
    kind = media_type(data)
    if kind not in PICTURE_TYPES:
        raise DecodeError(f"the file is a raw file ({kind}), not a rendered picture")
    if kind == "image/tiff":
        with open_tiff(data) as file:
            return _tiff_header(file, len(data))
    read = _png_header if kind == "image/png" else _jpeg_header
    try:
        return read(data)
    except DecodeError:
        raise
    except Exception as error:
        # Pillow's parsers let out whatever they trip over, from SyntaxError to struct.error.
        reason = str(error) or type(error).__name__
        raise DecodeError(f"the {NAMES[kind]} has a damaged header ({reason[:200]})") from error


def _png_header(data: bytes) -> PictureHeader:
    width, height, depth, color_type = struct.unpack_from(">IIBB", data, 16)
    _check_size(height, width)
    if color_type == 3:
        raise DecodeError(
            "the PNG has a palette: its numbers are places in a list of colours; "
            "save it as grey or RGB of 8 or 16 bits"
        )
    if color_type not in _PNG_CHANNELS or depth not in {8, 16}:
        raise DecodeError(f"the PNG has {depth} bit(s) a channel; save it with 8 or 16")
    picture = PngImagePlugin.PngImageFile(io.BytesIO(data))
    if "transparency" in picture.info:
        raise DecodeError("the PNG marks one colour as transparent; save it without transparency")
    if getattr(picture, "is_animated", False):
        raise DecodeError("the PNG is animated; save each picture as a file of its own")
    if _END_OF_PNG not in data:
        raise DecodeError("the PNG is cut off: its end mark is missing; was it copied whole?")
    channels = _PNG_CHANNELS[color_type]
    # Deflate cannot shrink anything to less than 1/1032 (zlib's technical details).
    _check_length(len(data), height * (1 + width * channels * depth // 8) / 1032)
    profile = _profile(picture.info.get("icc_profile"))
    return PictureHeader("image/png", height, width, channels, f"uint{depth}", profile)


def _jpeg_header(data: bytes) -> PictureHeader:
    picture = JpegImagePlugin.JpegImageFile(io.BytesIO(data))
    _check_size(picture.height, picture.width)
    if picture.mode not in _JPEG_MODES:
        raise DecodeError(f"the JPEG holds {picture.mode} colours for print; save it as RGB")
    if data.find(_END_OF_JPEG, picture.fp.tell() if picture.fp else 0) < 0:
        raise DecodeError("the JPEG is cut off: its end mark is missing; was it copied whole?")
    # A block of 8 × 8 pixels takes a bit at the least (ITU-T T.81, F.1.2).
    _check_length(len(data), picture.height * picture.width / 64 / 8)
    profile = _profile(picture.info.get("icc_profile"))
    channels = _JPEG_MODES[picture.mode]
    return PictureHeader("image/jpeg", picture.height, picture.width, channels, "uint8", profile)


def _tiff_header(file: tifffile.TiffFile, size_bytes: int) -> PictureHeader:
    page = file.pages.first
    _check_size(page.imagelength, page.imagewidth)
    dtype = _tiff_dtype(page)
    for other in file.pages[1:]:
        if not isinstance(other, tifffile.TiffPage) or not other.is_reduced:
            raise DecodeError("the TIFF has several pages; save each picture as a file of its own")
    _check_segments(page, size_bytes)
    profile = page.tags.get("InterColorProfile")
    return PictureHeader(
        "image/tiff",
        page.imagelength,
        page.imagewidth,
        page.samplesperpixel,
        dtype,
        _profile(profile.value if profile else None),
    )


def _tiff_dtype(page: tifffile.TiffPage) -> str:
    """Type of the stored values of a kind of TIFF that holds light."""
    if page.compression not in _COMPRESSIONS:
        method = getattr(page.compression, "name", "an unknown method")
        raise DecodeError(
            f"the TIFF is compressed with {method}; save it without loss: uncompressed, LZW, "
            "deflate, PackBits, LZMA or Zstandard"
        )
    if page.photometric not in {1, 2}:
        kind = _PHOTOMETRIC.get(int(page.photometric), f"of photometric kind {page.photometric}")
        raise DecodeError(f"the TIFF is {kind}; save it as grey (black is zero) or RGB")
    dtype = page.dtype
    if dtype is None or dtype.name not in _TIFF_TYPES or page.bitspersample != 8 * dtype.itemsize:
        kind = "unknown" if dtype is None else dtype.name
        raise DecodeError(
            f"the TIFF has {page.bitspersample} bit(s) a channel, type {kind}; "
            "save it with 8 or 16 bits, unsigned, or as floating point"
        )
    grey = page.photometric == 1
    if page.samplesperpixel not in ({1, 2} if grey else {3, 4}) or page.imagedepth != 1:
        raise DecodeError(
            f"the TIFF has {page.samplesperpixel} channels and depth {page.imagedepth}; "
            "save it as flat grey or RGB"
        )
    return dtype.name


def _check_segments(page: tifffile.TiffPage, size_bytes: int) -> None:
    """Refuse strips and tiles that are missing, empty, out of the file or of absurd size."""
    if page.is_tiled:
        _check_size(page.tilelength, page.tilewidth)
    needed = math.prod(page.chunked)
    offsets, counts = page.dataoffsets, page.databytecounts
    if not len(offsets) == len(counts) == needed:
        raise DecodeError(
            f"the TIFF lists {len(offsets)} of the {needed} strips or tiles of its size: "
            "it is damaged"
        )
    inside = all(
        offset > 0 and count > 0 and offset + count <= size_bytes
        for offset, count in zip(offsets, counts, strict=True)
    )
    if not inside:
        raise DecodeError(
            "the TIFF is cut off: some of its pixels are not in the file; was it copied whole?"
        )
    if page.compression == 1 and sum(counts) < page.nbytes:
        raise DecodeError("the TIFF holds fewer bytes than its size needs: it is damaged")


def _check_size(height: int, width: int) -> None:
    if not 0 < height * width <= MAX_PIXELS:
        raise DecodeError(
            f"the file claims {width} × {height} pixels; 1 to {MAX_PIXELS} in all are read"
        )


def _check_length(size_bytes: int, least_bytes: float) -> None:
    if size_bytes < least_bytes:
        raise DecodeError(
            f"the file is damaged: its {size_bytes} bytes cannot hold the pixels that it claims"
        )


def _profile(icc: bytes | None) -> str | None:
    """Description of an ICC profile, for a note; a damaged one is no reason to refuse."""
    if not icc:
        return None
    try:
        text = ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(io.BytesIO(icc)))
    except (ImageCms.PyCMSError, OSError):
        return "unreadable"
    return "".join(c for c in text if c.isprintable()).strip()[:80] or "unnamed"
