"""The simulated body as a whole: its properties, memories, shutter and live view."""

from __future__ import annotations

from drivers.protocols import Clock
from drivers.ptp.codes import NikonProperty, Property, ResponseCode
from drivers.sim.ptp_responder.answer import RefusalError
from drivers.sim.ptp_responder.body import Body
from drivers.sim.ptp_responder.misbehaviour import Name
from drivers.sim.ptp_responder.settings import PropertyTable
from drivers.sim.ptp_responder.shutter import Shutter
from drivers.sim.ptp_responder.source import Developer, ImageSource
from drivers.sim.ptp_responder.store import Store

MIRROR_S = 0.2  # until live view delivers
EMPTY_PERCENT = 10

_BATTERY, _SDRAM_IMAGE, _NO_CARD, _NOT_PASM = 8, 12, 14, 31  # bits of the prohibition
_PASM = range(1, 5)


class SimulatedBody:
    """A camera body without a transport.

    Parameters
    ----------
    model
        Which body.
    source
        Its pictures.
    developer
        What makes JPEGs of them.
    clock
        Its time.
    max_images
        That its card holds; 0 for no card.
    autofocus_finds
        Whether there is anything for the autofocus to hold on to.

    Attributes
    ----------
    session
        Number of the open session; 0 for none.
    is_remote
        Whether a computer has taken control.
    event_fault
        What goes wrong with the events of the shot that is asked for now.
    """

    def __init__(
        self,
        model: Body,
        source: ImageSource,
        developer: Developer,
        clock: Clock,
        max_images: int,
        autofocus_finds: bool,
    ) -> None:
        self.model = model
        self.properties = PropertyTable(model)
        self.store = Store(max_images)
        self.shutter = Shutter(
            self.properties, self.store, source, developer, clock, autofocus_finds
        )
        self.session = 0
        self.is_remote = False
        self.event_fault: Name | None = None
        self.developer = developer
        self._source = source
        self._clock = clock
        self._live_from_s: float | None = None

    @property
    def is_busy(self) -> bool:
        """Whether the body is exposing or moving its mirror."""
        moving = self._live_from_s is not None and self._clock.now() < self._live_from_s
        return self.shutter.is_busy or moving

    def advance(self) -> None:
        """Let happen what is due by now."""
        self.shutter.advance()
        if NikonProperty.LIVE_VIEW_PROHIBITION in self.model.descriptions:
            self.properties.turn(NikonProperty.LIVE_VIEW_PROHIBITION, self._prohibition())

    def start_live_view(self) -> None:
        """Raise the mirror."""
        if self._prohibition():
            raise RefusalError(ResponseCode.NIKON_INVALID_STATUS)
        if self._live_from_s is None:
            self._live_from_s = self._clock.now() + MIRROR_S
            self.properties.turn(NikonProperty.LIVE_VIEW_STATUS, 1)

    def end_live_view(self) -> None:
        """Lower the mirror."""
        if self._live_from_s is not None:
            self._live_from_s = None
            self.properties.turn(NikonProperty.LIVE_VIEW_STATUS, 0)

    @property
    def is_live(self) -> bool:
        """Whether live view is on."""
        return self._live_from_s is not None

    def live_image(self) -> bytes:
        """A JPEG of what the sensor sees now."""
        if self._live_from_s is None:
            raise RefusalError(ResponseCode.NIKON_NOT_LIVE_VIEW)
        if self.is_busy:
            raise RefusalError(ResponseCode.DEVICE_BUSY)
        return self.developer.jpeg(*self._source(self.properties.camera_settings()))

    def leave(self) -> None:
        """The host has closed its session or is gone."""
        self.session = 0
        self.is_remote = False
        self.end_live_view()
        self.shutter.forget()
        self.store.empty_sdram()

    def _prohibition(self) -> int:
        """Bits of what stands against live view."""
        reasons = {
            _BATTERY: self.properties.number(Property.BATTERY_LEVEL) <= EMPTY_PERCENT,
            _SDRAM_IMAGE: self.store.holds_sdram_image,
            _NO_CARD: not self.store.has_card
            and not self.properties.number(NikonProperty.RECORDING_MEDIA),
            _NOT_PASM: self.properties.number(Property.EXPOSURE_PROGRAM) not in _PASM,
        }
        return sum(1 << bit for bit, holds in reasons.items() if holds)
