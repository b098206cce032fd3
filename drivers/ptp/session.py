"""A session with a camera: operations asked one after another, events gathered on the side."""

from __future__ import annotations

import contextlib
import io
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from drivers.errors import CameraError
from drivers.protocols import Clock
from drivers.ptp.codes import CanonOperation, NikonOperation, Operation, ResponseCode
from drivers.ptp.errors import (
    PtpDisconnectedError,
    PtpError,
    PtpProtocolError,
    PtpRefusedError,
    PtpStalledError,
    PtpTransportError,
)
from drivers.ptp.link import Link
from drivers.ptp.transaction import (
    DataChunk,
    DataEnded,
    DataStarted,
    Event,
    NeedData,
    Request,
    Response,
)

ANSWER_TIMEOUT_S = 5.0
CLOSE_TIMEOUT_S = 2.0
# Cameras are busy for as long as they write a picture to a card.
PATIENCE_S = 10.0
BUSY_PAUSE_S = 0.1
OPEN_TRIES = 3
SESSION_ID = 1
MAX_EVENTS = 1024
# Of things that are no data, within one transaction: more is a device that babbles.
MAX_HAPPENINGS = 10_000
# No vendor gives another meaning to these numbers.
BUSY: Final = frozenset(
    {
        ResponseCode.DEVICE_BUSY,
        ResponseCode.NIKON_INVALID_STATUS,
        ResponseCode.NIKON_BULB_RELEASE_BUSY,
        ResponseCode.NIKON_WAITING_SECOND_RELEASE,
        ResponseCode.CANON_NOT_READY,
        ResponseCode.CANON_MEMORY_NOT_READY,
    }
)
RELEASES: Final = frozenset(
    {
        Operation.INITIATE_CAPTURE,
        NikonOperation.CAPTURE,
        NikonOperation.AF_AND_CAPTURE_IN_SDRAM,
        NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA,
        CanonOperation.REMOTE_RELEASE_ON,
    }
)


@dataclass(frozen=True, slots=True)
class Reply:
    """How the camera answered an operation.

    Parameters
    ----------
    code, parameters
        The response.
    data
        What came before it; empty where the data went elsewhere.
    size
        Bytes of data that came.
    is_whole
        Whether as many came as were announced.
    """

    code: int
    parameters: tuple[int, ...]
    data: bytes
    size: int
    is_whole: bool


class PtpSession:
    """A session over any link.

    Parameters
    ----------
    link
        The way to the camera.
    clock
        Tells how long a busy camera has kept us waiting.
    """

    def __init__(self, link: Link, clock: Clock) -> None:
        self.clock = clock
        self._link = link
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._in_step = True

    @property
    def is_in_step(self) -> bool:
        """False after a transaction that did not end: `recover` and `open` before the next."""
        return self._in_step

    def open(self) -> None:
        """Open the session, whatever state a killed program left the camera in."""
        failure: PtpError | None = None
        for _ in range(OPEN_TRIES):
            try:
                if not self._in_step:
                    self.recover()
                self._open_once()
            except PtpDisconnectedError:
                raise
            except (PtpTransportError, PtpProtocolError) as error:
                failure, self._in_step = error, False
            else:
                return
        raise CameraError(
            f"the camera opens no session in {OPEN_TRIES} tries ({failure}); "
            "switch it off and on, or take its battery out for a moment"
        ) from failure

    def close(self) -> None:
        """End the session and let the link go; never raises."""
        with contextlib.suppress(PtpError):
            self._transact(Request(Operation.CLOSE_SESSION), CLOSE_TIMEOUT_S, None)
        self._link.close()

    def recover(self) -> None:
        """Get the link back in step; the camera may have closed the session by that."""
        self._link.recover()
        self._events.clear()
        self._in_step = True

    def ask(
        self,
        code: int,
        *parameters: int,
        data: bytes | None = None,
        into: memoryview | None = None,
        timeout_s: float = ANSWER_TIMEOUT_S,
        patience_s: float = PATIENCE_S,
        accept: Collection[int] = (),
    ) -> Reply:
        """Carry out one operation.

        Parameters
        ----------
        code, parameters, data
            The operation and what goes with it.
        into
            Where the camera's data go; None: into the reply.
        timeout_s
            Longest silence of the camera.
        patience_s
            For how long a busy camera is asked again.
        accept
            Answers other than OK that are none the worse; `PtpRefusedError` on all others.
        """
        deadline_s = self.clock.monotonic() + patience_s
        while True:
            reply = self._transact_again(Request(code, parameters, data), timeout_s, into)
            if reply.code == ResponseCode.OK or reply.code in accept:
                return reply
            if reply.code not in BUSY or self.clock.monotonic() >= deadline_s:
                raise PtpRefusedError(code, reply.code)
            self.pause(BUSY_PAUSE_S)

    def pause(self, duration_s: float) -> None:
        """Let time go by, listening for events; may return early when one came."""
        self._link.poll_events(duration_s)
        for _ in range(MAX_HAPPENINGS):
            happening = self._link.take()
            if isinstance(happening, NeedData):
                return
            if isinstance(happening, Event):
                self._events.append(happening)

    def events(self) -> list[Event]:
        """Events that came since this was last asked."""
        events = list(self._events)
        self._events.clear()
        return events

    def _open_once(self) -> None:
        already = (ResponseCode.SESSION_ALREADY_OPEN,)
        reply = self.ask(Operation.OPEN_SESSION, SESSION_ID, accept=already)
        if reply.code == ResponseCode.SESSION_ALREADY_OPEN:
            self._transact(Request(Operation.CLOSE_SESSION), ANSWER_TIMEOUT_S, None)
            self.ask(Operation.OPEN_SESSION, SESSION_ID, accept=already)

    def _transact_again(self, request: Request, timeout_s: float, into: memoryview | None) -> Reply:
        """A transaction that the device dropped is begun once more, unless it takes a picture."""
        try:
            return self._transact(request, timeout_s, into)
        except PtpStalledError:
            if request.code in RELEASES:
                raise
            return self._transact(request, timeout_s, into)

    def _transact(self, request: Request, timeout_s: float, into: memoryview | None) -> Reply:
        """One transaction; data that have no place of their own are gathered.

        A `BytesIO` gives its content away without copying, so one copy of it exists.
        """
        self._in_step = False
        self._link.send(request, into)
        gathered = io.BytesIO()
        size, is_whole, others = 0, True, 0
        while others < MAX_HAPPENINGS:
            happening = self._link.receive(timeout_s)
            if isinstance(happening, DataChunk):
                gathered.write(happening.data)
                continue
            others += 1
            match happening:
                case DataStarted(total) if total and into is None:
                    gathered = io.BytesIO(bytes(total))
                case DataEnded(size, is_whole):
                    gathered.truncate()
                case Event():
                    self._events.append(happening)
                case Response(code, parameters):
                    self._in_step = True
                    return Reply(code, parameters, gathered.getvalue(), size, is_whole)
        raise PtpProtocolError("the camera sends everything but an answer; switch it off and on")
