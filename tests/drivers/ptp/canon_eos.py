"""A small Canon EOS for tests: remote mode, settings by records, a pair of files a shot."""

from __future__ import annotations

import struct

from drivers.protocols import Clock
from drivers.ptp.codes import (
    CanonOperation,
    CanonProperty,
    CanonRecord,
    ContainerType,
    Operation,
    ResponseCode,
)
from drivers.ptp.datasets import CANON_EXTENSION, DeviceInfo
from drivers.ptp.vendor_events import encode_canon_record
from drivers.ptp.wire import Container
from drivers.sim.ptp_responder.answer import Output

RAW_AND_JPEG = struct.pack("<9I", 2, 0x10, 6, 0, 4, 0x10, 1, 0, 3)
RAW = struct.pack("<5I", 1, 0x10, 6, 0, 4)
RAW_FORMAT, JPEG_FORMAT = 0xB103, 0x3801
FULL_PRESS = 2
TAKES_DATA = CanonOperation.SET_DEVICE_PROP_VALUE_EX
INFO = DeviceInfo(
    operations=(*map(int, Operation), *map(int, CanonOperation)), events=(), properties=(),
    capture_formats=(), image_formats=(), manufacturer="Canon Inc.", model="Canon EOS 5D",
    device_version="1", serial="42", vendor_extension=CANON_EXTENSION,
)  # fmt: skip


class CanonEos:
    """A body in the responder's role, as `drivers.sim.ptp_responder.responder.Responder` is one.

    Attributes
    ----------
    values
        Of its properties.
    keeps
        Properties that it does not change whatever it is told.
    is_remote, log
        Whether a computer has it; the operations so far.
    """

    def __init__(self, raw: bytes, jpeg: bytes, clock: Clock, jpeg_first: bool = False) -> None:
        self.values: dict[int, bytes] = {
            CanonProperty.SHUTTER_SPEED: struct.pack("<I", 0x60),
            CanonProperty.APERTURE: struct.pack("<I", 0x30),
            CanonProperty.ISO_SPEED: struct.pack("<I", 0x48),
            CanonProperty.AUTO_EXPOSURE_MODE: struct.pack("<I", 3),
            CanonProperty.FOCUS_MODE: struct.pack("<I", 3),
            CanonProperty.CAPTURE_DESTINATION: struct.pack("<I", 2),
            CanonProperty.IMAGE_FORMAT: RAW,
        }
        self.choices = {
            CanonProperty.SHUTTER_SPEED: (0x38, 0x54, 0x5C, 0x60),
            CanonProperty.APERTURE: (0x30, 0x38, 0x40),
            CanonProperty.ISO_SPEED: (0x48, 0x50),
        }
        self.keeps: set[int] = set()
        self.busy: list[int] = []
        self.is_remote = False
        self.log: list[int] = []
        self._files = {0x91: ("IMG_1.CR2", RAW_FORMAT, raw), 0x92: ("IMG_1.JPG", JPEG_FORMAT, jpeg)}
        self._order = sorted(self._files, reverse=jpeg_first)
        self._clock = clock
        self._waiting: Container | None = None
        self._records: list[bytes] = []

    def due_events(self) -> list[Container]:
        return []

    def reset(self) -> None:
        self.is_remote = False

    def handle(self, container: Container) -> list[Output]:
        if container.kind is ContainerType.COMMAND and container.code == TAKES_DATA:
            self._waiting = container
            return []
        command, data = container, b""
        if container.kind is ContainerType.DATA:
            assert self._waiting is not None
            command, data = self._waiting, bytes(container.payload)
        self.log.append(command.code)
        answer = self._answer(command.code, command.parameters, data)
        code = answer if isinstance(answer, int) else ResponseCode.OK
        response = Container(ContainerType.RESPONSE, code, command.transaction)
        if not isinstance(answer, bytes):
            return [response]
        return [Container(ContainerType.DATA, command.code, command.transaction, answer), response]

    def _answer(self, code: int, parameters: tuple[int, ...], data: bytes) -> bytes | int | None:
        match code:
            case Operation.GET_DEVICE_INFO:
                return INFO.encode()
            case CanonOperation.SET_REMOTE_MODE:
                self.is_remote = bool(parameters[0])
            case CanonOperation.SET_EVENT_MODE if parameters[0]:
                self._tell_everything()
            case CanonOperation.GET_EVENT:
                records, self._records = self._records, []
                return b"".join(records) + encode_canon_record(CanonRecord.END, b"")
            case CanonOperation.SET_DEVICE_PROP_VALUE_EX:
                self._set(struct.unpack_from("<I", data, 4)[0], data[8:])
            case CanonOperation.REMOTE_RELEASE_ON if parameters[0] == FULL_PRESS:
                return self._release()
            case CanonOperation.GET_PARTIAL_OBJECT:
                handle, offset, length = parameters
                return self._files[handle][2][offset : offset + length]
            case CanonOperation.GET_VIEWFINDER_DATA:
                jpeg = self._files[0x92][2]
                return struct.pack("<III", 12, 9, 0) + struct.pack("<II", 8 + len(jpeg), 1) + jpeg
        return None

    def _release(self) -> int | None:
        if self.busy:
            return self.busy.pop()
        if self.values[CanonProperty.CAPTURE_DESTINATION][0] != 4:
            return ResponseCode.STORE_NOT_AVAILABLE
        pair = self.values[CanonProperty.IMAGE_FORMAT] == RAW_AND_JPEG
        for handle in self._order if pair else [0x91]:
            name, kind, data = self._files[handle]
            body = (
                struct.pack("<IIII", handle, kind, 0, len(data)) + bytes(4) + name.encode() + b"\0"
            )
            self._records.append(encode_canon_record(CanonRecord.REQUEST_OBJECT_TRANSFER, body))
        return None

    def _set(self, code: int, value: bytes) -> None:
        if code not in self.keeps:
            self.values[code] = value
        self._tell(code)

    def _tell(self, code: int) -> None:
        body = struct.pack("<I", code) + self.values[code]
        self._records.append(encode_canon_record(CanonRecord.PROPERTY_VALUE, body))

    def _tell_everything(self) -> None:
        for code in self.values:
            self._tell(code)
        for code, choices in self.choices.items():
            body = struct.pack(f"<III{len(choices)}I", code, 3, len(choices), *choices)
            self._records.append(encode_canon_record(CanonRecord.PROPERTY_CHOICES, body))
