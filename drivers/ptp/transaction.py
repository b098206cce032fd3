"""The initiator's side of PTP transactions without any I/O: bytes in, events out.

One object is one conversation with a camera: `usb_initiator.UsbInitiator` reads the containers of
the bulk-in and the interrupt endpoint, `ip_initiator.IpInitiator` the packets of the command and
the event connection. Both tell what they read in the same events. The loop around them is always

    for block in initiator.send(Request(...)):   # each block is one bulk transfer
        transport.write(block)
    while not isinstance(event := initiator.next_event(), Response):
        if isinstance(event, NeedData):
            initiator.receive_data(transport.read(), ended=...)

Large objects go to a place of the caller's: `send(request, into=buffer)`. While `writable` offers
a piece of it the transport reads straight into that and tells `wrote`, so that nothing is copied.

What belongs to the transaction under way is a table of (state, what arrived) → step in each of
the two; what is not in it ends the conversation with `PtpProtocolError` until `reset`. What belongs
to another transaction is dropped and told as `Stray`.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum, auto
from typing import NoReturn, TypeAlias

from drivers.ptp.codes import Operation
from drivers.ptp.errors import PtpProtocolError
from drivers.ptp.wire import MAX_DATA_BYTES, Bytes

MAX_TRANSACTION = 0xFFFFFFFE  # 0xFFFFFFFF means "any" (ISO 15740, 9.3.1)


@dataclass(frozen=True, slots=True)
class Request:
    """An operation to be sent.

    Parameters
    ----------
    code
        Of the operation.
    parameters
        Up to five numbers of 32 bits.
    data
        What goes to the camera after it; None when the operation sends nothing.
    """

    code: int
    parameters: tuple[int, ...] = ()
    data: Bytes | None = None


@dataclass(frozen=True, slots=True)
class DataStarted:
    """The camera begins to send data: `total` bytes, or None when it does not say how many."""

    total: int | None


@dataclass(frozen=True, slots=True)
class DataChunk:
    """Some of the data; a view of what was received, good until the next bytes are received."""

    data: memoryview


@dataclass(frozen=True, slots=True)
class DataEnded:
    """The data are over after `size` bytes; `whole` unless fewer came than were announced."""

    size: int
    whole: bool


@dataclass(frozen=True, slots=True)
class Response:
    """The answer that ends the transaction."""

    code: int
    parameters: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Event:
    """Something happened in the camera; belongs to no transaction."""

    code: int
    parameters: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Stray:
    """Data or a response of another transaction, left from a program that was killed: dropped."""

    code: int
    transaction: int


@dataclass(frozen=True, slots=True)
class Probed:
    """PTP/IP only: the camera asks whether we live; answer with `packets.PROBE_RESPONSE`."""


@dataclass(frozen=True, slots=True)
class ProbeAnswered:
    """PTP/IP only: the camera says that it lives."""


@dataclass(frozen=True, slots=True)
class NeedData:
    """Everything received has been told; read more."""


Happening: TypeAlias = (
    DataStarted
    | DataChunk
    | DataEnded
    | Response
    | Event
    | Stray
    | Probed
    | ProbeAnswered
    | NeedData
)
_NEED_DATA = NeedData()


class State(Enum):
    """Where the transaction stands."""

    READY = auto()  # none under way
    ASKED = auto()  # sent; data or a response is due
    RECEIVING = auto()  # in the data
    DATA_OVER = auto()  # only the response is due
    BROKEN = auto()  # out of step until reset


class Step(Enum):
    """What is done with something that belongs to the transaction."""

    BEGIN_DATA = auto()
    TAKE_DATA = auto()
    TAKE_LAST_DATA = auto()
    CUT_DATA = auto()
    ANSWER = auto()
    CUT_DATA_AND_ANSWER = auto()


class Part(Enum):
    """What of a container or packet the next byte belongs to."""

    HEAD = auto()  # the header, or all of one without data
    DATA = auto()
    SKIPPED = auto()  # data of another transaction


class Conversation:
    """What both initiators share: numbering, the data phase and the queue of events."""

    def __init__(self) -> None:
        self._state = State.READY
        self._events: deque[Happening] = deque()
        self._transaction = 0
        self._next_transaction = 0
        self._code = 0
        self._destination: memoryview | None = None
        self._total: int | None = None
        self._size = 0

    @property
    def state(self) -> State:
        """Where the transaction stands."""
        return self._state

    @property
    def transaction(self) -> int:
        """Number of the transaction that was sent last."""
        return self._transaction

    def next_event(self) -> Happening:
        """What was received, in order; `NeedData` when all has been told."""
        return self._events.popleft() if self._events else _NEED_DATA

    def _begin(self, request: Request, into: bytearray | memoryview | None) -> None:
        """Take the next number: 0 until a session is opened, which is 0 too, then 1 and on."""
        if self._state is not State.READY:
            raise PtpProtocolError(
                f"the transaction before is not over ({self._state.name.lower()}): reset first"
            )
        if request.code == Operation.OPEN_SESSION:
            self._transaction, self._next_transaction = 0, 1
        else:
            self._transaction = self._next_transaction
            if self._next_transaction:
                self._next_transaction = self._next_transaction % MAX_TRANSACTION + 1
        self._code = request.code
        self._destination = None if into is None else memoryview(into).cast("B")
        self._state = State.ASKED

    def _is_own(self, transaction: int) -> bool:
        return self._state is not State.READY and transaction == self._transaction

    def _check(self) -> None:
        if self._state is State.BROKEN:
            raise PtpProtocolError("the conversation is out of step; reset it first")

    def _start_data(self, total: int | None) -> None:
        if total is not None and total > MAX_DATA_BYTES:
            self._fail(f"{total} bytes of data announced, at most {MAX_DATA_BYTES} are taken")
        room = None if self._destination is None else len(self._destination)
        if room is not None and total is not None and total > room:
            self._fail(f"{total} bytes of data announced where {room} were expected")
        self._total = total
        self._size = 0
        self._state = State.RECEIVING
        self._events.append(DataStarted(total))

    def _take(self, data: memoryview) -> None:
        """Data that came through a buffer of the transport."""
        if not data:
            return
        end = self._size + len(data)
        if end > self._room():
            self._fail(f"{end} bytes of data and more, {self._room()} were expected")
        if self._destination is None:
            self._events.append(DataChunk(data))
        else:
            self._destination[self._size : end] = data
        self._size = end

    def _room(self) -> int:
        """Bytes of data that may come in all."""
        if self._total is not None:
            return self._total
        return MAX_DATA_BYTES if self._destination is None else len(self._destination)

    def _window(self, count: int, multiple: int) -> memoryview | None:
        """The next `count` bytes of the destination, less what is no whole `multiple`."""
        count -= count % multiple
        if self._destination is None or self._state is not State.RECEIVING or not count:
            return None
        return self._destination[self._size : self._size + count]

    def _end_data(self) -> None:
        self._state = State.DATA_OVER
        self._destination = None
        whole = self._total is None or self._size == self._total
        self._events.append(DataEnded(self._size, whole))

    def _answer(self, code: int, parameters: tuple[int, ...]) -> None:
        self._state = State.READY
        self._destination = None
        self._events.append(Response(code, parameters))

    def _fail(self, message: str) -> NoReturn:
        self._state = State.BROKEN
        self._destination = None
        raise PtpProtocolError(message)

    def _forget(self) -> None:
        self._state = State.READY
        self._destination = None
        self._events.clear()
