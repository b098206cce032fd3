"""What a camera says of itself, its stores and its objects, to and from bytes.

Datasets of ISO 15740:2013: DeviceInfo 5.5.1, StorageInfo 5.5.2, ObjectInfo 5.5.3. Bytes after the
last field are ignored: some cameras pad.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

from drivers.ptp.codes import DataType
from drivers.ptp.cursor import Cursor, array_bytes, string_bytes
from drivers.ptp.wire import Bytes

NIKON_EXTENSION = 0x0000000A
CANON_EXTENSION = 0x0000000B
MICROSOFT_EXTENSION = 0x00000006  # what most makers claim who have their own


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """Answer to GetDeviceInfo.

    Parameters
    ----------
    operations, events, properties, capture_formats, image_formats
        Codes that the device supports.
    manufacturer, model, device_version, serial
        As the device spells them.
    vendor_extension, vendor_extension_version, vendor_extension_text
        Whose codes from 0x9000 on they are.
    standard_version
        Of PTP, times 100.
    functional_mode
        0 is standard.
    """

    operations: tuple[int, ...]
    events: tuple[int, ...]
    properties: tuple[int, ...]
    capture_formats: tuple[int, ...]
    image_formats: tuple[int, ...]
    manufacturer: str
    model: str
    device_version: str
    serial: str
    vendor_extension: int = 0
    vendor_extension_version: int = 100
    vendor_extension_text: str = ""
    standard_version: int = 100
    functional_mode: int = 0

    @classmethod
    def decode(cls, data: Bytes) -> DeviceInfo:
        """From the dataset's bytes."""
        cursor = Cursor(data, "device info")
        standard_version, extension, version = cursor.u16(), cursor.u32(), cursor.u16()
        text, mode = cursor.string(), cursor.u16()
        return cls(
            cursor.array(DataType.UINT16),
            cursor.array(DataType.UINT16),
            cursor.array(DataType.UINT16),
            cursor.array(DataType.UINT16),
            cursor.array(DataType.UINT16),
            cursor.string(),
            cursor.string(),
            cursor.string(),
            cursor.string(),
            extension,
            version,
            text,
            standard_version,
            mode,
        )

    def encode(self) -> bytes:
        """As it travels."""
        codes = (
            self.operations,
            self.events,
            self.properties,
            self.capture_formats,
            self.image_formats,
        )
        texts = (self.manufacturer, self.model, self.device_version, self.serial)
        return b"".join(
            (
                struct.pack(
                    "<HIH",
                    self.standard_version,
                    self.vendor_extension,
                    self.vendor_extension_version,
                ),
                string_bytes(self.vendor_extension_text),
                struct.pack("<H", self.functional_mode),
                *(array_bytes(DataType.UINT16, part) for part in codes),
                *(string_bytes(text) for text in texts),
            )
        )


@dataclass(frozen=True, slots=True)
class StorageInfo:
    """Answer to GetStorageInfo.

    Parameters
    ----------
    storage_type
        1 fixed ROM, 2 removable ROM, 3 fixed RAM, 4 removable RAM.
    filesystem_type
        1 flat, 2 hierarchical, 3 DCF.
    access
        0 read and write, 1 read only, 2 read only but deletable.
    capacity_bytes, free_bytes
        Of the store.
    free_images
        How many more it takes; 0xFFFFFFFF when it does not say.
    description, label
        Text.
    """

    storage_type: int
    filesystem_type: int
    access: int
    capacity_bytes: int
    free_bytes: int
    free_images: int
    description: str = ""
    label: str = ""

    @classmethod
    def decode(cls, data: Bytes) -> StorageInfo:
        """From the dataset's bytes."""
        cursor = Cursor(data, "storage info")
        return cls(
            cursor.u16(),
            cursor.u16(),
            cursor.u16(),
            cursor.u64(),
            cursor.u64(),
            cursor.u32(),
            cursor.string(),
            cursor.string(),
        )

    def encode(self) -> bytes:
        """As it travels."""
        return b"".join(
            (
                struct.pack(
                    "<HHHQQI",
                    self.storage_type,
                    self.filesystem_type,
                    self.access,
                    self.capacity_bytes,
                    self.free_bytes,
                    self.free_images,
                ),
                string_bytes(self.description),
                string_bytes(self.label),
            )
        )


@dataclass(frozen=True, slots=True)
class Picture:
    """Format and size of an object's thumbnail; all 0 when there is none."""

    image_format: int = 0
    size: int = 0
    width_px: int = 0
    height_px: int = 0


@dataclass(frozen=True, slots=True)
class ObjectInfo:
    """Answer to GetObjectInfo.

    Parameters
    ----------
    storage, object_format, size
        Store, format code and bytes of the object; 0xFFFFFFFF bytes when it has 4 GiB or more.
    filename, captured_at
        Its name, and its date as YYYYMMDDThhmmss.
    width_px, height_px, bit_depth
        Of the image; 0 when not known.
    thumbnail
        Of the object.
    parent, association_type, association, sequence
        Its place among folders.
    protection
        1 for read only.
    modified_at, keywords
        As captured_at; text.
    """

    storage: int
    object_format: int
    size: int
    filename: str
    captured_at: str = ""
    width_px: int = 0
    height_px: int = 0
    bit_depth: int = 0
    thumbnail: Picture = field(default_factory=Picture)
    parent: int = 0
    association_type: int = 0
    association: int = 0
    sequence: int = 0
    protection: int = 0
    modified_at: str = ""
    keywords: str = ""

    @classmethod
    def decode(cls, data: Bytes) -> ObjectInfo:
        """From the dataset's bytes."""
        cursor = Cursor(data, "object info")
        storage, object_format = cursor.u32(), cursor.u16()
        protection, size = cursor.u16(), cursor.u32()
        thumbnail = Picture(cursor.u16(), cursor.u32(), cursor.u32(), cursor.u32())
        width_px, height_px, bit_depth = cursor.u32(), cursor.u32(), cursor.u32()
        parent, association_type = cursor.u32(), cursor.u16()
        association, sequence = cursor.u32(), cursor.u32()
        filename, captured_at = cursor.string(), cursor.string()
        return cls(
            storage,
            object_format,
            size,
            filename,
            captured_at,
            width_px,
            height_px,
            bit_depth,
            thumbnail,
            parent,
            association_type,
            association,
            sequence,
            protection,
            cursor.string(),
            cursor.string(),
        )

    def encode(self) -> bytes:
        """As it travels."""
        numbers = struct.pack(
            "<IHHIHIIIIIIIHII",
            self.storage,
            self.object_format,
            self.protection,
            self.size,
            self.thumbnail.image_format,
            self.thumbnail.size,
            self.thumbnail.width_px,
            self.thumbnail.height_px,
            self.width_px,
            self.height_px,
            self.bit_depth,
            self.parent,
            self.association_type,
            self.association,
            self.sequence,
        )
        texts = (self.filename, self.captured_at, self.modified_at, self.keywords)
        return numbers + b"".join(string_bytes(text) for text in texts)


def decode_handles(data: Bytes) -> tuple[int, ...]:
    """The object handles or storage numbers of GetObjectHandles and GetStorageIDs."""
    return Cursor(data, "list of handles").array(DataType.UINT32)
