"""From a camera's raw file to linear light, one pixel for each 2 × 2 quad of its Bayer mosaic."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import rawpy
from numba import njit
from numpy.typing import NDArray

from drivers.errors import DecodeError
from drivers.image import LinearImage

MAX_PHOTOSITES = 400_000_000

# A photosite counts as saturated from 1 % of the range below the white level: makers' white
# levels are medians, and response bends just below them.
SATURATION_MARGIN = 0.01

_FORMATS = {
    b"\xff\xd8\xff": "a JPEG",
    b"\x89PNG": "a PNG",
    b"GIF8": "a GIF",
    b"%PDF": "a PDF",
    b"BM": "a BMP",
}


def decode_raw(data: bytes) -> LinearImage:
    """Linear light of a Bayer raw file, as LibRaw unpacks it.

    Each photosite's value is (count − black)/(white − black) with the black level of its own
    colour, signed. A pixel is red, the mean of both greens, and blue of one quad, in the order of
    the sensor, whatever the mosaic's phase; an odd last row or column is dropped. There is no
    white balance, no brightening and no rotation.

    Parameters
    ----------
    data
        The whole file.

    Returns
    -------
    (height // 2, width // 2) pixels of the visible part of the sensor; `saturated` where any of
    the four photosites is within 1 % of the range of the white level.

    Raises
    ------
    DecodeError
        No raw file, a damaged one, or one whose values are not counts of a Bayer mosaic.
    """
    _refuse_other_formats(data)
    try:
        with rawpy.RawPy() as raw:
            raw.open_buffer(io.BytesIO(data))
            _check_size(raw.sizes)
            raw.unpack()
            return _quads(raw)
    except rawpy.LibRawFileUnsupportedError:
        raise DecodeError(
            "LibRaw knows no camera that writes such a file: it is not a raw, or cut short; "
            "set the camera to raw and check that the file was transferred whole"
        ) from None
    except rawpy.LibRawIOError:
        raise DecodeError(
            f"the raw file ends too early after {len(data)} bytes: it was not transferred whole"
        ) from None
    except rawpy.LibRawError as error:
        reason = error.args[0].decode() if error.args and error.args[0] else "unknown"
        raise DecodeError(f"the raw file is damaged: LibRaw says {reason!r}") from None


def _refuse_other_formats(data: bytes) -> None:
    if not data:
        raise DecodeError("the file is empty: the camera delivered nothing")
    for magic, name in _FORMATS.items():
        if data.startswith(magic):
            raise DecodeError(
                f"the file is {name}, not a raw: its values are no longer proportional to light; "
                "set the camera's image quality to raw"
            )


def _check_size(sizes: Any) -> None:
    height, width = sizes.raw_height, sizes.raw_width
    if not 0 < height * width <= MAX_PHOTOSITES or sizes.height < 2 or sizes.width < 2:
        raise DecodeError(
            f"the file claims a sensor of {height} × {width} photosites with "
            f"{sizes.height} × {sizes.width} visible; from 2 × 2 to {MAX_PHOTOSITES} are read"
        )


def _quads(raw: Any) -> LinearImage:
    """Check the mosaic and reduce it."""
    if raw.raw_type != rawpy.RawType.Flat:
        raise DecodeError(
            "the file holds several values a pixel (Foveon, sRAW or linear DNG), not the counts "
            "of a Bayer mosaic; set the camera to full-size raw"
        )
    pattern = raw.raw_pattern
    if pattern is None or pattern.shape != (2, 2):
        kind = "monochrome or sRAW" if pattern is None else f"X-Trans, {pattern.shape}"
        raise DecodeError(f"the sensor has no 2 × 2 Bayer mosaic ({kind}); use a Bayer camera")
    sizes = raw.sizes
    top, left = sizes.top_margin, sizes.left_margin
    sites = [raw.raw_color(top + down, left + right) for down in (0, 1) for right in (0, 1)]
    letters = "".join(chr(raw.color_desc[site]) for site in sites)
    if sorted(letters) != ["B", "G", "G", "R"]:
        raise DecodeError(f"the mosaic is {letters}, not red, twice green and blue")
    black = np.array([raw.black_level_per_channel[site] for site in sites], np.float32)
    white = np.float32(raw.white_level)
    if not white > black.max():
        raise DecodeError(f"white level {white:g} is not above black level {black.max():g}")
    # In the order red, green, green, blue: where each lies in the quad and its levels.
    order = np.argsort(["RGB".index(letter) for letter in letters], kind="stable")
    first = np.array([(top + site // 2, left + site % 2) for site in order])
    size = (sizes.height // 2, sizes.width // 2)
    values, saturated, largest = _reduced(raw.raw_image, first, size, black[order], white)
    if largest == 0:
        raise DecodeError(
            "every photosite of the file reads 0: LibRaw cannot unpack this compression"
        )
    return LinearImage(values, saturated)


@njit(cache=True, nogil=True)
def _reduced(
    counts: NDArray[np.uint16],
    first: NDArray[np.int64],
    size: tuple[int, int],
    black: NDArray[np.float32],
    white: np.float32,
) -> tuple[NDArray[np.float32], NDArray[np.bool_], np.uint16]:  # pragma: no cover - compiled
    """Pixels, saturation and largest count; `first` (4, 2) red, green, green, blue photosites."""
    values = np.empty((size[0], size[1], 3), np.float32)
    saturated = np.empty(size, np.bool_)
    gain = np.float32(1) / (white - black)
    half = np.float32(0.5)
    limit = np.ceil(white - np.float32(SATURATION_MARGIN) * (white - black)).astype(np.uint16)
    largest = np.uint16(0)
    for i in range(size[0]):
        reds = counts[first[0, 0] + 2 * i, first[0, 1] :]
        greens = counts[first[1, 0] + 2 * i, first[1, 1] :]
        other_greens = counts[first[2, 0] + 2 * i, first[2, 1] :]
        blues = counts[first[3, 0] + 2 * i, first[3, 1] :]
        for j in range(size[1]):
            red, blue = reds[2 * j], blues[2 * j]
            green, other_green = greens[2 * j], other_greens[2 * j]
            largest = max(largest, red, green, other_green, blue)
            saturated[i, j] = (
                (red >= limit[0])
                | (green >= limit[1])
                | (other_green >= limit[2])
                | (blue >= limit[3])
            )
            values[i, j, 0] = (np.float32(red) - black[0]) * gain[0]
            values[i, j, 1] = half * (
                (np.float32(green) - black[1]) * gain[1]
                + (np.float32(other_green) - black[2]) * gain[2]
            )
            values[i, j, 2] = (np.float32(blue) - black[3]) * gain[3]
    return values, saturated, largest
