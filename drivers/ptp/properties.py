"""Descriptions of a camera's properties (ISO 15740:2013, 13.3.3), to and from bytes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeAlias

from drivers.ptp.codes import ARRAY, DataType, Form
from drivers.ptp.cursor import Cursor, PropertyValue, value_bytes
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.wire import Bytes


@dataclass(frozen=True, slots=True)
class Range:
    """Values from `minimum` to `maximum` in steps of `step`, both ends included."""

    minimum: int
    maximum: int
    step: int


@dataclass(frozen=True, slots=True)
class Choices:
    """Values one by one; may be none at all."""

    values: tuple[PropertyValue, ...]


Allowed: TypeAlias = Range | Choices | None


@dataclass(frozen=True, slots=True)
class PropertyDescription:
    """Answer to GetDevicePropDesc.

    Parameters
    ----------
    code, kind
        The property and the type of its value (`DataType`, with `ARRAY` for arrays).
    is_writable
        Whether it can be set now; a camera may take that back with its mode dial.
    default, current
        Its values.
    allowed
        What it can be set to; None when the camera does not say.
    """

    code: int
    kind: int
    is_writable: bool
    default: PropertyValue
    current: PropertyValue
    allowed: Allowed = None

    @classmethod
    def decode(cls, data: Bytes) -> PropertyDescription:
        """From the dataset's bytes; one that ends before the form has none, as some cameras do."""
        cursor = Cursor(data, "property description")
        code, kind, access = cursor.u16(), cursor.u16(), cursor.u8()
        if access > 1:
            raise PtpProtocolError(f"property 0x{code:04X} has access {access}, neither 0 nor 1")
        default, current = cursor.value(kind), cursor.value(kind)
        form = cursor.u8() if cursor.left else Form.NONE
        return cls(code, kind, bool(access), default, current, _decode_form(cursor, kind, form))

    def encode(self) -> bytes:
        """As it travels."""
        return b"".join(
            (
                struct.pack("<HHB", self.code, self.kind, self.is_writable),
                value_bytes(self.kind, self.default),
                value_bytes(self.kind, self.current),
                _form_bytes(self.kind, self.allowed),
            )
        )


def _decode_form(cursor: Cursor, kind: int, form: int) -> Allowed:
    if form == Form.NONE:
        return None
    if form == Form.ENUMERATION:
        count = cursor.u16()
        return Choices(tuple(cursor.value(kind) for _ in range(count)))
    if form == Form.RANGE and kind != DataType.STRING and not kind & ARRAY:
        element = DataType(kind)
        return Range(cursor.number(element), cursor.number(element), cursor.number(element))
    raise PtpProtocolError(f"no form {form} for a property of type 0x{kind:04X}")


def _form_bytes(kind: int, allowed: Allowed) -> bytes:
    values: tuple[PropertyValue, ...]
    match allowed:
        case None:
            return bytes([Form.NONE])
        case Range():
            values = (allowed.minimum, allowed.maximum, allowed.step)
            head = bytes([Form.RANGE])
        case Choices():
            values = allowed.values
            head = struct.pack("<BH", Form.ENUMERATION, len(allowed.values))
    return head + b"".join(value_bytes(kind, value) for value in values)
