"""A PTP camera as the rest of the program sees it (see `drivers.protocols.Camera`)."""

from __future__ import annotations

import atexit
import contextlib
from collections.abc import Callable, Generator, Iterator
from types import TracebackType
from typing import Self

from drivers.clock import SystemClock
from drivers.errors import CameraError, CameraTimeoutError, DecodeError
from drivers.media import media_type
from drivers.protocols import CameraSettings, Clock, RawFrame
from drivers.ptp import objects
from drivers.ptp.body import Body, CameraState, explained
from drivers.ptp.canon import CanonBody
from drivers.ptp.codes import CanonOperation, NikonOperation, Operation
from drivers.ptp.datasets import DeviceInfo, ObjectInfo
from drivers.ptp.errors import (
    PtpDisconnectedError,
    PtpProtocolError,
    PtpRefusedError,
    PtpTransportError,
)
from drivers.ptp.generic import GenericBody
from drivers.ptp.link import Link
from drivers.ptp.nikon import NikonBody
from drivers.ptp.objects import CameraFile
from drivers.ptp.session import PtpSession

REOPEN_PAUSE_S = 0.5
REOPEN_WITHIN_S = 6.0


class PtpCamera:
    """A camera over any link; opened at once, and given back on every way out.

    Parameters
    ----------
    connect
        Makes the way to the camera; called again, once, when the camera was gone.
    clock
        The bench's.

    Raises
    ------
    drivers.errors.CameraError
        The camera cannot be opened; the message says what to do.
    """

    def __init__(self, connect: Callable[[], Link], clock: Clock | None = None) -> None:
        self._connect = connect
        self._clock = SystemClock() if clock is None else clock
        self._is_open = True
        self._is_gone = False
        self._open()
        atexit.register(self.close)

    @property
    def device(self) -> DeviceInfo:
        """Maker, model, version, serial number and abilities."""
        return self._device

    @property
    def body(self) -> str:
        """Maker, model and serial number: what tells this camera from every other."""
        device = self._device
        return " ".join(f"{device.manufacturer} {device.model} {device.serial}".split())

    def state(self) -> CameraState:
        """Battery, dials and settings as they are now."""
        with self._ready() as body:
            return body.state()

    def capture(self, settings: CameraSettings) -> RawFrame:
        """Expose once and deliver the file, the raw one of a pair.

        After a time-out or a broken transfer the camera is ready for another try. A camera that
        is gone is looked for once.
        """
        try:
            return self._shoot(settings)
        except PtpDisconnectedError:
            self._reopen()
            return self._shoot(settings)

    def live_view(self, settings: CameraSettings | None = None) -> Generator[bytes]:
        """JPEG files, one a frame; close the generator to end the live view."""
        with self._ready() as body:
            if settings is not None:
                body.apply(settings)
            yield from body.live_view()

    def read_back(self) -> CameraSettings | None:
        """The settings as the camera has them now."""
        return self.state().settings

    def pictures(self) -> list[tuple[int, ObjectInfo]]:
        """Handle and description of everything on the card but folders."""
        with self._ready():
            return objects.pictures(self._session, objects.handles(self._session))

    def fetch(self, handle: int) -> CameraFile:
        """One of the `pictures`, whole; it stays on the card."""
        with self._ready():
            about = objects.info(self._session, handle)
            return objects.download(self._session, handle, about, self._device.operations)

    def close(self) -> None:
        """Give control back; may be called more than once."""
        if not self._is_open:
            return
        self._is_open = False
        atexit.unregister(self.close)
        if not self._is_gone:
            self._give_back()
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _shoot(self, settings: CameraSettings) -> RawFrame:
        with self._ready() as body:
            body.apply(settings)
            started_s = self._clock.now()
            file = body.expose(settings.exposure_s)[0]
            finished_s = self._clock.now()
            return RawFrame(file.data, _kind(file.data), settings, started_s, finished_s)

    def _open(self) -> None:
        with contextlib.ExitStack() as on_failure:
            self._session = session = PtpSession(self._connect(), self._clock)
            on_failure.callback(session.close)
            session.open()
            try:
                self._device = DeviceInfo.decode(session.ask(Operation.GET_DEVICE_INFO).data)
                self._body = _body(session, self._device)
                on_failure.callback(self._give_back)
                self._body.take_control()
            except PtpRefusedError as error:
                raise explained(error) from error
            on_failure.pop_all()

    def _reopen(self) -> None:
        """Look once more for a camera that was gone, for as long as plugging it in takes."""
        self._session.close()
        self._is_gone = True
        before = self.body
        deadline_s = self._clock.monotonic() + REOPEN_WITHIN_S
        while self._is_gone:
            self._clock.sleep(REOPEN_PAUSE_S)
            try:
                self._open()
            except CameraError as error:
                if self._clock.monotonic() >= deadline_s:
                    raise CameraError(
                        f"the camera is gone and did not come back ({error}); every frame before "
                        "this one is safe: make the camera ready and start the capture again"
                    ) from error
            else:
                self._is_gone = False
        if self.body != before:
            raise CameraError(
                f"the camera was gone, and another one is in its place: it was {before}, this is "
                f"{self.body}; put the first one back and start the capture again"
            )

    def _give_back(self) -> None:
        with contextlib.suppress(CameraError):
            if not self._session.is_in_step:
                self._session.recover()
                self._session.open()
            self._body.give_back()

    def _back_in_step(self) -> None:
        """After a transaction that did not end: reset, open the session, take control again."""
        if not self._session.is_in_step:
            self._session.recover()
            self._session.open()
            self._body.take_control()

    @contextlib.contextmanager
    def _ready(self) -> Iterator[Body]:
        """The body, with its link in step; says a broken transfer as worth another try."""
        if not self._is_open:
            raise CameraError("the camera is closed; open it again")
        try:
            if self._is_gone:
                self._reopen()
            self._back_in_step()
            yield self._body
        except PtpRefusedError as error:
            raise explained(error) from error
        except (PtpDisconnectedError, CameraTimeoutError):
            raise
        except (PtpTransportError, PtpProtocolError) as error:
            raise CameraTimeoutError(f"no picture came: {error}") from error


def _kind(data: bytes) -> str:
    try:
        return media_type(data)
    except DecodeError as error:
        raise PtpProtocolError(
            f"the camera delivered a file that is damaged or no picture ({error})"
        ) from error


def _body(session: PtpSession, device: DeviceInfo) -> Body:
    """The strategy for a make, told by what the camera can do: names and numbers lie."""
    maker = device.manufacturer.lower()
    if "nikon" in maker and NikonOperation.GET_EVENT in device.operations:
        return NikonBody(session, device)
    if "canon" in maker and CanonOperation.REMOTE_RELEASE_ON in device.operations:
        return CanonBody(session)
    return GenericBody(session, device)
