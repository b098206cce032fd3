"""Linear light as pictures for a screen: reduced in linear light, exposed, encoded as sRGB PNG."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from acquire.remix import SATURATED_RGB, developed
from acquire.result import PixelClass
from acquire.tone import Tone, encode

LARGE_PX, SMALL_PX = 648, 324
PIXELATED_UP_TO_PX = 160
BAND_PIXELS = 1 << 20

# Okabe and Ito, Color Universal Design (2008): told apart with every kind of colour vision.
UNLIT_RGB = np.array([0x56, 0xB4, 0xE9], np.uint8)
POSITIVE_RGB = np.array([0xE6, 0x9F, 0x00], np.float64)
NEGATIVE_RGB = np.array([0x00, 0x72, 0xB2], np.float64)


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG and what must be said about it.

    Parameters
    ----------
    png
        The file's content.
    width_px, height_px
        Size of the PNG.
    alt
        The picture in words.
    """

    png: bytes
    width_px: int
    height_px: int
    alt: str

    @property
    def uri(self) -> str:
        """The picture as a data URI."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode()

    @property
    def pixelated(self) -> bool:
        """So few pixels that each is shown as a square instead of blurred."""
        return self.width_px <= PIXELATED_UP_TO_PX


def reduction(shape: tuple[int, int], limit_px: int) -> int:
    """Side of the square blocks that bring (height, width) within `limit_px`, ≥ 1."""
    return math.ceil(max(shape) / limit_px)


def reduced(image: NDArray[np.float32], factor: int) -> NDArray[np.float64]:
    """Average blocks of factor × factor pixels in linear light.

    Parameters
    ----------
    image
        (height, width, 3); pixels with a value that is not finite do not enter the average.
    factor
        Side of a block, ≥ 1; blocks at the right and lower edge may be smaller.

    Returns
    -------
    (⌈height/factor⌉, ⌈width/factor⌉, 3), NaN where at least half of a block was not measured.
    """
    rows = factor * max(1, BAND_PIXELS // (factor * image.shape[1]))
    bands = [
        _reduced_band(image[top : top + rows], factor) for top in range(0, image.shape[0], rows)
    ]
    return np.concatenate(bands)


def _reduced_band(image: NDArray[np.float32], factor: int) -> NDArray[np.float64]:
    height, width = image.shape[:2]
    area = np.multiply.outer(_block_sides(height, factor), _block_sides(width, factor))
    measured: NDArray[np.bool_] = np.all(np.isfinite(image), axis=2)
    if measured.all():
        return _block_sums(image, factor) / area[..., np.newaxis]
    weight = _block_sums(measured[..., np.newaxis], factor)
    light: NDArray[np.float32] = np.where(measured[..., np.newaxis], image, np.float32(0))
    total = _block_sums(light, factor)
    usable = 2 * weight > area[..., np.newaxis]
    return np.where(usable, total / np.maximum(weight, 1), np.nan)


def _block_sides(length: int, factor: int) -> NDArray[np.float64]:
    return np.diff(np.append(np.arange(0, length, factor), length)).astype(np.float64)


def block_any(flags: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Whether any pixel of a block of factor × factor has its flag set; (height, width)."""
    return _block_sums(flags[..., np.newaxis], factor)[..., 0] > 0


def _block_sums(image: NDArray[np.generic], factor: int) -> NDArray[np.float64]:
    height, width = image.shape[:2]
    rows = np.add.reduceat(image, np.arange(0, height, factor), axis=0, dtype=np.float64)
    blocks: NDArray[np.float64] = np.add.reduceat(rows, np.arange(0, width, factor), axis=1)
    return blocks


def photograph(image: NDArray[np.float32], gain: float, limit_px: int, alt: str) -> Picture:
    """Linear light × gain through the sRGB curve; what was not measured in the marked colour.

    Parameters
    ----------
    image
        Linear light, (height, width, 3), NaN where saturated.
    gain
        Display exposure; values × gain are clipped to [0, 1].
    limit_px
        Longest side of the picture.
    alt
        The picture in words.
    """
    light = reduced(image, reduction(image.shape[:2], limit_px))
    return _picture(developed(light, gain, Tone.SRGB), alt)


def sign_map(image: NDArray[np.float32], gain: float, limit_px: int, alt: str) -> Picture:
    """Mean of the colours: white is 0, orange positive, blue negative, ±1/gain at full colour."""
    light = reduced(image, reduction(image.shape[:2], limit_px))
    unknown = np.isnan(light).any(axis=2, keepdims=True)
    mean = np.where(unknown, 0, light.mean(axis=2, keepdims=True))
    amount = np.clip(np.abs(mean) * gain, 0, 1) ** 0.5
    colour = np.where(mean > 0, POSITIVE_RGB, NEGATIVE_RGB)
    pixels = np.rint(255 + amount * (colour - 255)).astype(np.uint8)
    return _picture(np.where(unknown, np.uint8(0), pixels), alt)


def mask_map(
    white: NDArray[np.float32], mask: NDArray[np.uint8], gain: float, limit_px: int, alt: str
) -> Picture:
    """The scene in grey under the classes in colour; a block shows the worst of its pixels.

    Parameters
    ----------
    white
        The scene under white light, (height, width, 3).
    mask
        `PixelClass` of every pixel, (height, width).
    """
    factor = reduction(mask.shape, limit_px)
    light = np.nan_to_num(reduced(white, factor).mean(axis=2, keepdims=True))
    pixels = np.repeat(encode(light * gain), 3, axis=2) // 2 + 96
    for pixel_class, colour in (
        (PixelClass.UNLIT, UNLIT_RGB),
        (PixelClass.SATURATED, SATURATED_RGB),
    ):
        hit = block_any(mask == pixel_class, factor)[..., np.newaxis]
        pixels = np.where(hit, colour, pixels)
    return _picture(pixels, alt)


def _picture(pixels: NDArray[np.uint8], alt: str) -> Picture:
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(file, "PNG", compress_level=6)
    return Picture(file.getvalue(), pixels.shape[1], pixels.shape[0], alt)
