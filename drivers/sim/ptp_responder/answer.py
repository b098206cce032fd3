"""What the simulated camera answers, and what else a transport may have to do to the host."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from drivers.ptp.codes import ResponseCode
from drivers.ptp.wire import Bytes, Container


@dataclass(frozen=True, slots=True)
class Answer:
    """The end of an operation: its response, and its data if it has any."""

    code: int = ResponseCode.OK
    parameters: tuple[int, ...] = ()
    data: Bytes | None = None


class RefusalError(Exception):
    """An operation ends with another response than OK."""

    def __init__(self, code: ResponseCode) -> None:
        super().__init__(code.name)
        self.code = code


@dataclass(frozen=True, slots=True)
class Cut:
    """Data of which only the first `size` bytes go out, under a header that claims them all."""

    container: Container
    size: int


@dataclass(frozen=True, slots=True)
class Raw:
    """Bytes that go out as they are."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Stall:
    """The bulk-in endpoint halts; TCP, which cannot, is silent."""


@dataclass(frozen=True, slots=True)
class Unplug:
    """The device vanishes."""


Output: TypeAlias = Container | Cut | Raw | Stall | Unplug
