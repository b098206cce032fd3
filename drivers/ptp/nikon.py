"""Nikon's single-lens reflexes: the D4S and its kin.

No recorded traffic of these cameras was at hand. Operations, properties and the order of steps
are those that libgphoto2 (camlibs/ptp2) uses; the lists of a real D4S confirm that it has them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from drivers.errors import CameraTimeoutError, SettingsError
from drivers.protocols import CameraSettings
from drivers.ptp import nikon_live_view, objects, stores
from drivers.ptp.body import CameraState
from drivers.ptp.codes import (
    DataType,
    EventCode,
    NikonEvent,
    NikonOperation,
    NikonProperty,
    Operation,
    Property,
    ResponseCode,
)
from drivers.ptp.cursor import Cursor
from drivers.ptp.datasets import DeviceInfo
from drivers.ptp.dials import Dials
from drivers.ptp.errors import PtpRefusedError
from drivers.ptp.exposure import F_NUMBER, FRACTION, ISO, TENTHS_OF_MILLISECONDS, Scale
from drivers.ptp.objects import CameraFile
from drivers.ptp.properties import Choices
from drivers.ptp.session import BUSY, PtpSession
from drivers.ptp.shot import Shot
from drivers.ptp.transaction import Event
from drivers.ptp.vendor_events import decode_nikon_events

POLL_S = 0.1
FIRST_SDRAM_HANDLE, SDRAM_OBJECT = 0xFFFF0000, 0xFFFF0001
MANUAL_EXPOSURE = 1
MANUAL_FOCUS, MANUAL_AF_MODE = 1, 4
WITHOUT_AUTOFOCUS = 0xFFFFFFFF
SDRAM = 1
RAW, RAW_AND_JPEG = 4, frozenset({5, 6, 7})
OFF = 0
# A camera that is busy for longer holds a picture that nobody fetched.
RELEASE_PATIENCE_S = 3.0
_LOCKED = "set the mode dial to M: in P, S and A the camera chooses it itself"
_GONE = (
    ResponseCode.INVALID_OBJECT_HANDLE,
    ResponseCode.STORE_NOT_AVAILABLE,
    ResponseCode.OPERATION_NOT_SUPPORTED,
)
_NO_REMOTE_MODE = (
    ResponseCode.OPERATION_NOT_SUPPORTED,
    ResponseCode.NIKON_CHANGE_CAMERA_MODE_FAILED,
)


class NikonBody:
    """A Nikon (see `drivers.ptp.body.Body`)."""

    def __init__(self, session: PtpSession, device: DeviceInfo) -> None:
        self._session = session
        self._operations = frozenset(device.operations)
        self._dials = Dials(session, {*device.properties, *self._vendor_properties()})
        self._before: dict[int, int] = {}

    def take_control(self) -> None:
        """Remote mode, pictures as raw files to the camera's memory, no automatic ISO."""
        if NikonOperation.CHANGE_CAMERA_MODE in self._operations:
            self._session.ask(NikonOperation.CHANGE_CAMERA_MODE, 1, accept=_NO_REMOTE_MODE)
        self._set(NikonProperty.RECORDING_MEDIA, SDRAM, "recording medium")
        self._set(NikonProperty.AUTO_ISO, OFF, "automatic ISO")
        self._set_raw()
        self._empty_sdram()

    def give_back(self) -> None:
        """The settings of before, and the camera's own buttons."""
        for code, number in self._before.items():
            with contextlib.suppress(PtpRefusedError, SettingsError):
                about = self._dials.describe(code)
                if about is not None and about.is_writable:
                    self._dials.set_number(about, number, "setting of before")
        self._before.clear()
        if NikonOperation.CHANGE_CAMERA_MODE in self._operations:
            with contextlib.suppress(PtpRefusedError):
                self._session.ask(NikonOperation.CHANGE_CAMERA_MODE, 0, patience_s=1.0)

    def state(self) -> CameraState:
        """What dials, lens and battery say."""
        dials = self._dials
        program = dials.number(Property.EXPOSURE_PROGRAM)
        quality = dials.number(Property.COMPRESSION)
        exposure_s = dials.quantity(*self._shutter())
        iso = dials.quantity(Property.EXPOSURE_INDEX, ISO)
        aperture = dials.quantity(Property.F_NUMBER, F_NUMBER)
        return CameraState(
            battery_percent=dials.number(Property.BATTERY_LEVEL),
            is_manual_exposure=None if program is None else program == MANUAL_EXPOSURE,
            is_manual_focus=self._is_manual_focus(),
            takes_raw=None if quality is None else quality in {RAW, *RAW_AND_JPEG},
            room=stores.room(self._session, self._operations),
            settings=None
            if exposure_s is None
            else CameraSettings(exposure_s, aperture, None if iso is None else round(iso)),
        )

    def apply(self, settings: CameraSettings) -> None:
        """Set exposure time, aperture and ISO and read them back."""
        dials = self._dials
        dials.turn(*self._shutter(), settings.exposure_s, _LOCKED)
        if settings.aperture is not None:
            dials.turn(Property.F_NUMBER, F_NUMBER, settings.aperture, _LOCKED)
        if settings.iso is not None:
            dials.turn(Property.EXPOSURE_INDEX, ISO, settings.iso, _LOCKED)

    def expose(self, exposure_s: float) -> list[CameraFile]:
        """Release to the camera's memory, wait, fetch, delete."""
        session = self._session
        self._forget_older()
        self._release_or_empty()
        expected = 2 if self._dials.number(Property.COMPRESSION) in RAW_AND_JPEG else 1
        shot = Shot(session.clock, exposure_s, expected)
        releases = 1
        while True:
            is_busy = self._is_busy()
            events = self._drain()
            _tell(events, shot)
            if shot.is_over():
                return self._collect(shot.objects or [SDRAM_OBJECT], expected)
            if releases == 1 and any(event.code == NikonEvent.MIRROR_UP for event in events):
                releases += 1
                self._release()
            if not is_busy and not shot.objects and shot.is_late():
                self._look(shot)
            session.pause(POLL_S)

    def live_view(self) -> Iterator[bytes]:
        """Frames of the live view, see `drivers.ptp.nikon_live_view`."""
        prohibition = self._dials.number(NikonProperty.LIVE_VIEW_PROHIBITION)
        return nikon_live_view.frames(self._session, prohibition or 0)

    def drive_focus(self, steps: int) -> None:
        """Turn the lens's focus motor; positive steps towards infinity. Needs live view."""
        nikon_live_view.drive_focus(self._session, steps)

    def _vendor_properties(self) -> tuple[int, ...]:
        """Properties that Nikon's bodies keep out of their device info."""
        if NikonOperation.GET_VENDOR_PROP_CODES not in self._operations:
            return ()
        try:
            data = self._session.ask(NikonOperation.GET_VENDOR_PROP_CODES).data
        except PtpRefusedError:
            return ()
        return Cursor(data, "Nikon's list of properties").array(DataType.UINT16)

    def _shutter(self) -> tuple[int, Scale]:
        """The fraction where there is one: 500D rounds fast times to nothing."""
        if NikonProperty.SHUTTER_SPEED in self._dials:
            return NikonProperty.SHUTTER_SPEED, FRACTION
        return Property.EXPOSURE_TIME, TENTHS_OF_MILLISECONDS

    def _is_manual_focus(self) -> bool | None:
        lever = self._dials.number(Property.FOCUS_MODE)
        mode = self._dials.number(NikonProperty.AF_MODE)
        if lever is None and mode is None:
            return None
        return lever == MANUAL_FOCUS or mode == MANUAL_AF_MODE

    def _set(self, code: int, number: int, name: str) -> None:
        """Set a property that the camera may lack, and remember what it was."""
        about = self._dials.describe(code)
        if about is None or not isinstance(about.current, int) or about.current == number:
            return
        if about.is_writable:
            self._before.setdefault(code, about.current)
            self._dials.set_number(about, number, name)

    def _set_raw(self) -> None:
        about = self._dials.describe(Property.COMPRESSION)
        if about is None:
            return
        if isinstance(about.allowed, Choices) and RAW in about.allowed.values:
            self._set(Property.COMPRESSION, RAW, "picture quality")
        if self._dials.number(Property.COMPRESSION) not in {RAW, *RAW_AND_JPEG}:
            raise SettingsError(
                "the camera takes JPEG and does not let that be changed from here; "
                "set its image quality to NEF (RAW)"
            )

    def _forget_older(self) -> None:
        """Wait for a shot that is still under way and throw it away: it shows another pattern."""
        if NikonOperation.DEVICE_READY in self._operations:
            self._session.ask(NikonOperation.DEVICE_READY)
        if any(event.code == NikonEvent.OBJECT_ADDED_IN_SDRAM for event in self._drain()):
            self._empty_sdram()

    def _release_or_empty(self) -> None:
        """Release; a camera that stays busy is rid of a picture that nobody fetched."""
        try:
            self._release()
        except PtpRefusedError as error:
            if error.code != ResponseCode.DEVICE_BUSY:
                raise
            self._empty_sdram()
            self._release()

    def _release(self) -> None:
        """Without autofocus, to the camera's memory, in the newest way that the body knows."""
        ask = self._session.ask
        operations = self._operations
        if NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA in operations:
            release = (NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA, WITHOUT_AUTOFOCUS)
            one_only = (ResponseCode.PARAMETER_NOT_SUPPORTED,)
            reply = ask(*release, SDRAM, patience_s=RELEASE_PATIENCE_S, accept=one_only)
            if reply.code in one_only:
                ask(*release, patience_s=RELEASE_PATIENCE_S)
        elif NikonOperation.CAPTURE in operations:
            ask(NikonOperation.CAPTURE, WITHOUT_AUTOFOCUS, patience_s=RELEASE_PATIENCE_S)
        elif NikonOperation.AF_AND_CAPTURE_IN_SDRAM in operations:
            ask(NikonOperation.AF_AND_CAPTURE_IN_SDRAM, patience_s=RELEASE_PATIENCE_S)
        else:
            ask(Operation.INITIATE_CAPTURE, 0, 0, patience_s=RELEASE_PATIENCE_S)

    def _is_busy(self) -> bool:
        if NikonOperation.DEVICE_READY not in self._operations:
            return False
        reply = self._session.ask(NikonOperation.DEVICE_READY, accept=BUSY)
        return reply.code in BUSY

    def _drain(self) -> list[Event]:
        """All events that the camera has, from both of its ways to tell them."""
        reply = self._session.ask(NikonOperation.GET_EVENT, accept=BUSY)
        return [*decode_nikon_events(reply.data), *self._session.events()]

    def _look(self, shot: Shot) -> None:
        """See whether there is a picture that no event told of."""
        if objects.pictures(self._session, [SDRAM_OBJECT]):
            shot.object_added(SDRAM_OBJECT)
            shot.completed()

    def _collect(self, added: list[int], expected: int) -> list[CameraFile]:
        """Fetch and delete; some bodies give both files of a pair the same handle in turn."""
        files: list[CameraFile] = []
        for handle in [*added, *added[:1] * (expected - len(added))]:
            files += self._fetch(handle)
        if not files:
            raise CameraTimeoutError("the camera says that it exposed but has no picture to fetch")
        return sorted(files, key=objects.is_jpeg)

    def _fetch(self, handle: int) -> list[CameraFile]:
        found = objects.pictures(self._session, [handle])
        files = [objects.download(self._session, *picture, ()) for picture in found]
        if files and handle >= FIRST_SDRAM_HANDLE:
            self._delete(handle)
        return files

    def _delete(self, handle: int) -> None:
        try:
            objects.delete(self._session, handle)
        except PtpRefusedError:
            self._empty_sdram()

    def _empty_sdram(self) -> None:
        """Have pictures that were never fetched thrown away: they would block the next one."""
        if NikonOperation.DELETE_IMAGES_IN_SDRAM in self._operations:
            operation = NikonOperation.DELETE_IMAGES_IN_SDRAM
            self._session.ask(operation, SDRAM_OBJECT, accept=_GONE)


def _tell(events: list[Event], shot: Shot) -> None:
    """What events say about a shot; property changes and the like say nothing."""
    for event in events:
        parameter = event.parameters[0] if event.parameters else 0
        match event.code:
            case NikonEvent.OBJECT_ADDED_IN_SDRAM:
                shot.object_added(parameter or SDRAM_OBJECT)
            case EventCode.OBJECT_ADDED if parameter and parameter not in shot.objects:
                shot.object_added(parameter)
            case NikonEvent.CAPTURE_COMPLETE_REC_IN_SDRAM | EventCode.CAPTURE_COMPLETE:
                shot.completed()
            case EventCode.STORE_FULL:
                shot.store_full()
