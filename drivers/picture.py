"""Rendered pictures, TIFF, PNG and JPEG, to linear light.

Integer values are divided by the largest of their type, and decoded with the curve of sRGB where
the picture is said to have it; floating-point values are taken as they are. Colour profiles are
not applied, and an orientation that the camera noted is ignored: rows and columns stay those of
the sensor, the same in every frame.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal, TypeAlias

import cv2
import numpy as np
import tifffile
from numpy.typing import NDArray

from drivers.errors import DecodeError
from drivers.image import LinearImage
from drivers.media import open_tiff
from drivers.picture_header import NAMES, PictureHeader, read_header

__all__ = ["PictureHeader", "decode_picture", "read_header"]

Codes: TypeAlias = NDArray[np.number]

# Compression smears clipped light over its neighbours. In photographs brightened until 9 to 22 %
# of their pixels clipped and compressed at quality 75 to 98 (4:2:0), 84 to 97 % of the clipped
# pixels came back with a channel of 250 or more, but only 56 to 85 % with 255; of the others at
# most 1.4 % reached 250.
JPEG_WHITE = 250


def decode_picture(data: bytes, transfer: Literal["linear", "srgb"]) -> LinearImage:
    """Linear light of a rendered picture.

    Grey pictures are repeated in three channels. A transparency channel is dropped when every
    pixel is opaque and refused otherwise.

    Parameters
    ----------
    data
        The whole file.
    transfer
        ``srgb``: the stored integers were encoded with the curve of sRGB (IEC 61966-2-1);
        ``linear``: they are proportional to light.

    Returns
    -------
    `saturated` marks integers at their largest value in any channel (250 of 255 in JPEG);
    floating-point pictures have no white level, and none of their pixels is marked. JPEG has no
    check sums: one that was damaged within decodes to wrong values without an error.

    Raises
    ------
    DecodeError
        As `read_header`; the pixels are damaged, not opaque, or not finite.
    """
    if transfer not in {"linear", "srgb"}:
        raise ValueError(f"transfer is 'linear' or 'srgb', not {transfer!r}")
    header = read_header(data)
    if header.is_float and transfer == "srgb":
        raise DecodeError("floating-point pictures are linear: they cannot have the sRGB curve")
    codes = _tiff_codes(data) if header.media_type == "image/tiff" else _cv2_codes(data, header)
    expected = header.height, header.width, header.channels
    if codes.shape != expected or codes.dtype != header.dtype:
        raise DecodeError(
            f"the {NAMES[header.media_type]} holds {codes.shape} {codes.dtype}, its header says "
            f"{expected} {header.dtype}: it is damaged"
        )
    if header.has_alpha:
        codes = _opaque(codes, header)
    if header.is_float:
        return LinearImage(_in_color(_finite(codes)), np.zeros(codes.shape[:2], np.bool_))
    white = JPEG_WHITE if header.media_type == "image/jpeg" else int(np.iinfo(header.dtype).max)
    values = _light(header.dtype, transfer)[codes]
    return LinearImage(_in_color(values), _any_channel(codes >= white))


@lru_cache(maxsize=4)
def _light(dtype: str, transfer: str) -> NDArray[np.float32]:
    """Light of every code of an integer type; sRGB after IEC 61966-2-1:1999, 5.2."""
    largest = np.iinfo(dtype).max
    encoded = np.arange(largest + 1) / largest
    if transfer == "srgb":
        curved = ((encoded + 0.055) / 1.055) ** 2.4
        encoded = np.where(encoded <= 0.04045, encoded / 12.92, curved)
    return encoded.astype(np.float32)


def _any_channel(marks: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Logical or over the last axis; several times the speed of `any` for so few channels."""
    found = marks[..., 0].copy()
    for channel in range(1, marks.shape[2]):
        found |= marks[..., channel]
    return found


def _in_color(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.ascontiguousarray(values if values.shape[2] == 3 else np.repeat(values, 3, axis=2))


def _opaque(codes: Codes, header: PictureHeader) -> Codes:
    opaque = 1 if header.is_float else np.iinfo(header.dtype).max
    if not np.all(codes[..., -1] == opaque):
        raise DecodeError(
            "the picture is partly transparent, so its colours are not what the camera saw; "
            "save it without transparency"
        )
    return codes[..., :-1]


def _finite(codes: Codes) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        values = codes.astype(np.float32)
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise DecodeError(
            f"{bad} values of the picture are not finite (NaN, infinite or over 3.4e38); "
            "export it again without them"
        )
    return values


def _cv2_codes(data: bytes, header: PictureHeader) -> Codes:
    """Codes as stored, (height, width, channels), red first."""
    try:
        codes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DecodeError(f"the {NAMES[header.media_type]} is damaged ({error.err})") from error
    if codes is None:
        raise DecodeError(f"the {NAMES[header.media_type]} is damaged; was it copied whole?")
    if codes.ndim == 2:
        return codes[..., np.newaxis]
    if codes.shape[2] == 4:
        # OpenCV has no grey with transparency: it repeats the grey.
        return codes[..., [2, 1, 0, 3] if header.channels == 4 else [0, 3]]
    return codes[..., ::-1]


def _tiff_codes(data: bytes) -> Codes:
    with open_tiff(data) as file:
        page = file.pages.first
        height, width, channels = page.imagelength, page.imagewidth, page.samplesperpixel
        codes = page.asarray()
        if page.planarconfig == tifffile.PLANARCONFIG.SEPARATE and channels > 1:
            codes = np.moveaxis(codes.reshape(channels, height, width), 0, -1)
        codes = codes.reshape(height, width, channels)
        return codes.astype(codes.dtype.newbyteorder("="), copy=False)
