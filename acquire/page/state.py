"""What is known at the bench at one moment; goes from the desk to the page and never back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

from pydantic import TypeAdapter

from acquire.plan import Plan
from drivers.protocols import CameraSettings

MAX_NOTES = 50


class Activity(StrEnum):
    """What the bench is doing."""

    OPENING = "opening"
    AIMING = "aiming"
    RESTING = "resting"  # the devices are let go
    CAPTURING = "capturing"
    PAUSED = "paused"
    ENDED = "ended"


class Source(StrEnum):
    """Where the pictures of the camera come from while aiming."""

    OFF = "off"
    LIVE_VIEW = "live-view"
    EXPOSURES = "exposures"


@dataclass(frozen=True, slots=True)
class Shown:
    """What is on the projector.

    Parameters
    ----------
    what
        A pattern's text, or ``chart`` for the focus chart.
    raster_sha256
        As `drivers.raster.raster_digest`; empty where only the plan says what is shown.
    """

    what: str
    raster_sha256: str = ""


@dataclass(frozen=True, slots=True)
class CameraView:
    """What the camera was asked for while aiming, and what it says it does."""

    source: Source = Source.OFF
    has_live_view: bool = False
    asked: CameraSettings | None = None
    read_back: CameraSettings | None = None


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the capture is.

    Parameters
    ----------
    done, total
        Frames on the disk and in the plan.
    done_before, spent_s
        Frames on the disk when this run had kept its first, and the seconds from that one to the
        last, rests left out.
    """

    done: int
    total: int
    done_before: int = 0
    spent_s: float = 0.0

    @property
    def frame_s(self) -> float | None:
        """Mean time of a frame in this run; None before the second."""
        taken = self.done - self.done_before
        return self.spent_s / taken if taken > 0 else None

    @property
    def left_s(self) -> float | None:
        """Time left at this pace; None while it is not known."""
        return None if self.frame_s is None else self.frame_s * (self.total - self.done)


@dataclass(frozen=True, slots=True)
class Note:
    """Something a person should know."""

    at_s: float
    text: str
    is_error: bool = False


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that changes.

    Parameters
    ----------
    pausing, stopping
        Wishes not yet fulfilled.
    session
        Absolute path of the session folder; for the page's process, never for the browser.
    """

    activity: Activity = Activity.OPENING
    pausing: bool = False
    stopping: bool = False
    session: str | None = None
    shown: Shown | None = None
    camera: CameraView = CameraView()
    progress: Progress | None = None
    notes: tuple[Note, ...] = ()

    def with_note(self, note: Note) -> Snapshot:
        """With one note more, the oldest dropped when there are too many."""
        return replace(self, notes=(*self.notes, note)[-MAX_NOTES:])


@dataclass(frozen=True, slots=True)
class Setting:
    """What never changes while the page is open.

    Parameters
    ----------
    bench
        Its name in messages.
    projector_px
        (height, width).
    frame_bytes
        Size of a frame on the disk.
    plan
        The plan, where there is one.
    can_aim, can_start
        Whether the page may show patterns and live view, and start the plan.
    version
        Of lumisplit.
    geometry
        Absolute path of the geometry profile that the plan names; never for the browser.
    """

    bench: str
    projector_px: tuple[int, int]
    frame_bytes: int
    plan: Plan | None
    can_aim: bool
    can_start: bool
    version: str
    geometry: str | None = None


SNAPSHOT: Final = TypeAdapter(Snapshot)
SETTING: Final = TypeAdapter(Setting)
