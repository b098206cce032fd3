"""From a camera's file to what a screen shows: picture, marks, histogram, focus figure."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.focus import focus_figure
from drivers.image import LinearImage
from drivers.media import PICTURE_TYPES
from drivers.picture import decode_picture
from drivers.raw import decode_raw

SCREEN_PX = 1280
EXACT_PX = 512  # up to this side pictures are sent without loss
FOCUS_PX = 768
DARK = 1e-3  # mean light, fraction of the range, below which noise alone would seem sharp
BINS = 128
JPEG_QUALITY = 92
# As in the masks of results: of the 99.5th percentile of the pixels' brightness.
UNLIT_FRACTION, BRIGHT_PERCENTILE = 0.01, 99.5
CLIPPED, UNLIT = 1, 2
HISTOGRAM_SAMPLES = 500_000

Box = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class Negative:
    """A decoded picture.

    Parameters
    ----------
    values
        float32, (height, width, 3), linear, fraction of the sensor's range.
    marks
        uint8, (height, width): `CLIPPED`, `UNLIT` or 0.
    """

    values: NDArray[np.float32]
    marks: NDArray[np.uint8]

    @property
    def size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.values.shape[1], self.values.shape[0]


@dataclass(frozen=True, slots=True)
class Print:
    """What one viewer gets of a picture.

    Parameters
    ----------
    box
        (left, top, width, height) of the part shown, in pixels of the picture.
    reduced
        How many pixels of the picture one pixel of the file stands for, a side.
    image, media_type
        The part as a PNG or JPEG file, sRGB.
    marks
        PNG, grey, of the same size: 1 clipped, 2 unlit; one marked pixel marks its block.
    histogram
        Counts of red, green and blue in `BINS` bins from 0 to 1 of the range.
    clipped, unlit
        Fractions of the pixels of the part.
    focus, focus_box
        `calibration.focus.focus_figure` of green and the part that it was measured on.
    mean
        Mean of red, green and blue, fraction of the range.
    """

    box: Box
    reduced: float
    image: bytes
    media_type: str
    marks: bytes
    histogram: tuple[tuple[int, ...], ...]
    clipped: float
    unlit: float
    focus: float | None
    focus_box: Box
    mean: tuple[float, ...]


def negative(media_type: str, data: bytes) -> Negative:
    """Decode a file of the camera; raises `drivers.errors.DecodeError`."""
    image: LinearImage = (
        decode_picture(data, "srgb" if media_type == "image/jpeg" else "linear")
        if media_type in PICTURE_TYPES
        else decode_raw(data)
    )
    brightness = image.values.mean(axis=2)
    bright = float(np.percentile(brightness[::4, ::4], BRIGHT_PERCENTILE))
    marks = np.zeros(brightness.shape, np.uint8)
    marks[brightness <= max(UNLIT_FRACTION * bright, 0.0)] = UNLIT
    marks[image.saturated] = CLIPPED
    return Negative(image.values, marks)


def printed(picture: Negative, wanted: Box | None) -> Print:
    """Print a part of a picture, or all of it, at no more than a screen's size."""
    box = _inside(wanted, picture.size_px)
    left, top, width, height = box
    part = picture.values[top : top + height, left : left + width]
    marks = picture.marks[top : top + height, left : left + width]
    factor = max(1.0, max(width, height) / SCREEN_PX)
    size = max(round(width / factor), 1), max(round(height / factor), 1)
    small = part if factor == 1 else cv2.resize(part, size, interpolation=cv2.INTER_AREA)
    encoded = srgb_codes()[(np.clip(small, 0, 1) * 65535 + 0.5).astype(np.uint16)]
    media_type, file = _file(encoded)
    focus_box = _centre(box)
    return Print(
        box,
        factor,
        file,
        media_type,
        png(_spread(marks, size)),
        _histogram(part),
        float(np.mean(marks == CLIPPED)),
        float(np.mean(marks == UNLIT)),
        _focus(picture, focus_box),
        focus_box,
        tuple(float(level) for level in part.mean(axis=(0, 1), dtype=np.float64)),
    )


def printed_raster(raster: NDArray[np.uint8]) -> bytes:
    """A raster, grey or red first, as a PNG of at most a screen's size."""
    factor = max(1.0, max(raster.shape[:2]) / SCREEN_PX)
    if factor > 1:
        size = round(raster.shape[1] / factor), round(raster.shape[0] / factor)
        raster = np.asarray(cv2.resize(raster, size, interpolation=cv2.INTER_AREA), np.uint8)
    return png(raster if raster.ndim == 2 else raster[..., ::-1])


def _inside(wanted: Box | None, size_px: tuple[int, int]) -> Box:
    width, height = size_px
    if wanted is None:
        return 0, 0, width, height
    left, top = min(wanted[0], width - 1), min(wanted[1], height - 1)
    return left, top, min(max(wanted[2], 1), width - left), min(max(wanted[3], 1), height - top)


def _centre(box: Box) -> Box:
    left, top, width, height = box
    wide, tall = min(width, FOCUS_PX), min(height, FOCUS_PX)
    return left + (width - wide) // 2, top + (height - tall) // 2, wide, tall


def _focus(picture: Negative, box: Box) -> float | None:
    left, top, width, height = box
    if min(width, height) < 3:
        return None
    green = picture.values[top : top + height, left : left + width, 1]
    usable = picture.marks[top : top + height, left : left + width] != CLIPPED
    if not green.mean(dtype=np.float64) > DARK:
        return None
    figure = focus_figure(green, usable)
    return figure if np.isfinite(figure) else None


def _spread(marks: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Reduce marks so that a single marked pixel still shows; clipped before unlit."""
    if marks.shape == (size[1], size[0]):
        return marks
    found = np.zeros((size[1], size[0]), np.uint8)
    for mark in (UNLIT, CLIPPED):
        share = cv2.resize((marks == mark).astype(np.float32), size, interpolation=cv2.INTER_AREA)
        found[share > (0 if mark == CLIPPED else 0.5)] = mark
    return found


def _histogram(part: NDArray[np.float32]) -> tuple[tuple[int, ...], ...]:
    step = int(np.ceil(np.sqrt(max(part.shape[0] * part.shape[1] / HISTOGRAM_SAMPLES, 1))))
    bins = (np.clip(part[::step, ::step], 0, 1) * (BINS - 1) + 0.5).astype(np.uint8)
    return tuple(
        tuple(np.bincount(bins[..., channel].ravel(), minlength=BINS).tolist())
        for channel in range(3)
    )


@cache
def srgb_codes() -> NDArray[np.uint8]:
    """8-bit sRGB (IEC 61966-2-1) of 65536 steps of linear light."""
    linear = np.arange(65536) / 65535
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    codes: NDArray[np.uint8] = np.rint(255 * curve).astype(np.uint8)
    return codes


def _file(rgb: NDArray[np.uint8]) -> tuple[str, bytes]:
    bgr = np.ascontiguousarray(rgb[..., ::-1])
    if max(rgb.shape[:2]) <= EXACT_PX:
        return "image/png", png(bgr)
    _, file = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return "image/jpeg", file.tobytes()


def png(pixels: NDArray[np.uint8]) -> bytes:
    """A PNG of grey pixels, or of colours with blue first."""
    _, file = cv2.imencode(".png", np.ascontiguousarray(pixels), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return file.tobytes()
