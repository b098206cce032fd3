"""Datasets: known bytes, every field there and back, nothing read past the end."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.ptp.codes import ARRAY, CanonRecord, DataType, Format, Property
from drivers.ptp.cursor import MAX_ELEMENTS, Cursor, PropertyValue, string_bytes, value_bytes
from drivers.ptp.datasets import DeviceInfo, ObjectInfo, Picture, StorageInfo, decode_handles
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.properties import Choices, PropertyDescription, Range
from drivers.ptp.transaction import Event
from drivers.ptp.vendor_events import (
    CanonObject,
    CanonOther,
    CanonPropertyChoices,
    CanonPropertyValue,
    decode_canon_records,
    decode_nikon_events,
    encode_canon_record,
    encode_nikon_events,
)
from drivers.sim.ptp_responder.body import d4s

u16, u32, u64 = (st.integers(0, (1 << bits) - 1) for bits in (16, 32, 64))
texts = st.text(st.characters(codec="utf-16-le", exclude_characters="\0"), max_size=120)
INTEGERS = [kind for kind in DataType if kind not in {DataType.UNDEFINED, DataType.STRING}]


def bounds(kind: DataType) -> tuple[int, int]:
    bits = 8 << (kind - 1) // 2
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if kind % 2 else (0, (1 << bits) - 1)


@st.composite
def typed_values(draw: st.DrawFn) -> tuple[int, PropertyValue]:
    kind = draw(st.sampled_from(INTEGERS))
    number = st.integers(*bounds(kind))
    return draw(
        st.one_of(
            st.tuples(st.just(int(kind)), number),
            st.tuples(st.just(kind | ARRAY), st.lists(number, max_size=9).map(tuple)),
            st.tuples(st.just(int(DataType.STRING)), texts),
        )
    )


@settings(deadline=None)
@given(typed_values())
def test_values_of_every_type_go_there_and_back(typed: tuple[int, PropertyValue]) -> None:
    kind, value = typed
    data = value_bytes(kind, value)
    cursor = Cursor(data, "value")
    assert cursor.value(kind) == value
    assert cursor.left == 0
    for end in range(len(data)):
        with pytest.raises(PtpProtocolError):
            Cursor(data[:end], "value").value(kind)


KNOWN_VALUES = {
    "8 bits below zero": (DataType.INT8, -2, "fe"),
    "f/8": (DataType.UINT16, 800, "2003"),
    "1/10 s": (DataType.UINT32, 1000, "e8030000"),
    "128 bits": (DataType.INT128, -1, "ff" * 16),
    "no text": (DataType.STRING, "", "00"),
    "text": (DataType.STRING, "Aé", "03 4100 e900 0000"),
    "array": (DataType.UINT16 | ARRAY, (1, 2), "02000000 0100 0200"),
}


@pytest.mark.parametrize("name", KNOWN_VALUES)
def test_known_values(name: str) -> None:
    kind, value, text = KNOWN_VALUES[name]
    assert isinstance(value, (int, str, tuple))
    assert value_bytes(kind, value) == bytes.fromhex(text)
    assert Cursor(bytes.fromhex(text), name).value(kind) == value


WRONG_VALUES: dict[str, tuple[int, PropertyValue]] = {
    "too large": (DataType.UINT16, 65536),
    "below zero": (DataType.UINT8, -1),
    "text for a number": (DataType.UINT16, "800"),
    "number for text": (DataType.STRING, 800),
    "number for an array": (DataType.UINT16 | ARRAY, 800),
    "array for a number": (DataType.UINT16, (800,)),
    "too long a text": (DataType.STRING, 255 * "x"),
}


@pytest.mark.parametrize("name", WRONG_VALUES)
def test_values_that_do_not_fit_their_type_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"fit|type|254"):
        value_bytes(*WRONG_VALUES[name])


def test_text_ends_at_its_nul_and_garbled_units_do_not_matter() -> None:
    assert Cursor(bytes.fromhex("03 4100 0000 4200"), "text").string() == "A"
    assert Cursor(bytes.fromhex("02 00d8 0000"), "text").string() == "\ufffd"


@pytest.mark.parametrize("count", [MAX_ELEMENTS, MAX_ELEMENTS + 1, 0xFFFFFFFF])
def test_a_count_is_not_believed(count: int) -> None:
    with pytest.raises(PtpProtocolError):
        decode_handles(count.to_bytes(4, "little") + bytes(64))


device_infos = st.builds(
    DeviceInfo,
    *[st.lists(u16, max_size=9).map(tuple)] * 5,
    *[texts] * 4,
    u32,
    u16,
    texts,
    u16,
    u16,
)
storage_infos = st.builds(StorageInfo, u16, u16, u16, u64, u64, u32, texts, texts)
object_infos = st.builds(
    ObjectInfo,
    *(u32, u16, u32, texts, texts, u32, u32, u32),
    st.builds(Picture, u16, u32, u32, u32),
    *(u32, u16, u32, u32, u16, texts, texts),
)


def check_there_and_back(
    encoded: bytes, decode: Callable[[bytes], object], expected: object
) -> None:
    assert decode(encoded) == expected
    assert decode(encoded + b"\0\0\0") == expected
    for end in range(len(encoded)):
        with pytest.raises(PtpProtocolError):
            decode(encoded[:end])


@settings(deadline=None)
@given(device_infos)
def test_device_info(info: DeviceInfo) -> None:
    check_there_and_back(info.encode(), DeviceInfo.decode, info)


@settings(deadline=None)
@given(storage_infos)
def test_storage_info(info: StorageInfo) -> None:
    check_there_and_back(info.encode(), StorageInfo.decode, info)


@settings(deadline=None)
@given(object_infos)
def test_object_info(info: ObjectInfo) -> None:
    check_there_and_back(info.encode(), ObjectInfo.decode, info)


def test_object_info_as_a_camera_sends_it() -> None:
    data = bytes.fromhex(
        "01000100 0030 0000 40420f00 0138 00200000 a0000000 78000000"  # store, format, thumbnail
        "40130000 d00c0000 0e000000 02000000 0000 00000000 01000000"  # size, folder
        "0d 4400 5300 4300 5f00 3000 3000 3000 3100 2e00 4e00 4500 4600 0000"
        "10 3200 3000 3200 3600 3000 3100 3000 3100 5400 3100 3200 3000 3000 3000 3000 0000 00 00"
    )
    assert ObjectInfo.decode(data) == ObjectInfo(
        storage=0x00010001,
        object_format=Format.UNDEFINED,
        size=1_000_000,
        filename="DSC_0001.NEF",
        captured_at="20260101T120000",
        width_px=4928,
        height_px=3280,
        bit_depth=14,
        thumbnail=Picture(Format.EXIF_JPEG, 8192, 160, 120),
        parent=2,
        sequence=1,
    )


def test_property_descriptions_of_a_whole_body_go_there_and_back() -> None:
    descriptions = d4s().descriptions
    assert len(descriptions) > 100
    for description in descriptions.values():
        encoded = description.encode()
        assert PropertyDescription.decode(encoded) == description
        # Only the form may be missing as a whole; everything else must be there.
        form_at = len(encoded) - len(encoded[5 + 2 * value_size(description) :])
        for end in set(range(len(encoded))) - {form_at}:
            with pytest.raises(PtpProtocolError):
                PropertyDescription.decode(encoded[:end])


def value_size(description: PropertyDescription) -> int:
    return len(value_bytes(description.kind, description.current))


def test_property_descriptions_as_cameras_send_them() -> None:
    aperture = bytes.fromhex("0750 0400 01 2003 2003 02 0300 1801 2003 4c04")
    assert PropertyDescription.decode(aperture) == PropertyDescription(
        code=Property.F_NUMBER,
        kind=DataType.UINT16,
        is_writable=True,
        default=800,
        current=800,
        allowed=Choices((280, 800, 1100)),
    )
    battery = bytes.fromhex("0150 0200 00 64 50 01 00 64 01")
    assert PropertyDescription.decode(battery) == PropertyDescription(
        code=Property.BATTERY_LEVEL,
        kind=DataType.UINT8,
        is_writable=False,
        default=100,
        current=80,
        allowed=Range(0, 100, 1),
    )
    without_form = bytes.fromhex("0150 0200 00 64 50")
    assert PropertyDescription.decode(without_form).allowed is None


@pytest.mark.parametrize(
    "text",
    [
        "0150 0200 02 64 50 00",
        "0150 0b00 00 64 50 00",
        "0150 0200 00 64 50 03",
        "ff50 ffff 00 00 00 01",
    ],
    ids=["access", "type", "form", "range of texts"],
)
def test_property_descriptions_that_mean_nothing_are_refused(text: str) -> None:
    with pytest.raises(PtpProtocolError):
        PropertyDescription.decode(bytes.fromhex(text))


def test_nikons_events() -> None:
    data = bytes.fromhex("0200 01c1 00000000 0d40 01000000")
    events = (Event(0xC101, (0,)), Event(0x400D, (1,)))
    assert decode_nikon_events(data) == events
    assert encode_nikon_events(events) == data
    assert decode_nikon_events(b"") == ()
    for end in range(1, len(data)):
        with pytest.raises(PtpProtocolError):
            decode_nikon_events(data[:end])


def words(*numbers: int) -> bytes:
    return b"".join(number.to_bytes(4, "little") for number in numbers)


def test_canons_records() -> None:
    name = b"IMG_0001.CR2\0"
    stream = b"".join(
        (
            encode_canon_record(0xC189, words(0xD102, 0x38)),
            encode_canon_record(0xC18A, words(0xD103, 3, 2, 0x48, 0x50)),
            encode_canon_record(0xC18A, words(0xD120, 3, 2, 1, 0x10, 4)),
            encode_canon_record(0xC181, words(7, 1, 0xB103, 0, 0, 999, 0, 0) + name),
            encode_canon_record(0xC1A7, words(7, 1, 0xB108, 0, 0, 999, 0, 0, 0) + name),
            encode_canon_record(0xC186, words(8, 0xB103, 0, 998, 0) + name),
            encode_canon_record(0xC1A9, words(9)),
            encode_canon_record(0xC1FF, b"?"),
            encode_canon_record(CanonRecord.END, b""),
            b"not read",
        )
    )
    assert decode_canon_records(stream) == (
        CanonPropertyValue(0xD102, words(0x38)),
        CanonPropertyChoices(0xD103, 3, (0x48, 0x50)),
        CanonPropertyChoices(0xD120, 3, ()),
        CanonObject(CanonRecord.OBJECT_ADDED, 7, 0xB103, 999, "IMG_0001.CR2"),
        CanonObject(CanonRecord.OBJECT_ADDED_64, 7, 0xB108, 999, "IMG_0001.CR2"),
        CanonObject(CanonRecord.REQUEST_OBJECT_TRANSFER, 8, 0xB103, 998, "IMG_0001.CR2"),
        CanonObject(CanonRecord.REQUEST_OBJECT_TRANSFER_64, 9),
        CanonOther(0xC1FF, b"?"),
    )
    assert decode_canon_records(b"") == ()


@pytest.mark.parametrize("size", [0, 7, 9, 0xFFFFFFFF])
def test_a_canon_record_whose_size_is_wrong_is_refused(size: int) -> None:
    with pytest.raises(PtpProtocolError):
        decode_canon_records(words(size, 0xC189))


def test_texts_hold_254_units() -> None:
    assert Cursor(string_bytes(254 * "x"), "text").string() == 254 * "x"
