"""What differs between makes of camera: the strategy that a `PtpCamera` works with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Protocol

from drivers.protocols import CameraSettings
from drivers.ptp.codes import ResponseCode
from drivers.ptp.errors import PtpRefusedError
from drivers.ptp.objects import CameraFile
from drivers.ptp.stores import Room

# From the end of the exposure; noise reduction alone takes as long again as a long exposure.
GIVE_UP_S = 70.0


@dataclass(frozen=True, slots=True)
class CameraState:
    """What a camera tells of itself; None where it does not tell.

    Parameters
    ----------
    battery_percent
        0 to 100.
    is_manual_exposure
        Whether the mode dial is on M.
    is_manual_focus
        Whether lens and body focus by hand.
    takes_raw
        Whether the picture quality has a raw file in it.
    unnamed_quality
        The picture quality of a camera whose numbers for it are not known.
    room
        What its cards still take.
    fills_card
        Whether every exposure stays on a card.
    settings
        The exposure as it is set now.
    """

    battery_percent: int | None = None
    is_manual_exposure: bool | None = None
    is_manual_focus: bool | None = None
    takes_raw: bool | None = None
    unnamed_quality: int | None = None
    room: Room | None = None
    fills_card: bool = False
    settings: CameraSettings | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should change before measuring."""
        found = []
        if self.is_manual_exposure is False:
            found.append("the mode dial is not on M: turn it to M, or the camera will choose")
        if self.is_manual_focus is False:
            found.append("autofocus is on: switch lens and body to M, so that nothing moves")
        if self.takes_raw is False:
            found.append("the picture quality is JPEG: set it to RAW")
        if self.unnamed_quality is not None:
            found.append(
                f"its picture quality is number {self.unnamed_quality}, which only its maker can "
                "name: set it to RAW at the camera, without JPEG"
            )
        if self.room is not None and self.room.is_full:
            found.append("the card is full: put in an empty one or delete pictures")
        if self.battery_percent is not None and self.battery_percent < 20:
            found.append(f"the battery is at {self.battery_percent} %: charge or use mains power")
        return tuple(found)

    def shortage(self, frames: int) -> tuple[str, ...]:
        """What a person should know of the card before so many exposures."""
        images = None if self.room is None else self.room.images
        if not self.fills_card or not images or images >= frames:
            return ()
        return (
            f"the card takes {images} more pictures and {frames} are to come: put in an empty one "
            "or delete pictures, or the capture stops when it is full",
        )


class Body(Protocol):
    """One make of camera; all methods raise `drivers.errors.CameraError` or a kind of it."""

    def take_control(self) -> None:
        """Make the camera ready for exposures by this program."""

    def give_back(self) -> None:
        """Undo `take_control`; what the camera refuses now does no harm."""

    def state(self) -> CameraState:
        """What the camera tells of itself."""

    def apply(self, settings: CameraSettings) -> None:
        """Set and read back; `SettingsError` when the camera cannot or does not do as asked."""

    def expose(self, exposure_s: float) -> list[CameraFile]:
        """Expose once, without autofocus; the files, the one to measure with first."""

    def live_view(self) -> Iterator[bytes]:
        """JPEG files, one a frame, for as long as they are asked for."""


_ADVICE: Final[dict[int, str]] = {
    ResponseCode.OPERATION_NOT_SUPPORTED: (
        "this device takes no pictures for a computer; check the camera's USB mode (PTP, not mass "
        "storage), or let a trigger box release it and pick the files up from a watched folder"
    ),
    ResponseCode.STORE_FULL: "the card is full: put in an empty one or delete pictures",
    ResponseCode.STORE_NOT_AVAILABLE: "there is no card: put one in",
    ResponseCode.STORE_READ_ONLY: "the card is write-protected: move its lock",
    ResponseCode.ACCESS_DENIED: "the camera is locked: close its menus and half-press the shutter",
    ResponseCode.DEVICE_BUSY: (
        "the camera stays busy, as with a picture that nobody fetched: switch it off and on"
    ),
    ResponseCode.NIKON_OUT_OF_FOCUS: (
        "autofocus found nothing to hold on to on the wall: switch lens and body to M"
    ),
    ResponseCode.NIKON_SHUTTER_SPEED_BULB: (
        "the shutter is on bulb: turn the mode dial to M and choose a time"
    ),
    ResponseCode.NIKON_MIRROR_UP_SEQUENCE: (
        "the mirror is up: turn the release dial from MUP to S and press the shutter once"
    ),
}


def explained(error: PtpRefusedError) -> PtpRefusedError:
    """The same refusal with what to do about it."""
    return PtpRefusedError(error.operation, error.code, _ADVICE.get(error.code, ""))
