"""Raw files of the simulated camera: uncompressed 14-bit Bayer DNG.

Tags after the Adobe Digital Negative specification, version 1.4. The exposure and its time
stand in IFD 0, where TIFF/EP has them.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from functools import lru_cache

import numpy as np
import tifffile
from numpy.typing import NDArray

from drivers.protocols import CameraSettings

MEDIA_TYPE = "image/x-adobe-dng"
BLACK_LEVEL = 512
WHITE_LEVEL = 16383

_CFA_PHOTOMETRIC = 32803
_RGGB = bytes([0, 1, 1, 2])
_DATE_TIME, _DATE_TIME_ORIGINAL, _SUB_SECONDS = 306, 36867, 37521
_NO_TIME = "0000:00:00 00:00:00"


def encode_dng(counts: NDArray[np.uint16], settings: CameraSettings, time_s: float = 0.0) -> bytes:
    """A DNG file that holds `counts` unchanged.

    Parameters
    ----------
    counts
        uint16, (height, width) photosites, RGGB from the upper left corner, both sides even,
        0 to 16383 with black at 512.
    settings
        Written into the file's exposure tags.
    time_s
        When the exposure began, by the camera's clock, seconds since 1970-01-01 UTC; written to
        the hundredth of a second.
    """
    if counts.ndim != 2 or counts.shape[0] % 2 or counts.shape[1] % 2:
        raise ValueError(f"an RGGB mosaic has even sides (height, width), not {counts.shape}")
    around = _around(counts.shape, settings)
    began = datetime.fromtimestamp(round(100 * time_s) // 100, UTC)
    told = dict.fromkeys((_DATE_TIME, _DATE_TIME_ORIGINAL), f"{began:%Y:%m:%d %H:%M:%S}")
    told[_SUB_SECONDS] = f"{round(100 * time_s) % 100:02d}"
    head = bytearray(around.head)
    for code, text in told.items():
        place = around.times[code]
        head[place : place + len(text)] = text.encode()
    return bytes(head) + counts.astype("<u2", copy=False).tobytes() + around.tail


@dataclass(frozen=True, slots=True)
class _Around:
    """What stands before and after the photosites; where in it the times are, by their tags."""

    head: bytes
    tail: bytes
    times: dict[int, int]


@lru_cache(maxsize=16)
def _around(shape: tuple[int, int], settings: CameraSettings) -> _Around:
    """Of a file of this size and exposure."""
    buffer = io.BytesIO()
    tifffile.imwrite(
        buffer,
        np.zeros(shape, np.uint16),
        byteorder="<",
        photometric=_CFA_PHOTOMETRIC,
        rowsperstrip=shape[0],
        metadata=None,
        software=False,
        datetime=_NO_TIME,
        extratags=_tags(settings),
    )
    data = buffer.getvalue()
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        start, tags = file.pages.first.dataoffsets[0], file.pages.first.tags
        codes = (_DATE_TIME, _DATE_TIME_ORIGINAL, _SUB_SECONDS)
        times = {code: tags[code].valueoffset for code in codes}
    return _Around(data[:start], data[start + 2 * shape[0] * shape[1] :], times)


def _tags(settings: CameraSettings) -> list[tuple[int, str, int, object, bool]]:
    """(code, TIFF type, count, value, once) of every tag that makes a TIFF a DNG."""
    matrix = (3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570)
    tags: list[tuple[int, str, int, object, bool]] = [
        (271, "s", 0, "lumisplit", True),  # Make
        (272, "s", 0, "simulated camera", True),  # Model
        (50708, "s", 0, "lumisplit simulated camera", True),  # UniqueCameraModel
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),  # DNGVersion
        (50707, "B", 4, bytes([1, 1, 0, 0]), True),  # DNGBackwardVersion
        (33421, "H", 2, (2, 2), True),  # CFARepeatPatternDim
        (33422, "B", 4, _RGGB, True),  # CFAPattern
        (50714, "H", 1, BLACK_LEVEL, True),  # BlackLevel
        (50717, "H", 1, WHITE_LEVEL, True),  # WhiteLevel
        (50721, "2i", 9, _rationals(matrix), True),  # ColorMatrix1: sRGB primaries from XYZ
        (50778, "H", 1, 21, True),  # CalibrationIlluminant1: D65
        (50728, "2I", 3, _rationals((1.0, 1.0, 1.0)), True),  # AsShotNeutral
        (33434, "2I", 1, _rationals((settings.exposure_s,)), True),  # ExposureTime
        (_DATE_TIME_ORIGINAL, "s", 0, _NO_TIME, True),
        (_SUB_SECONDS, "s", 0, "00", True),
    ]
    if settings.aperture is not None:
        tags.append((33437, "2I", 1, _rationals((settings.aperture,)), True))  # FNumber
    if settings.iso is not None and settings.iso < 65536:
        tags.append((34855, "H", 1, settings.iso, True))  # ISOSpeedRatings
    return tags


def _rationals(values: tuple[float, ...]) -> tuple[int, ...]:
    fractions = [Fraction(value).limit_denominator(1_000_000) for value in values]
    return tuple(part for fraction in fractions for part in fraction.as_integer_ratio())
