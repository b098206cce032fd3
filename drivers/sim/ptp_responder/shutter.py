"""What happens in the simulated body after the shutter button: time, files and events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from drivers.errors import DriverError
from drivers.protocols import Clock
from drivers.ptp.codes import EventCode, NikonEvent, Property, ResponseCode
from drivers.ptp.transaction import Event
from drivers.sim.ptp_responder.answer import RefusalError
from drivers.sim.ptp_responder.body import MANUAL_FOCUS, RAW
from drivers.sim.ptp_responder.misbehaviour import Name
from drivers.sim.ptp_responder.settings import PropertyTable
from drivers.sim.ptp_responder.source import JPEG, Developer, ImageSource
from drivers.sim.ptp_responder.store import Store

WRITING_S = 0.05
MAX_EVENTS = 64  # that the body remembers for a host that does not ask

_IN_SDRAM = NikonEvent.OBJECT_ADDED_IN_SDRAM
_UNKNOWN_EVENT = Event(0xC1FF, (0,))


@dataclass(frozen=True, slots=True)
class Order:
    """How a shot was asked for.

    Parameters
    ----------
    with_autofocus
        Focus first.
    to_sdram
        Where the files go.
    is_pushed
        Whether the events are sent by themselves; else they wait in Nikon's list.
    fault
        What goes wrong with its events.
    """

    with_autofocus: bool = False
    to_sdram: bool = False
    is_pushed: bool = False
    fault: Name | None = None


@dataclass(frozen=True, slots=True)
class _Shot:
    """An exposure under way."""

    order: Order
    ends_s: float
    files: tuple[tuple[bytes, str], ...]
    is_first: bool = True


class Shutter:
    """Exposures one at a time, and the events that tell of them.

    Parameters
    ----------
    properties, store, source, developer, clock
        The rest of the body.
    autofocus_finds
        Whether there is anything for the autofocus to hold on to.
    """

    def __init__(
        self,
        properties: PropertyTable,
        store: Store,
        source: ImageSource,
        developer: Developer,
        clock: Clock,
        autofocus_finds: bool,
    ) -> None:
        self._properties = properties
        self._store = store
        self._source = source
        self._developer = developer
        self._clock = clock
        self._autofocus_finds = autofocus_finds
        self._shot: _Shot | None = None
        self.listed: list[Event] = []
        self.pushed: list[Event] = []

    @property
    def is_busy(self) -> bool:
        """Whether an exposure is under way or its first file not yet written."""
        return self._shot is not None and self._shot.is_first

    def focus(self) -> None:
        """Drive the autofocus."""
        if self._properties.number(Property.FOCUS_MODE) == MANUAL_FOCUS:
            return
        if not self._autofocus_finds:
            raise RefusalError(ResponseCode.NIKON_OUT_OF_FOCUS)

    def release(self, order: Order) -> None:
        """Begin an exposure."""
        self._check(order)
        if order.with_autofocus:
            self.focus()
        settings = self._properties.camera_settings()
        try:
            data, media_type = self._source(settings)
        except DriverError:
            raise RefusalError(ResponseCode.GENERAL_ERROR) from None
        files = self._files(data, media_type)
        if order.fault is Name.JPEG_FIRST:
            files = files[::-1]
        ends_s = self._clock.now() + settings.exposure_s + WRITING_S
        self._shot = _Shot(order, ends_s, files)

    def advance(self) -> None:
        """Let happen what is due by now."""
        shot = self._shot
        if shot is None or self._clock.now() < shot.ends_s:
            return
        if not shot.is_first and any(e.code == _IN_SDRAM for e in self.listed):
            return
        order = shot.order
        # Nikon's bodies tell of a pair in their memory one file after the other: gphoto2, which
        # takes the last object only of a list that tells of two, is seen to fetch both from them
        # (pibooth issue 53 on GitHub).
        written = 1 if order.to_sdram else len(shot.files)
        now, later = shot.files[:written], shot.files[written:]
        self._shot = _Shot(order, shot.ends_s + WRITING_S, later, is_first=False) if later else None
        taken_at = datetime.fromtimestamp(shot.ends_s, UTC).strftime("%Y%m%dT%H%M%S")
        added = _IN_SDRAM if order.to_sdram else EventCode.OBJECT_ADDED
        objects = [
            Event(added, (self._store.add(data, kind, taken_at, order.to_sdram),))
            for data, kind in now
        ]
        self.tell(_events(objects, order, is_first=shot.is_first), order.is_pushed)

    def tell(self, events: list[Event], is_pushed: bool) -> None:
        """Send events or keep them for the host to ask; the oldest are forgotten."""
        kept = self.pushed if is_pushed else self.listed
        kept += events
        del kept[:-MAX_EVENTS]

    def forget(self) -> None:
        """The host is gone: an exposure under way ends, nobody hears of it."""
        self._shot = None
        self.listed.clear()
        self.pushed.clear()

    def _check(self, order: Order) -> None:
        if self._shot is not None or self._store.holds_sdram_image:
            raise RefusalError(ResponseCode.DEVICE_BUSY)
        if self._properties.is_bulb:
            raise RefusalError(ResponseCode.NIKON_SHUTTER_SPEED_BULB)
        if not order.to_sdram:
            if not self._store.has_card:
                raise RefusalError(ResponseCode.STORE_NOT_AVAILABLE)
            if not self._store.free_images:
                raise RefusalError(ResponseCode.STORE_FULL)

    def _files(self, data: bytes, media_type: str) -> tuple[tuple[bytes, str], ...]:
        """What the quality setting makes of an exposure: 4 raw, above it a pair, below a JPEG."""
        quality = self._properties.number(Property.COMPRESSION)
        raw = (data, media_type)
        if quality == RAW:
            return (raw,)
        jpeg = (self._developer.jpeg(data, media_type), JPEG)
        return (raw, jpeg) if quality > RAW else (jpeg,)


def _events(objects: list[Event], order: Order, *, is_first: bool) -> list[Event]:
    """What the host is told of a shot, with what goes wrong about it; it is complete but once."""
    completion = [
        Event(NikonEvent.CAPTURE_COMPLETE_REC_IN_SDRAM, (0,))
        if order.to_sdram
        else Event(EventCode.CAPTURE_COMPLETE, (0,))
    ] * is_first
    tell: dict[Name, Callable[[], list[Event]]] = {
        Name.LOST_EVENTS: list,
        Name.LOST_OBJECT_EVENT: lambda: completion,
        Name.LOST_COMPLETION: lambda: objects,
        Name.COMPLETION_FIRST: lambda: completion + objects,
        Name.ZERO_HANDLE: lambda: [Event(e.code, (0,)) for e in objects] + completion,
        Name.ODD_EVENT: lambda: [_UNKNOWN_EVENT, *objects, _UNKNOWN_EVENT, *completion],
    }
    usual = objects + completion
    return usual if order.fault is None else tell.get(order.fault, lambda: usual)()
