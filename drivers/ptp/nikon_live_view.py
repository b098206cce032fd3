"""Live view of Nikon's bodies: a header and a JPEG a frame."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from drivers.errors import CameraError, CameraTimeoutError
from drivers.ptp.codes import NikonOperation, ResponseCode
from drivers.ptp.errors import PtpError
from drivers.ptp.session import BUSY, PtpSession

JPEG_START = b"\xff\xd8\xff"
FRAME_PAUSE_S = 0.01
# From the mirror going up to the first frame.
FRAME_TIMEOUT_S = 5.0
NEARER, FARTHER = 1, 2
_PROHIBITIONS = {
    8: "the battery is too low: charge it or use mains power",
    12: "a picture in the camera's memory was never fetched: switch the camera off and on",
    14: "there is no card in it: put one in",
    22: "the mirror is up: turn the release dial from MUP to S",
    31: "the mode dial is not on P, S, A or M: turn it to M",
}


def frames(session: PtpSession, prohibition: int) -> Iterator[bytes]:
    """JPEG files until the caller stops; the mirror comes down again then.

    Parameters
    ----------
    session
        With the camera.
    prohibition
        Value of the property LiveViewProhibition: one bit for each reason not to.
    """
    if prohibition:
        reasons = [text for bit, text in _PROHIBITIONS.items() if prohibition >> bit & 1]
        raise CameraError(
            f"the camera allows no live view now (0x{prohibition:X}): "
            + ("; ".join(reasons) or "close its menus and look at its display")
        )
    try:
        _start(session)
        _frame(session)  # the first is from before the lens had stopped down
        while True:
            yield _frame(session)
    finally:
        if session.is_in_step:
            with contextlib.suppress(PtpError):
                session.ask(NikonOperation.END_LIVE_VIEW)


def drive_focus(session: PtpSession, steps: int) -> None:
    """Turn the focus motor by `steps`, positive towards infinity, and wait until it stands."""
    if not 1 <= abs(steps) <= 0x7FFF:
        raise ValueError(f"steps must be -32767 to 32767 and not 0, not {steps}")
    direction = FARTHER if steps > 0 else NEARER
    session.ask(NikonOperation.MANUAL_FOCUS_DRIVE, direction, abs(steps))
    session.ask(NikonOperation.DEVICE_READY)


def _start(session: PtpSession) -> None:
    session.ask(NikonOperation.START_LIVE_VIEW)
    session.ask(NikonOperation.DEVICE_READY)


def _frame(session: PtpSession) -> bytes:
    """The next frame; a live view that the camera has ended itself is started again."""
    not_on = ResponseCode.NIKON_NOT_LIVE_VIEW
    deadline_s = session.clock.monotonic() + FRAME_TIMEOUT_S
    while session.clock.monotonic() < deadline_s:
        reply = session.ask(
            NikonOperation.GET_LIVE_VIEW_IMAGE, patience_s=0.0, accept=(not_on, *BUSY)
        )
        start = reply.data.find(JPEG_START)
        if reply.code == ResponseCode.OK and start >= 0:
            return reply.data[start:]
        if reply.code == not_on:
            _start(session)
        session.pause(FRAME_PAUSE_S)
    raise CameraTimeoutError(f"no frame of the live view came within {FRAME_TIMEOUT_S:g} s")
