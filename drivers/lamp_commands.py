"""What projectors understand on their serial port.

`PjLink`: the commands of PJLink class 1, with class 2's freeze, in the syntax of the specification
(JBMIA, "PJLink Specifications" 1.04 of 2013-12-10, chapter 4, and 2.00 of 2017-01-31 for
``FREZ``). PJLink itself is defined over TCP; some makers take the same lines over RS-232.

`BenQ`: the commands of BenQ's "RS232 Command Control" guides, the same for its projectors of many
years (SP920, MX613ST, LW500, HT3550 and others). They report on and off only, and refuse every
command while the lamp warms up or cools down.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol


class LampState(StrEnum):
    """What the lamp does."""

    OFF = "off"
    WARMING = "warming up"
    ON = "on"
    COOLING = "cooling down"


class Verdict(StrEnum):
    """What a projector says to a command."""

    DONE = "done"
    BUSY = "not now"
    UNKNOWN = "no such command"
    REFUSED = "no such value"
    BROKEN = "the projector is defective"


class LampCommands(Protocol):
    """A maker's commands."""

    @property
    def baud(self) -> int:
        """Rate that the maker sets."""

    @property
    def end(self) -> bytes:
        """What ends an answer."""

    @property
    def power_query(self) -> bytes:
        """Asks what the lamp does."""

    @property
    def unfreeze(self) -> bytes:
        """Lets the picture follow the input again."""

    def power(self, wanted: LampState) -> bytes:
        """Turns the lamp on or off."""

    def select_input(self, name: str) -> bytes:
        """Selects an input; ValueError if that is no name of one."""

    def read(self, request: bytes, line: bytes) -> LampState | Verdict | None:
        """The answer to a request; None if the line is none."""


@dataclass(frozen=True, slots=True)
class PjLink:
    """PJLink's commands (see the module)."""

    baud: int = 9600
    end: bytes = b"\r"
    power_query: bytes = b"%1POWR ?\r"
    unfreeze: bytes = b"%2FREZ 0\r"

    def power(self, wanted: LampState) -> bytes:
        """``POWR 1`` or ``POWR 0``."""
        return b"%1POWR 1\r" if wanted is LampState.ON else b"%1POWR 0\r"

    def select_input(self, name: str) -> bytes:
        """``INPT``: kind (1 RGB, 2 video, 3 digital, 4 storage, 5 network) and number: ``31``."""
        if not re.fullmatch("[1-5][1-9]", name):
            raise ValueError(f"a PJLink input is two digits, such as 31, not {name!r}")
        return f"%1INPT {name}\r".encode()

    def read(self, request: bytes, line: bytes) -> LampState | Verdict | None:
        """Of ``%1POWR=OK`` and the like; other commands' answers and noise are none."""
        _, found, value = line.upper().rpartition(request[:6] + b"=")
        if not found:
            return None
        if value in _PJLINK_ERRORS:
            return _PJLINK_ERRORS[value]
        if request == self.power_query:
            return _PJLINK_STATES.get(value)
        return Verdict.DONE if value == b"OK" else None


_PJLINK_ERRORS = {
    b"ERR1": Verdict.UNKNOWN,
    b"ERR2": Verdict.REFUSED,
    b"ERR3": Verdict.BUSY,
    b"ERR4": Verdict.BROKEN,
}
_PJLINK_STATES = {
    b"0": LampState.OFF,
    b"1": LampState.ON,
    b"2": LampState.COOLING,
    b"3": LampState.WARMING,
}


@dataclass(frozen=True, slots=True)
class BenQ:
    """BenQ's commands (see the module)."""

    baud: int = 115200
    end: bytes = b"#"
    power_query: bytes = b"\r*pow=?#\r"
    unfreeze: bytes = b"\r*freeze=off#\r"

    def power(self, wanted: LampState) -> bytes:
        """``pow=on`` or ``pow=off``."""
        return b"\r*pow=on#\r" if wanted is LampState.ON else b"\r*pow=off#\r"

    def select_input(self, name: str) -> bytes:
        """``sour``: ``hdmi``, ``hdmi2``, ``RGB``, ``dvid``, ``dp``, … as the guide lists them."""
        if not re.fullmatch("[A-Za-z0-9]{1,16}", name):
            raise ValueError(f"a BenQ input is a name such as hdmi or RGB, not {name!r}")
        return f"\r*sour={name}#\r".encode()

    def read(self, request: bytes, line: bytes) -> LampState | Verdict | None:
        """Of ``*POW=ON``, ``*Block item`` and the like; noise and the echo of a question are none.

        Where the projector echoes a command before it answers, the echo counts as the answer.
        """
        text = line.rpartition(b"*")[2].lower()
        if text in _BENQ_REFUSALS:
            return _BENQ_REFUSALS[text]
        asked = request.strip(b"\r*#").lower()
        if request == self.power_query:
            return {b"pow=on": LampState.ON, b"pow=off": LampState.OFF}.get(text)
        return Verdict.DONE if text == asked else None


_BENQ_REFUSALS = {
    b"illegal format": Verdict.UNKNOWN,
    b"unsupported item": Verdict.UNKNOWN,
    b"block item": Verdict.BUSY,
}

COMMAND_SETS: dict[str, LampCommands] = {"pjlink-serial": PjLink(), "benq": BenQ()}
