"""Any camera that keeps to the standard (ISO 15740) and no more."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from drivers.errors import CameraError, CameraTimeoutError, SettingsError
from drivers.protocols import CameraSettings
from drivers.ptp import objects, stores
from drivers.ptp.body import CameraState
from drivers.ptp.codes import EventCode, Operation, Property, ResponseCode
from drivers.ptp.datasets import DeviceInfo
from drivers.ptp.dials import Dials
from drivers.ptp.errors import PtpRefusedError
from drivers.ptp.exposure import F_NUMBER, ISO, TENTHS_OF_MILLISECONDS
from drivers.ptp.nikon import RAW, RAW_AND_JPEG
from drivers.ptp.objects import CameraFile
from drivers.ptp.properties import Choices
from drivers.ptp.session import PtpSession
from drivers.ptp.shot import Shot

MANUAL_EXPOSURE = 1
MANUAL_FOCUS = 1
WAIT_S = 0.05
# The second file of a pair may come after the camera has said that it is done.
LINGER_S = 0.2
ANSWER_S = 30.0  # of cameras that answer only after the exposure
_LOCKED = "turn the camera's mode dial to M"


class GenericBody:
    """A camera that keeps to the standard (see `drivers.ptp.body.Body`)."""

    def __init__(self, session: PtpSession, device: DeviceInfo) -> None:
        self._session = session
        self._operations = frozenset(device.operations)
        self._dials = Dials(session, device.properties)
        # The standard leaves the numbers of picture qualities to the makers.
        self._names_quality = "nikon" in device.manufacturer.lower()
        self._quality_before: int | None = None

    def take_control(self) -> None:
        """The standard knows no remote mode; quality raw, where its number is known."""
        about = self._dials.describe(Property.COMPRESSION) if self._names_quality else None
        if about is None or not isinstance(about.current, int) or about.current == RAW:
            return
        if about.is_writable and isinstance(about.allowed, Choices) and RAW in about.allowed.values:
            self._quality_before = about.current
            self._dials.set_number(about, RAW, "picture quality")

    def give_back(self) -> None:
        """The picture quality of before."""
        quality, self._quality_before = self._quality_before, None
        about = None if quality is None else self._dials.describe(Property.COMPRESSION)
        if about is not None and quality is not None:
            with contextlib.suppress(PtpRefusedError, SettingsError):
                self._dials.set_number(about, quality, "picture quality of before")

    def state(self) -> CameraState:
        """What the standard's properties tell."""
        dials = self._dials
        program = dials.number(Property.EXPOSURE_PROGRAM)
        focus = dials.number(Property.FOCUS_MODE)
        quality = dials.number(Property.COMPRESSION)
        is_raw = quality in {RAW, *RAW_AND_JPEG} if self._names_quality else None
        exposure_s = dials.quantity(Property.EXPOSURE_TIME, TENTHS_OF_MILLISECONDS)
        iso = dials.quantity(Property.EXPOSURE_INDEX, ISO)
        aperture = dials.quantity(Property.F_NUMBER, F_NUMBER)
        return CameraState(
            battery_percent=dials.number(Property.BATTERY_LEVEL),
            is_manual_exposure=None if program is None else program == MANUAL_EXPOSURE,
            is_manual_focus=None if focus is None else focus == MANUAL_FOCUS,
            takes_raw=None if quality is None else is_raw,
            unnamed_quality=None if self._names_quality else quality,
            room=stores.room(self._session, self._operations),
            fills_card=True,
            settings=None
            if exposure_s is None
            else CameraSettings(exposure_s, aperture, None if iso is None else round(iso)),
        )

    def apply(self, settings: CameraSettings) -> None:
        """Set exposure time, aperture and ISO and read them back."""
        if Operation.INITIATE_CAPTURE not in self._operations:
            raise PtpRefusedError(Operation.INITIATE_CAPTURE, ResponseCode.OPERATION_NOT_SUPPORTED)
        dials = self._dials
        dials.turn(Property.EXPOSURE_TIME, TENTHS_OF_MILLISECONDS, settings.exposure_s, _LOCKED)
        if settings.aperture is not None:
            dials.turn(Property.F_NUMBER, F_NUMBER, settings.aperture, _LOCKED)
        if settings.iso is not None:
            dials.turn(Property.EXPOSURE_INDEX, ISO, settings.iso, _LOCKED)

    def expose(self, exposure_s: float) -> list[CameraFile]:
        """Release, wait for the events, fetch; without events compare the lists of objects."""
        session = self._session
        before = set(objects.handles(session))
        session.events()
        session.ask(Operation.INITIATE_CAPTURE, 0, 0, timeout_s=exposure_s + ANSWER_S)
        shot = Shot(session.clock, exposure_s, linger_s=LINGER_S)
        while not shot.is_over():
            session.pause(WAIT_S)
            self._take_events(shot, before)
            if not shot.objects and shot.is_late():
                self._look(shot, before)
        return self._fetch(shot.objects)

    def live_view(self) -> Iterator[bytes]:
        """The standard has no live view."""
        raise CameraError("this camera shows no live view over standard PTP; use its own screen")

    def _take_events(self, shot: Shot, before: set[int]) -> None:
        for event in self._session.events():
            if event.code == EventCode.OBJECT_ADDED and event.parameters:
                if event.parameters[0] not in before.union(shot.objects):
                    shot.object_added(event.parameters[0])
            elif event.code == EventCode.CAPTURE_COMPLETE:
                shot.completed()
            elif event.code == EventCode.STORE_FULL:
                shot.store_full()

    def _look(self, shot: Shot, before: set[int]) -> None:
        for handle in objects.handles(self._session):
            if handle not in before:
                shot.object_added(handle)

    def _fetch(self, handles: list[int]) -> list[CameraFile]:
        session = self._session
        pictures = objects.pictures(session, handles)
        files = [objects.download(session, *picture, self._operations) for picture in pictures]
        if not files:
            raise CameraTimeoutError(
                "the camera says that it exposed but has no new picture; has it a card with room?"
            )
        return files
