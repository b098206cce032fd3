"""Live view of Canon EOS: blocks of length, kind and content, one of which is a JPEG."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator

from drivers.errors import CameraTimeoutError
from drivers.ptp.codes import CanonOperation, CanonProperty
from drivers.ptp.cursor import Cursor
from drivers.ptp.errors import PtpError
from drivers.ptp.session import BUSY, PtpSession

OFF, TO_COMPUTER = 0, 2
LARGEST_BYTES = 0x00200000
JPEG_KINDS = frozenset({1, 11})
JPEG_START = b"\xff\xd8\xff"
FRAME_PAUSE_S = 0.02
FRAME_TIMEOUT_S = 5.0


def frames(session: PtpSession) -> Iterator[bytes]:
    """JPEG files until the caller stops; the mirror comes down again then."""
    try:
        _send_to(session, TO_COMPUTER)
        while True:
            yield _frame(session)
    finally:
        if session.is_in_step:
            with contextlib.suppress(PtpError):
                _send_to(session, OFF)


def _send_to(session: PtpSession, output: int) -> None:
    data = struct.pack("<III", 12, CanonProperty.VIEWFINDER_OUTPUT, output)
    session.ask(CanonOperation.SET_DEVICE_PROP_VALUE_EX, data=data)


def _frame(session: PtpSession) -> bytes:
    deadline_s = session.clock.monotonic() + FRAME_TIMEOUT_S
    while session.clock.monotonic() < deadline_s:
        session.ask(CanonOperation.GET_EVENT, accept=BUSY)  # unread events stop the live view
        reply = session.ask(
            CanonOperation.GET_VIEWFINDER_DATA, LARGEST_BYTES, 0, 0, patience_s=0.0, accept=BUSY
        )
        picture = _picture(reply.data)
        if picture:
            return picture
        session.pause(FRAME_PAUSE_S)
    raise CameraTimeoutError(f"no frame of the live view came within {FRAME_TIMEOUT_S:g} s")


def _picture(data: bytes) -> bytes:
    """The JPEG among the blocks; empty when there is none yet."""
    cursor = Cursor(data, "Canon's live view")
    while cursor.left >= 8:
        length, kind = cursor.u32(), cursor.u32()
        content = cursor.take(max(length, 8) - 8)
        if kind in JPEG_KINDS and content[:3] == JPEG_START:
            return bytes(content)
    return b""
