"""Projectors as their serial ports show them, with lamps that take their time."""

from __future__ import annotations

from dataclasses import dataclass, field

from drivers.lamp_commands import LampState
from drivers.protocols import Clock


@dataclass(slots=True)
class Lamp:
    """A lamp that warms up for 30 s and cools down for 60 s.

    Parameters
    ----------
    clock
        The time that it lives in.
    ready_s
        When its change is over.
    goal
        What it is, or is on the way to.
    igniting
        It comes on at all.
    """

    clock: Clock
    ready_s: float = 0.0
    goal: LampState = LampState.OFF
    igniting: bool = True

    @property
    def state(self) -> LampState:
        if self.clock.now() >= self.ready_s:
            return self.goal
        return LampState.WARMING if self.goal is LampState.ON else LampState.COOLING

    def turn(self, goal: LampState) -> None:
        if goal is not self.goal and (self.igniting or goal is LampState.OFF):
            self.goal = goal
            self.ready_s = self.clock.now() + (30 if goal is LampState.ON else 60)


@dataclass(slots=True)
class PjLinkPort:
    """Answers PJLink lines. Class 1 knows no freeze."""

    lamp: Lamp
    input: bytes = b"11"
    frozen: bool = True
    class_two: bool = True
    inputs: tuple[bytes, ...] = (b"11", b"31", b"32")
    codes: dict[LampState, bytes] = field(
        default_factory=lambda: {
            LampState.OFF: b"0",
            LampState.ON: b"1",
            LampState.COOLING: b"2",
            LampState.WARMING: b"3",
        }
    )

    def answer(self, line: bytes) -> bytes:
        head, _, value = line.partition(b" ")
        return head + b"=" + self.verdict(head, value) + b"\r"

    def verdict(self, head: bytes, value: bytes) -> bytes:
        if head == b"%1POWR":
            return self.power(value)
        if head not in {b"%1INPT", b"%2FREZ"} or (head == b"%2FREZ" and not self.class_two):
            return b"ERR1"
        if self.lamp.state is not LampState.ON:
            return b"ERR3"
        if head == b"%2FREZ":
            self.frozen = value == b"1"
            return b"OK"
        if value not in self.inputs:
            return b"ERR2"
        self.input = value
        return b"OK"

    def power(self, value: bytes) -> bytes:
        if value == b"?":
            return self.codes[self.lamp.state]
        if self.lamp.state in {LampState.WARMING, LampState.COOLING}:
            return b"ERR3"
        self.lamp.turn(LampState.ON if value == b"1" else LampState.OFF)
        return b"OK"


@dataclass(slots=True)
class BenQPort:
    """Answers BenQ lines; with `echoing`, repeats what it is sent first, as some models do."""

    lamp: Lamp
    input: bytes = b"rgb"
    frozen: bool = True
    echoing: bool = False

    def answer(self, line: bytes) -> bytes:
        echo = b">" + line + b"\r\n" if self.echoing else b""
        command = line.strip(b"*#").lower()
        return echo + b"*" + self.verdict(command) + b"#\r\n"

    def verdict(self, command: bytes) -> bytes:
        if self.lamp.state in {LampState.WARMING, LampState.COOLING}:
            return b"Block item"
        key, _, value = command.partition(b"=")
        if key == b"pow":
            if value != b"?":
                self.lamp.turn(LampState.ON if value == b"on" else LampState.OFF)
                return command.upper()
            return b"POW=ON" if self.lamp.goal is LampState.ON else b"POW=OFF"
        if self.lamp.state is LampState.OFF:
            return b"Block item"
        if key == b"freeze":
            self.frozen = value == b"on"
        elif key == b"sour" and value in {b"rgb", b"hdmi"}:
            self.input = value
        else:
            return b"Unsupported item"
        return command.upper()
