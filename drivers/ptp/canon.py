"""Canon EOS.

No recorded traffic of these cameras was at hand. Operations, records and the order of steps are
those that libgphoto2 (camlibs/ptp2) uses; the meaning of the battery's steps is from its config.c.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator

from drivers.errors import SettingsError
from drivers.protocols import CameraSettings
from drivers.ptp import canon_live_view, objects
from drivers.ptp.body import CameraState
from drivers.ptp.canon_scales import APERTURE, EXPOSURE_TIME, ISO_SPEED
from drivers.ptp.codes import CanonOperation, CanonProperty, ResponseCode
from drivers.ptp.errors import PtpProtocolError, PtpRefusedError
from drivers.ptp.exposure import Scale
from drivers.ptp.objects import CameraFile
from drivers.ptp.session import PtpSession
from drivers.ptp.shot import Shot
from drivers.ptp.vendor_events import (
    CanonHappening,
    CanonObject,
    CanonPropertyChoices,
    CanonPropertyValue,
    decode_canon_records,
)
from drivers.ptp.wire import MAX_DATA_BYTES

POLL_S = 0.05
READ_BACK_S = 2.0
MAX_DRAINS = 100
PART_BYTES = 1 << 20
MANUAL_EXPOSURE, MANUAL_FOCUS = 3, 3
COMPUTER = struct.pack("<I", 4)
# A computer's room for pictures: bytes of a cluster, clusters free.
CLUSTERS, CLUSTER_BYTES = 0x0FFFFFFF, 0x1000
HALF, FULL = 1, 2
# Of a picture format: number of entries, then length, kind, size and compression of each.
RAW_ONLY = struct.pack("<5I", 1, 0x10, 6, 0, 4)
RAW_KIND = 6
# "Low" stands for the least step.
BATTERY_PERCENT = {0: 0, 5: 25, 1: 50, 4: 75, 2: 100}


class CanonBody:
    """A Canon EOS (see `drivers.ptp.body.Body`)."""

    def __init__(self, session: PtpSession) -> None:
        self._session = session
        self._values: dict[int, bytes] = {}
        self._choices: dict[int, tuple[int, ...]] = {}
        self._before: dict[int, bytes] = {}

    def take_control(self) -> None:
        """Remote mode, events, raw files to the computer."""
        ask = self._session.ask
        ask(CanonOperation.SET_REMOTE_MODE, 1)
        ask(CanonOperation.SET_EVENT_MODE, 1)
        self._drain()
        destination = self._values.get(CanonProperty.CAPTURE_DESTINATION, COMPUTER)
        if not destination.startswith(COMPUTER):
            self._before.setdefault(CanonProperty.CAPTURE_DESTINATION, destination)
            self._confirm(CanonProperty.CAPTURE_DESTINATION, COMPUTER, "destination")
        ask(CanonOperation.PC_HDD_CAPACITY, CLUSTERS, CLUSTER_BYTES, 1)
        formats = self._formats()
        if formats and RAW_KIND not in formats:
            code = CanonProperty.IMAGE_FORMAT
            self._before.setdefault(code, self._values[code])
            self._confirm(code, RAW_ONLY, "picture quality")

    def give_back(self) -> None:
        """The settings of before, and the camera's own buttons."""
        for code, value in self._before.items():
            with contextlib.suppress(PtpRefusedError):
                self._set(code, value)
        self._before.clear()
        for operation in (CanonOperation.SET_EVENT_MODE, CanonOperation.SET_REMOTE_MODE):
            with contextlib.suppress(PtpRefusedError):
                self._session.ask(operation, 0, patience_s=1.0)

    def state(self) -> CameraState:
        """What the camera has told of its properties."""
        self._drain()
        mode = self._number(CanonProperty.AUTO_EXPOSURE_MODE)
        focus = self._number(CanonProperty.FOCUS_MODE)
        formats = self._formats()
        exposure_s = self._quantity(CanonProperty.SHUTTER_SPEED, EXPOSURE_TIME)
        iso = self._quantity(CanonProperty.ISO_SPEED, ISO_SPEED)
        battery = self._number(CanonProperty.BATTERY_POWER)
        return CameraState(
            battery_percent=None if battery is None else BATTERY_PERCENT.get(battery),
            is_manual_exposure=None if mode is None else mode == MANUAL_EXPOSURE,
            is_manual_focus=None if focus is None else focus == MANUAL_FOCUS,
            takes_raw=RAW_KIND in formats if formats else None,
            settings=None
            if exposure_s is None
            else CameraSettings(
                exposure_s,
                self._quantity(CanonProperty.APERTURE, APERTURE),
                None if iso is None else round(iso),
            ),
        )

    def apply(self, settings: CameraSettings) -> None:
        """Set exposure time, aperture and ISO and wait until the camera confirms them."""
        self._session.ask(
            CanonOperation.KEEP_DEVICE_ON, accept=(ResponseCode.OPERATION_NOT_SUPPORTED,)
        )
        self._drain()
        self._turn(CanonProperty.SHUTTER_SPEED, EXPOSURE_TIME, settings.exposure_s)
        if settings.aperture is not None:
            self._turn(CanonProperty.APERTURE, APERTURE, settings.aperture)
        if settings.iso is not None:
            self._turn(CanonProperty.ISO_SPEED, ISO_SPEED, settings.iso)

    def expose(self, exposure_s: float) -> list[CameraFile]:
        """Press the shutter, wait for the files, fetch them."""
        session = self._session
        self._drain()
        shot = Shot(session.clock, exposure_s, expected=max(1, len(self._formats())))
        self._press()
        added: dict[int, CanonObject] = {}
        while not shot.is_over():
            session.pause(POLL_S)
            for record in self._drain():
                if isinstance(record, CanonObject) and record.handle not in added:
                    added[record.handle] = record
                    shot.object_added(record.handle)
                    shot.completed()
        return sorted(map(self._fetch, added.values()), key=objects.is_jpeg)

    def live_view(self) -> Iterator[bytes]:
        """Frames of the live view, see `drivers.ptp.canon_live_view`."""
        return canon_live_view.frames(self._session)

    def _drain(self) -> list[CanonHappening]:
        """All records that the camera has; notes the properties among them."""
        drained: list[CanonHappening] = []
        for _ in range(MAX_DRAINS):
            records = decode_canon_records(self._session.ask(CanonOperation.GET_EVENT).data)
            if not records:
                break
            drained += records
        for record in drained:
            match record:
                case CanonPropertyValue(code, value):
                    self._values[code] = value
                case CanonPropertyChoices(code, _, values):
                    self._choices[code] = values
        return drained

    def _number(self, code: int) -> int | None:
        value = self._values.get(code)
        return None if value is None else int.from_bytes(value[:4], "little")

    def _quantity(self, code: int, scale: Scale) -> float | None:
        number = self._number(code)
        return None if number is None else scale.value(number)

    def _turn(self, code: int, scale: Scale, asked: float) -> None:
        number = self._number(code)
        if number is None:
            raise SettingsError(
                f"this camera's {scale.name} cannot be set from here; set it by hand and leave "
                "it out of the plan"
            )
        if scale.is_same(asked, number):
            return
        choices = self._choices.get(code, ())
        if not choices:
            raise SettingsError(
                f"the camera does not let its {scale.name} be changed; set the mode dial to M, "
                "and switch the lens on"
            )
        self._confirm(code, struct.pack("<I", scale.choose(asked, choices)), scale.name)

    def _confirm(self, code: int, value: bytes, name: str) -> None:
        """Set a property and wait for the record that says so."""
        self._set(code, value)
        deadline_s = self._session.clock.monotonic() + READ_BACK_S
        while self._session.clock.monotonic() < deadline_s:
            self._drain()
            if self._values.get(code, b"").startswith(value):
                return
            self._session.pause(POLL_S)
        raise SettingsError(
            f"the camera was told {value.hex()} for its {name} and keeps "
            f"{self._values.get(code, b'').hex() or 'silent'}; check the mode dial (M)"
        )

    def _set(self, code: int, value: bytes) -> None:
        data = struct.pack("<II", 8 + len(value), code) + value
        self._session.ask(CanonOperation.SET_DEVICE_PROP_VALUE_EX, data=data)

    def _formats(self) -> list[int]:
        """Kinds of the files that one shot makes; none when the camera has not said."""
        value = self._values.get(CanonProperty.IMAGE_FORMAT, b"")
        words = struct.unpack(f"<{len(value) // 4}I", value[: len(value) // 4 * 4])
        return list(words[2::4][: words[0]]) if words else []

    def _press(self) -> None:
        """Half, with the events that it makes, then fully, then let go."""
        ask = self._session.ask
        ask(CanonOperation.REMOTE_RELEASE_ON, HALF, 0)
        try:
            self._drain()
            ask(CanonOperation.REMOTE_RELEASE_ON, FULL, 0)
            ask(CanonOperation.REMOTE_RELEASE_OFF, FULL)
        finally:
            if self._session.is_in_step:
                ask(CanonOperation.REMOTE_RELEASE_OFF, HALF)

    def _fetch(self, added: CanonObject) -> CameraFile:
        session = self._session
        name, object_format, size = added.filename, added.object_format, added.size
        if not size:
            about = objects.info(session, added.handle)
            name, object_format, size = about.filename, about.object_format, about.size
        if size > MAX_DATA_BYTES:
            raise PtpProtocolError(f"{name} has {size} bytes, at most {MAX_DATA_BYTES} are taken")
        data = objects.read_parts(
            session, CanonOperation.GET_PARTIAL_OBJECT, added.handle, size, PART_BYTES
        )
        session.ask(CanonOperation.TRANSFER_COMPLETE, added.handle)
        return CameraFile(name, object_format, data)
