"""The bench while nobody captures: patterns on the projector, pictures of the camera."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import replace

from acquire.errors import BenchError, LumisplitError
from acquire.page.chart import shown_raster
from acquire.page.commands import BenchCommand, Expose, Look, Show
from acquire.page.desk import Desk
from acquire.page.state import Activity, CameraView, Shown, Snapshot, Source
from acquire.plan import ProjectorPlan
from drivers.errors import CameraError, DriverError
from drivers.media import media_type
from drivers.protocols import CameraSettings, Devices, LiveCamera
from drivers.raster import raster_digest

PICTURE_EVERY_S = 0.1
CHECK_EVERY_S = 1.0


def first_view(devices: Devices, settings: CameraSettings) -> CameraView:
    """Live view where the camera has it."""
    has_live_view = isinstance(devices.camera, LiveCamera)
    source = Source.LIVE_VIEW if has_live_view else Source.OFF
    return CameraView(source, has_live_view, settings)


class Aiming:
    """Obeys the page with open devices, all from one thread.

    Parameters
    ----------
    devices
        Closed by the caller.
    desk
        Told of everything.
    view
        What the camera does to begin with.
    projector
        As the plan has it: with its response.
    goes_on
        Asked again and again; when it says no, aiming is over.
    """

    def __init__(
        self,
        devices: Devices,
        desk: Desk,
        view: CameraView,
        projector: ProjectorPlan,
        goes_on: Callable[[], bool],
    ) -> None:
        self._devices, self._desk, self._goes_on = devices, desk, goes_on
        self._projector = projector
        self.commands: queue.Queue[BenchCommand] = queue.Queue(maxsize=32)
        self.view = view
        self._live: Generator[bytes] | None = None

    def run(self) -> None:
        """Obey until aiming is over."""
        self._tell(lambda snapshot: replace(snapshot, activity=Activity.AIMING, camera=self.view))
        self._try(lambda: self._show("black"))
        due_s = checked_s = time.monotonic()
        try:
            while self._goes_on():
                with suppress(queue.Empty):
                    self._obey(self.commands.get(timeout=max(due_s - time.monotonic(), 0.001)))
                now_s = time.monotonic()
                if now_s - checked_s > CHECK_EVERY_S:
                    checked_s = now_s
                    self._devices.projector.check()
                if now_s >= due_s:
                    due_s = now_s + PICTURE_EVERY_S
                    self._take()
        finally:
            self._end_live()

    def _obey(self, command: BenchCommand) -> None:
        match command:
            case Show(what=what):
                self._try(lambda: self._show(what))
            case Look(source=source):
                self._end_live()
                self._see(replace(self.view, source=source))
            case Expose(settings=settings):
                self._end_live()
                self._see(replace(self.view, asked=settings, read_back=None))

    def _show(self, what: str) -> None:
        projector = self._devices.projector
        try:
            raster = shown_raster(what, projector.resolution, self._projector)
        except ValueError as error:
            raise BenchError(f"{error}.") from error
        projector.show(raster)
        shown = Shown(what, raster_digest(raster))
        self._tell(lambda snapshot: replace(snapshot, shown=shown))

    def _take(self) -> None:
        """One picture; a camera that fails is not asked again until somebody wants it."""
        view = self.view
        try:
            if view.source is Source.LIVE_VIEW:
                self._take_live()
            elif view.source is Source.EXPOSURES and view.asked is not None:
                frame = self._devices.camera.capture(view.asked)
                self._desk.picture(frame.media_type, frame.data)
                self._see(replace(view, read_back=frame.settings))
        except CameraError as error:
            self._end_live()
            self._desk.note(f"The camera delivers no pictures: {error}", is_error=True)
            self._see(replace(self.view, source=Source.OFF))
        except DriverError as error:
            self._desk.note(str(error), is_error=True)
            self._see(replace(self.view, source=Source.OFF))

    def _take_live(self) -> None:
        camera = self._devices.camera
        if not isinstance(camera, LiveCamera):
            raise CameraError("it has no live view; take exposures instead.")
        if self._live is None:
            self._live = camera.live_view(self.view.asked)
            data = next(self._live)
            self._see(replace(self.view, read_back=camera.read_back()))
        else:
            data = next(self._live)
        self._desk.picture(media_type(data), data)

    def _end_live(self) -> None:
        if self._live is not None:
            self._live.close()
            self._live = None

    def _see(self, view: CameraView) -> None:
        if view != self.view:
            self.view = view
            self._tell(lambda snapshot: replace(snapshot, camera=view))

    def _try(self, act: Callable[[], None]) -> None:
        """What was asked for cannot be done: that ends nothing."""
        try:
            act()
        except LumisplitError as error:
            self._desk.note(str(error), is_error=True)

    def _tell(self, alter: Callable[[Snapshot], Snapshot]) -> None:
        self._desk.change(alter)
