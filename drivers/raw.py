"""From a camera's raw file to linear light."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rawpy

from drivers.errors import DecodeError
from drivers.image import Demosaic, LinearImage
from drivers.mosaic import BAYER, Mosaic, bilinear, superpixels

MAX_PHOTOSITES = 400_000_000

_FORMATS = {
    b"\xff\xd8\xff": "a JPEG",
    b"\x89PNG": "a PNG",
    b"GIF8": "a GIF",
    b"%PDF": "a PDF",
    b"BM": "a BMP",
}


_REDUCTIONS: dict[Demosaic, Callable[[Mosaic, LinearImage | None], LinearImage]] = {
    Demosaic.SUPERPIXEL: superpixels,
    Demosaic.BILINEAR: bilinear,
}


def decode_raw(
    data: bytes, demosaic: Demosaic = Demosaic.SUPERPIXEL, room: LinearImage | None = None
) -> LinearImage:
    """Linear light of a Bayer raw file, as LibRaw unpacks it.

    Each photosite's value is (count − black)/(white − black) with the black level of its own
    colour, signed. There is no white balance, no brightening and no rotation.

    Parameters
    ----------
    data
        The whole file.
    demosaic
        How photosites become pixels, see `drivers.mosaic`.
    room
        An image no longer needed, whose memory is written over if it is of the right shape: new
        memory costs more time than decoding into it.

    Returns
    -------
    (height, width) pixels of the visible part of the sensor, half as many each way for
    ``superpixel``; `saturated` where any photosite that went into the pixel is within 1 % of the
    range of the white level.

    Raises
    ------
    DecodeError
        No raw file, a damaged one, or one whose values are not counts of a Bayer mosaic.
    """
    with _unpacked(data) as mosaic:
        return _REDUCTIONS[demosaic](mosaic, room)


def counts_in_range(data: bytes) -> float:
    """Counts between black and white level of a Bayer raw file; errors as `decode_raw`."""
    with _unpacked(data) as mosaic:
        return mosaic.white - sum(mosaic.black) / len(mosaic.black)


@contextmanager
def _unpacked(data: bytes) -> Iterator[Mosaic]:
    _refuse_other_formats(data)
    try:
        with rawpy.RawPy() as raw:
            raw.open_buffer(io.BytesIO(data))
            _check_size(raw.sizes)
            raw.unpack()
            yield _mosaic(raw)
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


def _mosaic(raw: Any) -> Mosaic:
    """The counts and what they mean; they lie in LibRaw's memory and go with it."""
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
    if letters not in BAYER:
        raise DecodeError(f"the mosaic is {letters}, not red, twice green on a diagonal and blue")
    black = [float(raw.black_level_per_channel[site]) for site in sites]
    white = float(raw.white_level)
    if not white > max(black):
        raise DecodeError(f"white level {white:g} is not above black level {max(black):g}")
    counts = raw.raw_image
    visible = counts[top : top + sizes.height, left : left + sizes.width]
    if not any(row.any() for row in visible):
        raise DecodeError(
            "every photosite of the file reads 0: LibRaw cannot unpack this compression"
        )
    first, second, third, fourth = black
    return Mosaic(
        counts,
        (top, left),
        (sizes.height, sizes.width),
        letters,
        (first, second, third, fourth),
        white,
    )
