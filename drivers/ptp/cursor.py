"""Little-endian fields of PTP datasets, read with every length checked and written.

Strings and arrays after ISO 15740:2013, 5.3. What a length may claim is bounded by the bytes
that are really there before anything is allocated, as libgphoto2 does in camlibs/ptp2/ptp-pack.c.
"""

from __future__ import annotations

import struct
from typing import TypeAlias

from drivers.ptp.codes import ARRAY, DataType
from drivers.ptp.errors import PtpProtocolError

PropertyValue: TypeAlias = int | str | tuple[int, ...]

# A card with a million objects would need 4 MB for its list of handles; no camera writes so many.
MAX_ELEMENTS = 1 << 20
MAX_STRING_UNITS = 255

_WIDTHS = {
    DataType.INT8: 1,
    DataType.UINT8: 1,
    DataType.INT16: 2,
    DataType.UINT16: 2,
    DataType.INT32: 4,
    DataType.UINT32: 4,
    DataType.INT64: 8,
    DataType.UINT64: 8,
    DataType.INT128: 16,
    DataType.UINT128: 16,
}
_LETTERS = {1: "b", 2: "h", 4: "i", 8: "q"}


class Cursor:
    """A place in a dataset that moves on as fields are read.

    Parameters
    ----------
    data
        The dataset.
    name
        What it is, for messages.
    """

    __slots__ = ("_at", "_data", "_name")

    def __init__(self, data: bytes | bytearray | memoryview, name: str) -> None:
        self._data = memoryview(data)
        self._at = 0
        self._name = name

    @property
    def left(self) -> int:
        """Bytes not read yet."""
        return len(self._data) - self._at

    def take(self, count: int) -> memoryview:
        """The next `count` bytes."""
        if count > self.left:
            raise PtpProtocolError(
                f"{self._name}: {count} bytes due at byte {self._at}, only {self.left} there"
            )
        start, self._at = self._at, self._at + count
        return self._data[start : self._at]

    def number(self, kind: DataType) -> int:
        """An integer of an elementary type."""
        return int.from_bytes(self.take(_WIDTHS[kind]), "little", signed=_is_signed(kind))

    def u8(self) -> int:
        """Eight bits."""
        return self.take(1)[0]

    def u16(self) -> int:
        """Sixteen bits."""
        return int.from_bytes(self.take(2), "little")

    def u32(self) -> int:
        """Thirty-two bits."""
        return int.from_bytes(self.take(4), "little")

    def u64(self) -> int:
        """Sixty-four bits."""
        return int.from_bytes(self.take(8), "little")

    def string(self) -> str:
        """Text of up to 254 UTF-16 units; it ends at the first NUL, whatever its length claims.

        Units that are no text become U+FFFD: a garbled name is no reason to lose an exposure.
        """
        units = self.u8()
        text = bytes(self.take(2 * units)).decode("utf-16-le", "replace")
        return text.split("\0", 1)[0]

    def numbers(self, kind: DataType, count: int) -> tuple[int, ...]:
        """`count` integers of an elementary type."""
        width = _WIDTHS[kind]
        if count > MAX_ELEMENTS:
            raise PtpProtocolError(f"{self._name}: {count} elements, at most {MAX_ELEMENTS}")
        data = self.take(count * width)
        letter = _LETTERS.get(width)
        if letter is not None:
            letter = letter if _is_signed(kind) else letter.upper()
            return struct.unpack(f"<{count}{letter}", data)
        return tuple(
            int.from_bytes(data[start : start + width], "little", signed=_is_signed(kind))
            for start in range(0, len(data), width)
        )

    def array(self, kind: DataType) -> tuple[int, ...]:
        """An array: a count of 32 bits, then the elements."""
        return self.numbers(kind, self.u32())

    def value(self, kind: int) -> PropertyValue:
        """A property's value of any type: integer, text or array."""
        if kind == DataType.STRING:
            return self.string()
        return self.array(element_type(kind)) if kind & ARRAY else self.number(element_type(kind))


def element_type(kind: int) -> DataType:
    """The elementary type of an integer or an array of integers."""
    element = kind & ~ARRAY
    if element not in _WIDTHS:
        raise PtpProtocolError(f"no such type of value: 0x{kind:04X}")
    return DataType(element)


def number_bytes(kind: DataType, value: int) -> bytes:
    """An integer as it travels; ValueError when the type cannot hold it."""
    try:
        return value.to_bytes(_WIDTHS[kind], "little", signed=_is_signed(kind))
    except OverflowError:
        raise ValueError(f"{value} does not fit {kind.name}") from None


def numbers_bytes(kind: DataType, values: tuple[int, ...]) -> bytes:
    """Integers one after another, without a count."""
    return b"".join(number_bytes(kind, value) for value in values)


def array_bytes(kind: DataType, values: tuple[int, ...]) -> bytes:
    """An array as it travels."""
    return number_bytes(DataType.UINT32, len(values)) + numbers_bytes(kind, values)


def string_bytes(text: str) -> bytes:
    """Text as it travels, with its closing NUL; the empty text is a single 0."""
    if not text:
        return b"\0"
    units = (text + "\0").encode("utf-16-le", "replace")
    if len(units) > 2 * MAX_STRING_UNITS:
        raise ValueError(f"a PTP string has at most 254 units, not {len(units) // 2 - 1}")
    return bytes([len(units) // 2]) + units


def value_bytes(kind: int, value: PropertyValue) -> bytes:
    """A property's value as it travels; ValueError when it is none of that type."""
    if isinstance(value, str):
        if kind != DataType.STRING:
            raise ValueError(f"text {value!r} for a property of type 0x{kind:04X}")
        return string_bytes(value)
    if kind == DataType.STRING or isinstance(value, tuple) != bool(kind & ARRAY):
        raise ValueError(f"{value!r} for a property of type 0x{kind:04X}")
    if isinstance(value, tuple):
        return array_bytes(element_type(kind), value)
    return number_bytes(element_type(kind), value)


def _is_signed(kind: DataType) -> bool:
    return kind % 2 == 1
