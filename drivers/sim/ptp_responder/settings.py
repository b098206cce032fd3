"""The body's properties while it runs: what they are, who may set them, what hangs on the dial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from drivers.protocols import CameraSettings
from drivers.ptp.codes import NikonProperty, Property, ResponseCode
from drivers.ptp.cursor import PropertyValue
from drivers.ptp.properties import Choices, PropertyDescription, Range
from drivers.sim.ptp_responder.answer import RefusalError
from drivers.sim.ptp_responder.body import BULB, Body

# The exposure programs in which the body lets go of a property: 1 M, 2 P, 3 A, 4 S.
_FREE_IN: Mapping[int, frozenset[int]] = {
    Property.EXPOSURE_TIME: frozenset({1, 4}),
    NikonProperty.SHUTTER_SPEED: frozenset({1, 4}),
    Property.F_NUMBER: frozenset({1, 3}),
}


class PropertyTable:
    """Current values of a body's properties.

    Parameters
    ----------
    body
        Where they start.
    """

    def __init__(self, body: Body) -> None:
        self._descriptions = dict(body.descriptions)

    def describe(self, code: int) -> PropertyDescription:
        """What the body says of a property now."""
        description = self._descriptions.get(code)
        if description is None:
            raise RefusalError(ResponseCode.PROPERTY_NOT_SUPPORTED)
        if code in _FREE_IN:
            program = self.number(Property.EXPOSURE_PROGRAM)
            return replace(description, is_writable=program in _FREE_IN[code])
        return description

    def value(self, code: int) -> PropertyValue:
        """A property's value."""
        return self.describe(code).current

    def number(self, code: int) -> int:
        """The value of a property that is a number; 0 where the body has no such property."""
        description = self._descriptions.get(code)
        return description.current if description and isinstance(description.current, int) else 0

    def set(self, code: int, value: PropertyValue) -> None:
        """Set from outside; refused where the dial or the list of values is against it."""
        description = self.describe(code)
        if not description.is_writable:
            raise RefusalError(ResponseCode.ACCESS_DENIED)
        if not _is_allowed(description, value):
            raise RefusalError(ResponseCode.INVALID_PROPERTY_VALUE)
        self.turn(code, value)

    def turn(self, code: int, value: PropertyValue) -> None:
        """Set on the body itself, where every wheel and lever can be moved."""
        self._descriptions[code] = replace(self._descriptions[code], current=value)
        if code == Property.EXPOSURE_TIME and isinstance(value, int):
            self._put(NikonProperty.SHUTTER_SPEED, self._speed_of(value))
        elif code == NikonProperty.SHUTTER_SPEED and isinstance(value, int):
            self._put(Property.EXPOSURE_TIME, _tenths_ms(value))

    @property
    def is_bulb(self) -> bool:
        """Whether the shutter stays open for as long as it is held."""
        return self.number(Property.EXPOSURE_TIME) == BULB

    def camera_settings(self) -> CameraSettings:
        """The exposure that a shot takes now; a bulb's is not defined and counts as 1 s."""
        speed = self.number(NikonProperty.SHUTTER_SPEED)
        tenths_ms = self.number(Property.EXPOSURE_TIME)
        if self.is_bulb:
            exposure_s = 1.0
        elif speed:
            exposure_s = (speed >> 16) / (speed & 0xFFFF)
        else:
            exposure_s = tenths_ms * 1e-4
        return CameraSettings(
            exposure_s, self.number(Property.F_NUMBER) / 100, self.number(Property.EXPOSURE_INDEX)
        )

    def _put(self, code: int, value: int) -> None:
        if code in self._descriptions:
            self._descriptions[code] = replace(self._descriptions[code], current=value)

    def _speed_of(self, tenths_ms: int) -> int:
        """The shutter speed that the body shows as this many 0.1 ms, rounded down; 0 for none."""
        description = self._descriptions.get(NikonProperty.SHUTTER_SPEED)
        if description is None or not isinstance(description.allowed, Choices):
            return 0
        speeds = [speed for speed in description.allowed.values if isinstance(speed, int)]
        return next((speed for speed in speeds if _tenths_ms(speed) == tenths_ms), 0)


def _tenths_ms(speed: int) -> int:
    """Exposure time in 0.1 ms of a speed written as numerator and denominator."""
    return BULB if speed == BULB else 10_000 * (speed >> 16) // (speed & 0xFFFF)


def _is_allowed(description: PropertyDescription, value: PropertyValue) -> bool:
    match description.allowed:
        case Choices(values):
            return value in values
        case Range(minimum, maximum, step):
            return isinstance(value, int) and value in range(minimum, maximum + 1, step)
        case None:
            return True
