"""The images of a result as the page shows them, one in memory at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.report.figures import colour_of
from acquire.report.pictures import (
    LARGE_PX,
    SMALL_PX,
    Picture,
    mask_map,
    photograph,
    reduction,
    sign_map,
)
from acquire.result import PitchRecord, PixelClass, Result
from acquire.tone import exposure_of
from processing.patterns import Family

MAX_PITCHES = 6
SIGN_MATTERS = 0.001


@dataclass(frozen=True, slots=True)
class WhitePlate:
    """The scene under white light and the exposure that all pictures share.

    Parameters
    ----------
    picture
        The scene at `gain`.
    gain
        Display exposure, > 0: linear value × gain = 1 is full brightness.
    light
        Sum over the measured pixels, (3,).
    mean_square
        Mean of the squared values over the measured pixels; NaN when there are none.
    """

    picture: Picture
    gain: float
    light: NDArray[np.float64]
    mean_square: float


@dataclass(frozen=True, slots=True)
class ComponentPlate:
    """One component as the page shows it.

    Parameters
    ----------
    name, colour
        Its name and the colour that stands for it.
    same
        At the exposure of the white picture.
    normalised
        At an exposure of its own, `factor` times that of the white picture.
    signed
        Where it is positive and negative; None when hardly anything is negative.
    share, colour_shares
        Its part of the white light over the measured pixels, all colours together and
        (red, green, blue); NaN when nothing was measured.
    negative_values, negative_light
        Fraction of the values below zero, and their sum as a fraction of the white light, ≤ 0.
    deviation
        Median standard error of its values as a fraction of the median white value; None where
        the method does not know it.
    """

    name: str
    colour: str
    same: Picture
    normalised: Picture
    signed: Picture | None
    factor: float
    share: float
    colour_shares: tuple[float, ...]
    deviation: float | None
    negative_values: float
    negative_light: float


@dataclass(frozen=True, slots=True)
class PitchPlate:
    """Direct and global light at one pitch, at the exposure of the white picture."""

    label: str
    direct: Picture
    global_: Picture
    direct_share: float
    mean_square: float


@dataclass(frozen=True, slots=True)
class MaskPlate:
    """Where the scene could not be measured."""

    picture: Picture
    reduction: int


def white_plate(result: Result, measured: NDArray[np.bool_]) -> WhitePlate:
    """Expose the white image; `measured` is (height, width)."""
    white = result.white
    gain = exposure_of(white)
    picture = photograph(white, gain, LARGE_PX, "The scene under white light.")
    return WhitePlate(picture, gain, _light(white, measured), _mean_square(white, measured))


def component_plate(
    result: Result, index: int, white: WhitePlate, measured: NDArray[np.bool_]
) -> ComponentPlate:
    """Expose component `index` like the white image and by itself, and weigh it."""
    name = result.record.components[index]
    image = result.component(name)
    own_gain = exposure_of(image)
    factor = own_gain / white.gain
    light = _light(image, measured)
    values = image[measured]
    below = values[values < 0]
    negative_values = below.size / values.size if values.size else math.nan
    negative_light = _ratio(float(below.sum(dtype=np.float64)), float(white.light.sum()))
    signed = None
    if negative_light < -SIGN_MATTERS:
        signed = sign_map(image, own_gain, SMALL_PX, f"{name}: orange positive, blue negative.")
    return ComponentPlate(
        name=name,
        colour=colour_of(index),
        same=photograph(image, white.gain, LARGE_PX, f"{name}, exposed like the white picture."),
        normalised=photograph(image, own_gain, LARGE_PX, f"{name}, {factor:.3g} times brighter."),
        signed=signed,
        factor=factor,
        share=_ratio(float(light.sum()), float(white.light.sum())),
        colour_shares=tuple(map(_ratio, light.tolist(), white.light.tolist())),
        deviation=_median_deviation(result, name, measured),
        negative_values=negative_values,
        negative_light=negative_light,
    )


def _median_deviation(result: Result, name: str, measured: NDArray[np.bool_]) -> float | None:
    if not result.record.deviations or not measured.any():
        return None
    typical = float(np.median(result.white[measured]))
    return _ratio(float(np.median(result.deviation(name)[measured])), typical)


def pitch_plate(
    result: Result, pitch: PitchRecord, white: WhitePlate, measured: NDArray[np.bool_], label: str
) -> PitchPlate:
    """Expose the direct and the global light at one pitch like the white image."""
    direct = result.pitch_image(pitch.direct)
    share = _ratio(float(_light(direct, measured).sum()), float(white.light.sum()))
    mean_square = _mean_square(direct, measured)
    picture = photograph(direct, white.gain, SMALL_PX, f"Direct light at {label}.")
    rest = result.pitch_image(pitch.global_)
    other = photograph(rest, white.gain, SMALL_PX, f"Global light at {label}.")
    return PitchPlate(label, picture, other, share, mean_square)


def mask_plate(result: Result, gain: float) -> MaskPlate:
    """Colour the pixels that could not be measured over the scene in grey."""
    mask = result.mask
    alt = "The scene in grey; saturated pixels orange-red, unlit pixels light blue."
    return MaskPlate(
        mask_map(result.white, mask, gain, LARGE_PX, alt), reduction(mask.shape, LARGE_PX)
    )


def measured_pixels(result: Result) -> NDArray[np.bool_]:
    """Where the scene was measured, (height, width)."""
    return np.equal(result.mask, PixelClass.MEASURED)


def pitch_label(pitch: PitchRecord, families: Sequence[Family]) -> str:
    """The pitch, with its family where there are several."""
    size = f"{pitch.pitch_px} px"
    return f"{pitch.family.value}, {size}" if len(families) > 1 else size


def spread_pitches(pitches: Sequence[PitchRecord]) -> tuple[PitchRecord, ...]:
    """At most six in all, of every family at least the finest and the coarsest."""
    families = tuple(dict.fromkeys(pitch.family for pitch in pitches))
    chosen: list[PitchRecord] = []
    for family in families:
        own = sorted((p for p in pitches if p.family is family), key=lambda p: p.pitch_px)
        number = min(len(own), max(2, MAX_PITCHES // len(families)))
        places = np.linspace(0, len(own) - 1, number).round().astype(int)
        chosen += [own[place] for place in places]
    return tuple(chosen)


def _light(image: NDArray[np.float32], measured: NDArray[np.bool_]) -> NDArray[np.float64]:
    total: NDArray[np.float64] = image[measured].sum(axis=0, dtype=np.float64)
    return total


def _mean_square(image: NDArray[np.float32], measured: NDArray[np.bool_]) -> float:
    values = image[measured]
    return float(np.mean(np.square(values, dtype=np.float64))) if values.size else math.nan


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else math.nan
