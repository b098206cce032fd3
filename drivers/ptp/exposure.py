"""Exposure time, aperture and ISO as the numbers of a camera's own scales.

A camera knows a few dozen values of each. What is asked must be one of them; how far it may be
off is the rounding of the camera's own number: 1/30 s is 333 on a scale of 0.1 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from drivers.errors import SettingsError

# Values stand a third of a stop (26 %) apart; 0.333 and 0.0167 still mean 1/3 and 1/60.
SAME = 0.0025
NAMED = 2  # nearest values on either side of what was asked


@dataclass(frozen=True, slots=True)
class Scale:
    """How the numbers of a property stand for a quantity.

    Parameters
    ----------
    name, text
        The quantity, and how a value of it is written in messages.
    value
        The quantity for a number of the camera; None for bulb, auto and the like.
    number
        The number nearest to a quantity; for properties that list no values.
    is_same
        Whether a number is what a quantity is rounded to.
    """

    name: str
    text: Callable[[float], str]
    value: Callable[[int], float | None]
    number: Callable[[float], int]
    is_same: Callable[[float, int], bool]

    def choose(self, asked: float, numbers: Iterable[int]) -> int:
        """The camera's number for a quantity.

        Raises
        ------
        SettingsError
            The camera has no such value; names the nearest that it has.
        """
        values = {number: value for number in numbers if (value := self.value(number)) is not None}
        same = [number for number in values if self.is_same(asked, number)]
        if same:
            return min(same, key=lambda number: abs(values[number] - asked))
        nearest = sorted(set(values.values()), key=lambda value: abs(math.log(value / asked)))
        options = ", ".join(self.text(value) for value in sorted(nearest[:NAMED]))
        raise SettingsError(
            f"the camera has no {self.name} {self.text(asked)}; "
            + (f"the nearest it has: {options}" if options else "it offers none at all now")
        )


def seconds(duration_s: float) -> str:
    """A shutter time as it is written on cameras."""
    if duration_s >= 0.3:
        return f"{duration_s:.4g} s"
    return f"{duration_s:.4g} s (1/{1 / duration_s:.3g})"


def _is_tenth_of_millisecond(asked_s: float, number: int) -> bool:
    """Makers round or cut off: 1/60 s is 167 with some and 166 with others."""
    tenths = asked_s * 1e4
    return number in {math.floor(tenths), round(tenths)} or _is_close(asked_s, number / 1e4)


def _is_close(asked: float, value: float) -> bool:
    return abs(value - asked) <= SAME * asked


def _fraction(number: int) -> float | None:
    numerator, denominator = number >> 16, number & 0xFFFF
    if number >= 0xFFFFFFFD or not numerator or not denominator:  # bulb, x200, time
        return None
    return numerator / denominator


def _as_fraction(asked_s: float) -> int:
    return 1 << 16 | round(1 / asked_s) if asked_s < 1 else round(asked_s * 10) << 16 | 10


BULB = 0xFFFFFFFF

TENTHS_OF_MILLISECONDS = Scale(
    "exposure time",
    seconds,
    lambda number: number / 1e4 if 0 < number < BULB - 2 else None,
    lambda asked_s: round(asked_s * 1e4),
    _is_tenth_of_millisecond,
)
FRACTION = Scale(
    "exposure time",
    seconds,
    _fraction,
    _as_fraction,
    lambda asked_s, number: _is_close(asked_s, _fraction(number) or math.inf),
)
F_NUMBER = Scale(
    "aperture",
    lambda value: f"f/{value:.3g}",
    lambda number: number / 100 if 0 < number < 0xFFFF else None,
    lambda asked: round(asked * 100),
    lambda asked, number: number == round(asked * 100),
)
ISO = Scale(
    "ISO speed",
    lambda value: f"{value:.0f}",
    lambda number: float(number) if 0 < number < 0xFFFF else None,
    round,
    lambda asked, number: number == round(asked),
)


def coded(name: str, text: Callable[[float], str], values: dict[int, float]) -> Scale:
    """A scale whose numbers are codes for values, both known from a table."""
    return Scale(
        name,
        text,
        values.get,
        lambda asked: min(values, key=lambda number: abs(values[number] - asked)),
        lambda asked, number: _is_close(asked, values[number]),
    )
