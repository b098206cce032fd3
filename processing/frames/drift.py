"""Drift of lamp and camera during a run, from its repeated white and black frames.

A frame taken at some moment is taken to be

    f = black + offset + gain · light,

black and light as at the first references, offset and gain one number a colour each. The offset
is what the black frames rise by, the gain what white less black grows by; both are medians over
pixels, so that shadows that moved and hot pixels do not count. Between references they are
interpolated linearly in the order of the exposures, which no clock can disturb; before the first
and after the last they stay.

Whether a line will do, the inner references tell: a smooth course of curvature c between references
h apart bends by c·h²/2 at each and departs by c·h²/8 from the line between two, a quarter of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.frames.frame_noise import FrameNoise

Image: TypeAlias = NDArray[np.float32]
Array: TypeAlias = NDArray[np.float64]

# Drift below this part of the light is left alone, and below this many of its standard errors.
SMALLEST = 0.002
SURE = 6.0
# Bends above this part of the light are no smooth drift, nor those above this part of its range:
# a linear drift has none, a step half of it.
LARGEST_BEND = 0.01
LARGEST_BEND_OF_RANGE = 1 / 3
# Pixels that are at least so bright, in parts of the bright level (90th percentile).
BRIGHT = 0.5
# Standard error of a median over that of a mean, and of a deviation over the median absolute one.
_MEDIAN_ERROR = np.sqrt(np.pi / 2) * 1.4826


class Course(StrEnum):
    """What the references say of the light during the run."""

    STEADY = "steady"
    SMOOTH = "smooth"
    ROUGH = "rough"


@dataclass(frozen=True, slots=True)
class Level:
    """Some pixels of a reference.

    Parameters
    ----------
    order
        Its place among all exposures, in the order in which they were taken.
    image
        float32, (height, width, colours), linear.
    """

    order: int
    image: Image


@dataclass(frozen=True, slots=True)
class Trace:
    """A quantity at each reference.

    Parameters
    ----------
    order
        float64, (n,), rising.
    values, errors
        float64, (n, colours): the quantity, and its standard error.
    """

    order: Array
    values: Array
    errors: Array

    def at(self, order: Array) -> Array:
        """(k, colours), interpolated linearly, constant beyond the ends."""
        columns = [np.interp(order, self.order, column) for column in self.values.T]
        return np.stack(columns, axis=-1)

    @property
    def range(self) -> float:
        """Largest less smallest value, in the colour where that is most."""
        return float(np.ptp(self.values, axis=0).max())

    @property
    def bend(self) -> float:
        """How far an inner value lies off the line between its neighbours, at most."""
        if len(self.order) < 3:
            return 0.0
        part = np.diff(self.order)[:-1] / (self.order[2:] - self.order[:-2])
        line = self.values[:-2] + part[:, np.newaxis] * (self.values[2:] - self.values[:-2])
        return float(np.abs(self.values[1:-1] - line).max())

    def course(self, light: float) -> Course:
        """How the quantity went, by its parts of some light."""
        seen = max(SMALLEST * light, SURE * float(self.errors.max()))
        if self.range <= seen:
            return Course.STEADY
        allowed = min(LARGEST_BEND * light, LARGEST_BEND_OF_RANGE * self.range)
        return Course.SMOOTH if self.bend <= max(allowed, seen) else Course.ROUGH


@dataclass(frozen=True, slots=True)
class Drift:
    """How light and black level went during a run.

    Parameters
    ----------
    gain
        Of the light, 1 at the first white frame.
    offset
        Of the black level in the unit of the frames, 0 at the first black frame.
    light
        Typical white less black, in the unit of the frames.
    """

    gain: Trace
    offset: Trace
    light: float

    @property
    def course(self) -> Course:
        """The worse of both."""
        both = {self.gain.course(1.0), self.offset.course(self.light)}
        return next(one for one in reversed(Course) if one in both)

    @property
    def bend(self) -> float:
        """How far a reference lies off the line between its neighbours, in parts of the light."""
        return max(self.gain.bend, self.offset.bend / self.light if self.light > 0 else 0.0)

    def noise(self, noise: FrameNoise, exposures: int) -> FrameNoise:
        """Mean noise of frames that are freed from the drift: f/g has variance c/g² + s·(f/g)/g."""
        gain = self.gain.at(np.arange(exposures, dtype=np.float64))
        constant = noise.constant * np.mean(1 / gain**2, axis=0)
        return FrameNoise(constant, noise.slope * np.mean(1 / gain, axis=0))

    def seen(self) -> Drift:
        """Without what cannot be told from none: such a gain is 1, such an offset 0."""
        gain, offset = self.gain, self.offset
        if gain.course(1.0) is Course.STEADY:
            gain = Trace(gain.order, np.ones_like(gain.values), gain.errors)
        if offset.course(self.light) is Course.STEADY:
            offset = Trace(offset.order, np.zeros_like(offset.values), offset.errors)
        return Drift(gain, offset, self.light)


def measure_drift(
    whites: Sequence[Level], blacks: Sequence[Level], usable: NDArray[np.bool_]
) -> Drift | None:
    """Gain and offset at each reference.

    Parameters
    ----------
    whites, blacks
        The same pixels of each reference; without any black frame its level is taken as 0.
    usable
        bool, (height, width): pixels that no frame saturated.

    Returns
    -------
    None where there is no white frame, or too little light in it.
    """
    if not whites or not usable.any():
        return None
    whites = sorted(whites, key=lambda one: one.order)
    blacks = sorted(blacks, key=lambda one: one.order)
    offset = _offset(blacks, usable, whites[0].image.shape[-1])
    dark = _black(blacks, offset)[usable] if blacks else 0.0
    orders = _orders(whites)
    light = np.stack([one.image[usable] for one in whites]) - dark
    light = light - offset.at(orders)[:, np.newaxis]
    # Chosen by the mean of all: chosen by one, those would count that noise made brighter in it.
    mean = light.mean(axis=0)
    bright = mean > BRIGHT * np.percentile(mean, 90, axis=0)
    values, errors = np.ones(light.shape[::2]), np.zeros(light.shape[::2])
    for colour in range(light.shape[-1]):
        lit = bright[:, colour] & (light[0, :, colour] > 0)
        if not lit.any():
            return None
        ratio = light[1:, lit, colour] / light[0, lit, colour]
        values[1:, colour], errors[1:, colour] = _medians(ratio)
    typical = float(np.median(mean[bright])) if bright.any() else 0.0
    return Drift(Trace(orders, values, errors), offset, typical) if typical > 0 else None


def _offset(blacks: Sequence[Level], usable: NDArray[np.bool_], colours: int) -> Trace:
    if not blacks:
        return Trace(np.zeros(1), np.zeros((1, colours)), np.zeros((1, colours)))
    values, errors = np.zeros((len(blacks), colours)), np.zeros((len(blacks), colours))
    first = blacks[0].image[usable]
    for k, one in enumerate(blacks[1:], 1):
        for colour in range(colours):
            rise = (one.image[usable] - first)[np.newaxis, :, colour]
            (values[k, colour],), (errors[k, colour],) = _medians(rise)
    return Trace(_orders(blacks), values, errors)


def _black(blacks: Sequence[Level], offset: Trace) -> Image:
    """The black level as at the first reference, from all."""
    mean = np.mean([one.image for one in blacks], axis=0)
    found: Image = mean - offset.values.mean(axis=0).astype(np.float32)
    return found


def _orders(levels: Sequence[Level]) -> Array:
    return np.array([one.order for one in levels], np.float64)


def _medians(samples: NDArray[np.float32] | Array) -> tuple[Array, Array]:
    """Median of each row and its standard error."""
    rows = samples.astype(np.float64)
    middle: Array = np.asarray(np.median(rows, axis=1))
    off = np.median(np.abs(rows - middle[:, np.newaxis]), axis=1)
    return middle, np.asarray(_MEDIAN_ERROR * off / np.sqrt(rows.shape[1]))
