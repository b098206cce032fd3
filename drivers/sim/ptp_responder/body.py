"""What the simulated body says of itself, from the facts in ``d4s.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Any

from drivers.ptp.codes import Format, NikonProperty, Property
from drivers.ptp.datasets import NIKON_EXTENSION, DeviceInfo
from drivers.ptp.properties import Allowed, Choices, PropertyDescription, Range

MANUAL = 1  # of the exposure program
MANUAL_FOCUS = 1  # of the focus mode
RAW = 4  # of the compression setting
BULB = 0xFFFFFFFF

_FIRST_VENDOR_OPERATION = 0x9000
_FIRST_VENDOR_PROPERTY = 0xD000
# How a lab leaves the body: mode dial on M, lens on MF, raw, and the settings of a first shot.
_AT_START: Mapping[int, int] = {
    Property.EXPOSURE_PROGRAM: MANUAL,
    Property.FOCUS_MODE: MANUAL_FOCUS,
    Property.COMPRESSION: RAW,
    Property.F_NUMBER: 800,
    Property.EXPOSURE_TIME: 1000,
    Property.EXPOSURE_INDEX: 200,
    NikonProperty.SHUTTER_SPEED: 1 << 16 | 10,
    NikonProperty.AF_MODE: 4,
}
# In M the dial reaches bulb, which the report of a body in P does not list.
_ALSO: Mapping[int, tuple[int, ...]] = {
    Property.EXPOSURE_TIME: (BULB,),
    NikonProperty.SHUTTER_SPEED: (BULB,),
}
_TIFF = 3  # of the compression setting: the simulated body writes none


@dataclass(frozen=True, slots=True)
class Body:
    """A model of camera.

    Parameters
    ----------
    info
        Its device info.
    vendor_properties
        Codes of the properties that only Nikon's 0x90CA lists.
    descriptions
        Of the properties whose values are known, as they are when it is switched on.
    """

    info: DeviceInfo
    vendor_properties: tuple[int, ...]
    descriptions: Mapping[int, PropertyDescription]


@cache
def d4s() -> Body:
    """A Nikon D4S, as far as published reports describe it."""
    facts = json.loads(resources.files(__package__).joinpath("d4s.json").read_text("utf-8"))
    codes = tuple(int(code, 16) for code in facts["properties"])
    # What follows the standard properties up to the first 0xD0xx is MTP's and in the device info.
    vendor = tuple(code for code in codes if 0xD000 <= code < 0xD300)
    return Body(
        DeviceInfo(
            operations=tuple(int(code, 16) for code in facts["operations"]),
            events=tuple(int(code, 16) for code in facts["events"]),
            properties=tuple(code for code in codes if code not in vendor),
            capture_formats=(Format.EXIF_JPEG, Format.UNDEFINED),
            image_formats=(Format.UNDEFINED, Format.ASSOCIATION, Format.EXIF_JPEG),
            manufacturer="Nikon Corporation",
            model="D4S",
            device_version="V1.10",
            serial="00000000000000000000000000000001",
            vendor_extension=NIKON_EXTENSION,
            vendor_extension_text="Microsoft.com/DeviceServices: ",
        ),
        vendor,
        {
            code: _description(code, facts["descriptions"][f"{code:04X}"])
            for code in codes
            if f"{code:04X}" in facts["descriptions"]
        },
    )


@cache
def plain() -> Body:
    """The same body as if it spoke no maker's extension: the standard's operations only."""
    body = d4s()
    return Body(
        replace(
            body.info,
            operations=tuple(c for c in body.info.operations if c < _FIRST_VENDOR_OPERATION),
            events=tuple(c for c in body.info.events if c < 0xC000),
            properties=tuple(c for c in body.info.properties if c < _FIRST_VENDOR_PROPERTY),
            manufacturer="lumisplit",
            model="simulated camera",
            vendor_extension=0,
            vendor_extension_text="",
        ),
        (),
        {c: d for c, d in body.descriptions.items() if c < _FIRST_VENDOR_PROPERTY},
    )


def _description(code: int, facts: Mapping[str, Any]) -> PropertyDescription:
    current = _AT_START.get(code, facts["current"])
    allowed: Allowed = None
    if "range" in facts:
        allowed = Range(*facts["range"])
    elif "choices" in facts:
        also = _ALSO.get(code, ())
        values = (*facts["choices"], *also)
        if code == Property.COMPRESSION:
            values = tuple(value for value in values if value != _TIFF)
        allowed = Choices(values)
    return PropertyDescription(
        code, int(facts["kind"], 16), facts["writable"], current, current, allowed
    )
