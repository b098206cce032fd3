"""What a camera may do wrong, on request and by name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from drivers.ptp.codes import NikonOperation, Operation, ResponseCode

CAPTURES = frozenset(
    {
        Operation.INITIATE_CAPTURE,
        NikonOperation.CAPTURE,
        NikonOperation.AF_AND_CAPTURE_IN_SDRAM,
        NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA,
    }
)
FETCHES = frozenset({Operation.GET_OBJECT, Operation.GET_PARTIAL_OBJECT})


class Name(StrEnum):
    """The names; each says what the host sees."""

    BUSY = "busy"  # the operation is answered with a code, busy unless another is given
    STALL = "stall"  # the endpoint halts instead of an answer
    TIMEOUT = "timeout"  # the operation is done, its answer lost
    WRONG_TRANSACTION = "wrong-transaction"  # the answer has another transaction's number
    STALE_ANSWER = "stale-answer"  # an answer to a killed program's operation comes first
    GARBAGE = "garbage"  # bytes that are no container
    CUT_OBJECT = "cut-object"  # half the data, then an answer that claims success
    UNPLUG = "unplug"  # the device is gone, amid the data if the operation has any
    SLEEP = "sleep"  # silence until the transport is reset
    LOST_EVENTS = "lost-event"  # a shot of which no event tells
    LOST_OBJECT_EVENT = "lost-object-event"  # only the completion is told
    LOST_COMPLETION = "lost-completion"  # only the object is told
    COMPLETION_FIRST = "completion-first"  # the completion before the object
    ZERO_HANDLE = "zero-handle"  # the object's event does not say which
    JPEG_FIRST = "jpeg-first"  # of a pair the JPEG before the raw
    ODD_EVENT = "odd-event"  # events nobody knows around those that are due


OF_A_SHOT = frozenset(
    {
        Name.LOST_EVENTS,
        Name.LOST_OBJECT_EVENT,
        Name.LOST_COMPLETION,
        Name.COMPLETION_FIRST,
        Name.ZERO_HANDLE,
        Name.JPEG_FIRST,
        Name.ODD_EVENT,
    }
)
_OF_DATA = frozenset({Name.STALL, Name.CUT_OBJECT, Name.GARBAGE})


@dataclass(frozen=True, slots=True)
class Misbehaviour:
    """One thing done wrong.

    Parameters
    ----------
    name
        What.
    operation
        At which operation; None for the captures, or the fetching of data for those that are
        about data.
    skip
        How many of these operations pass unharmed first.
    times
        How many it then befalls.
    code
        The response of "busy".
    """

    name: Name
    operation: int | None = None
    skip: int = 0
    times: int = 1
    code: int = ResponseCode.DEVICE_BUSY

    @classmethod
    def parse(cls, text: str) -> Misbehaviour:
        """From ``NAME[=CODE][@OPERATION][+SKIP][*TIMES]``, numbers of codes in hexadecimal."""
        match = re.fullmatch(
            r"([a-z-]+)(?:=([0-9A-Fa-f]{4}))?(?:@([0-9A-Fa-f]{4}))?(?:\+(\d+))?(?:\*(\d+))?", text
        )
        names = ", ".join(Name)
        if match is None or match[1] not in set(Name):
            raise ValueError(
                f"no misbehaviour {text!r}; it is NAME[=CODE][@OPERATION][+SKIP][*TIMES] "
                f"with a name of {names}"
            )
        code = int(match[2], 16) if match[2] else ResponseCode.DEVICE_BUSY
        operation = int(match[3], 16) if match[3] else None
        return cls(Name(match[1]), operation, int(match[4] or 0), int(match[5] or 1), code)

    def concerns(self, operation: int) -> bool:
        """Whether it happens at this operation."""
        if self.operation is not None:
            return operation == self.operation
        return operation in (FETCHES if self.name in _OF_DATA else CAPTURES)


class Script:
    """The misbehaviours of a run, each used up as it happens.

    Parameters
    ----------
    misbehaviours
        Of two that concern the same operation the first goes first.
    """

    def __init__(self, misbehaviours: Sequence[Misbehaviour] = ()) -> None:
        self._due = [_Due(each, each.skip, each.times) for each in misbehaviours]

    def take(self, operation: int) -> Misbehaviour | None:
        """What goes wrong with this operation, if anything."""
        for due in self._due:
            if due.times and due.misbehaviour.concerns(operation):
                if due.skip:
                    due.skip -= 1
                    continue
                due.times -= 1
                return due.misbehaviour
        return None

    @property
    def untaken(self) -> tuple[Misbehaviour, ...]:
        """What has not happened to the end."""
        return tuple(due.misbehaviour for due in self._due if due.times)


@dataclass(slots=True)
class _Due:
    """A misbehaviour and what is left of it."""

    misbehaviour: Misbehaviour
    skip: int
    times: int
