"""What Nikon's and Canon's GetEvent deliver, to and from bytes.

No recorded traffic stands behind this: the layouts are those of libgphoto2's ptp-pack.c.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from drivers.ptp.codes import CanonRecord, DataType
from drivers.ptp.cursor import Cursor
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.transaction import Event
from drivers.ptp.wire import Bytes

_RECORD_HEADER_BYTES = 8
# (format, size, name): where they lie in the body of a record that announces an object.
_OBJECT_FIELDS = {
    CanonRecord.OBJECT_ADDED: (8, 0x14, 0x20),
    CanonRecord.OBJECT_ADDED_64: (8, 0x14, 0x24),
    CanonRecord.REQUEST_OBJECT_TRANSFER: (4, 0x0C, 0x14),
    CanonRecord.REQUEST_OBJECT_TRANSFER_64: (4, 0x0C, 0x14),
}
_OBJECT_KINDS = {int(kind): kind for kind in _OBJECT_FIELDS}


@dataclass(frozen=True, slots=True)
class CanonPropertyValue:
    """A property of Canon EOS has this value, in as many bytes as it takes."""

    code: int
    value: bytes


@dataclass(frozen=True, slots=True)
class CanonPropertyChoices:
    """What a property of Canon EOS can be set to now; no values where they are not 32 bits each."""

    code: int
    kind: int
    values: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class CanonObject:
    """An object is on the card, or waits to be fetched.

    Parameters
    ----------
    kind
        Which of the four records tells of it.
    handle, object_format, size, filename
        Of the object; 0 and "" where the record is too short to say.
    """

    kind: CanonRecord
    handle: int
    object_format: int = 0
    size: int = 0
    filename: str = ""


@dataclass(frozen=True, slots=True)
class CanonOther:
    """Any other record."""

    kind: int
    body: bytes


CanonHappening: TypeAlias = CanonPropertyValue | CanonPropertyChoices | CanonObject | CanonOther


def decode_nikon_events(data: Bytes) -> tuple[Event, ...]:
    """Events of Nikon's GetEvent (0x90C7), each with one parameter; no bytes are no events."""
    if not data:
        return ()
    cursor = Cursor(data, "Nikon's list of events")
    return tuple(Event(cursor.u16(), (cursor.u32(),)) for _ in range(cursor.u16()))


def encode_nikon_events(events: Sequence[Event]) -> bytes:
    """The same as it travels."""
    pairs = (
        struct.pack("<HI", event.code, event.parameters[0] if event.parameters else 0)
        for event in events
    )
    return struct.pack("<H", len(events)) + b"".join(pairs)


def decode_canon_records(data: Bytes) -> tuple[CanonHappening, ...]:
    """Records of Canon's GetEvent (0x9116), up to the one that ends them or to the last byte."""
    cursor = Cursor(data, "Canon's list of events")
    records: list[CanonHappening] = []
    while cursor.left:
        size, kind = cursor.u32(), cursor.u32()
        if size < _RECORD_HEADER_BYTES:
            raise PtpProtocolError(f"a Canon record of {size} bytes")
        body = cursor.take(size - _RECORD_HEADER_BYTES)
        if kind == CanonRecord.END:
            break
        records.append(_decode_record(kind, body))
    return tuple(records)


def encode_canon_record(kind: int, body: bytes) -> bytes:
    """One record as it travels; the list ends with kind `CanonRecord.END` and no body."""
    return struct.pack("<II", _RECORD_HEADER_BYTES + len(body), kind) + body


def _decode_record(kind: int, body: memoryview) -> CanonHappening:
    cursor = Cursor(body, f"Canon record 0x{kind:04X}")
    if kind == CanonRecord.PROPERTY_VALUE:
        return CanonPropertyValue(cursor.u32(), bytes(cursor.take(cursor.left)))
    if kind == CanonRecord.PROPERTY_CHOICES:
        code, value_kind, count = cursor.u32(), cursor.u32(), cursor.u32()
        return CanonPropertyChoices(code, value_kind, _choices(cursor, count))
    if kind in _OBJECT_KINDS:
        return _decode_object(_OBJECT_KINDS[kind], cursor.u32(), body)
    return CanonOther(kind, bytes(body))


def _choices(cursor: Cursor, count: int) -> tuple[int, ...]:
    """Values of 32 bits each; image formats are longer, and nobody here needs their list."""
    if cursor.left != 4 * count:
        return ()
    return cursor.numbers(DataType.UINT32, count)


def _decode_object(kind: CanonRecord, handle: int, body: memoryview) -> CanonObject:
    format_at, size_at, name_at = _OBJECT_FIELDS[kind]
    if len(body) < size_at + 4:
        return CanonObject(kind, handle)
    object_format = int.from_bytes(body[format_at : format_at + 2], "little")
    size = int.from_bytes(body[size_at : size_at + 4], "little")
    name = bytes(body[name_at:]).split(b"\0", 1)[0].decode("ascii", "replace")
    return CanonObject(kind, handle, object_format, size, name)
