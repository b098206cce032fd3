from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import cycle

import pytest

from drivers.errors import DriverError, ProjectorError, SerialError
from drivers.lamp import LampControl, LampTiming
from drivers.lamp_commands import COMMAND_SETS, BenQ, LampState, PjLink, Verdict
from drivers.serial_line import SerialLine
from drivers.sim.clock import SimulatedClock
from tests.drivers.projector_ports import BenQPort, Lamp, PjLinkPort
from tests.drivers.serial_device import FAULTS, HARMLESS, Device, Fault, connected

TIMING = LampTiming(answer_s=0.1, warm_up_s=600.0)
DIGITAL = {"pjlink-serial": "31", "benq": "hdmi"}


@dataclass(frozen=True, slots=True)
class Bench:
    control: LampControl
    port: PjLinkPort | BenQPort
    lamp: Lamp
    clock: SimulatedClock
    device: Device


@contextmanager
def bench(
    commands: str,
    spoiled: dict[int, Fault] | None = None,
    make: Callable[[Lamp], PjLinkPort | BenQPort] | None = None,
) -> Iterator[Bench]:
    clock = SimulatedClock()
    lamp = Lamp(clock)
    port = (make or {"pjlink-serial": PjLinkPort, "benq": BenQPort}[commands])(lamp)
    with connected(Device(port.answer, b"\r", spoiled or {})) as device:
        control = LampControl(device.port, commands, TIMING, clock)
        yield Bench(control, port, lamp, clock, device)
        control.close()
        control.close()


@pytest.fixture(params=COMMAND_SETS)
def commands(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_power_on_returns_when_the_light_is_steady(commands: str) -> None:
    with bench(commands) as lab:
        assert lab.control.state() is LampState.OFF
        started_s = lab.clock.now()
        lab.control.power_on()
        assert lab.control.state() is LampState.ON
        assert 30 + TIMING.warm_up_s <= lab.clock.now() - started_s <= 32 + TIMING.warm_up_s


def test_a_lamp_that_is_on_is_not_waited_for(commands: str) -> None:
    with bench(commands) as lab:
        lab.lamp.goal = LampState.ON
        started_s = lab.clock.now()
        lab.control.power_on()
        assert lab.clock.now() == started_s


def test_power_off_returns_when_it_has_cooled_down(commands: str) -> None:
    with bench(commands) as lab:
        lab.lamp.goal = LampState.ON
        started_s = lab.clock.now()
        lab.control.power_off()
        assert lab.lamp.state is LampState.OFF
        assert 60 <= lab.clock.now() - started_s <= 62


def test_power_on_waits_for_a_lamp_that_still_cools_down(commands: str) -> None:
    with bench(commands) as lab:
        lab.lamp.goal = LampState.ON
        lab.lamp.turn(LampState.OFF)
        started_s = lab.clock.now()
        lab.control.power_on()
        assert lab.lamp.state is LampState.ON
        assert 90 <= lab.clock.now() - started_s - TIMING.warm_up_s <= 93


def test_a_lamp_that_never_comes_on_is_an_error(commands: str) -> None:
    with bench(commands) as lab:
        lab.lamp.igniting = False
        with pytest.raises(ProjectorError, match="still off after 480 s"):
            lab.control.power_on()


def test_input_and_freeze_are_set_once_it_is_warm(commands: str) -> None:
    with bench(commands) as lab:
        lab.lamp.turn(LampState.ON)
        lab.control.select_input(DIGITAL[commands])
        assert lab.lamp.state is LampState.ON
        assert lab.port.input == DIGITAL[commands].encode()
        assert lab.control.unfreeze()
        assert not lab.port.frozen


def test_a_projector_without_freeze_is_tolerated() -> None:
    with bench("pjlink-serial", make=partial(PjLinkPort, class_two=False)) as lab:
        lab.lamp.goal = LampState.ON
        assert not lab.control.unfreeze()


@pytest.mark.parametrize(
    ("commands", "name", "error"),
    [
        pytest.param("pjlink-serial", "33", ProjectorError, id="PJLink: not there"),
        pytest.param("pjlink-serial", "hdmi", ValueError, id="PJLink: no number"),
        pytest.param("pjlink-serial", "31\r%1POWR 0", ValueError, id="PJLink: two commands"),
        pytest.param("benq", "dvid", ProjectorError, id="BenQ: not there"),
        pytest.param("benq", "hdmi#\r*pow=off", ValueError, id="BenQ: two commands"),
    ],
)
def test_an_input_that_it_does_not_have_is_an_error(
    commands: str, name: str, error: type[Exception]
) -> None:
    with bench(commands) as lab:
        lab.lamp.goal = LampState.ON
        before = lab.port.input
        with pytest.raises(error):
            lab.control.select_input(name)
        assert (lab.port.input, lab.lamp.goal) == (before, LampState.ON)


def test_an_echo_is_no_answer() -> None:
    with bench("benq", make=partial(BenQPort, echoing=True)) as lab:
        lab.control.power_on()
        assert lab.control.state() is LampState.ON


@pytest.mark.parametrize("fault", [*FAULTS.values(), *HARMLESS.values()], ids=[*FAULTS, *HARMLESS])
def test_what_the_line_spoils_is_asked_again(commands: str, fault: Fault) -> None:
    with bench(commands, {0: fault, 3: fault, 6: fault}) as lab:
        started_s = lab.clock.now()
        lab.control.power_on()
        assert lab.lamp.state is LampState.ON
        assert lab.clock.now() - started_s >= 30 + TIMING.warm_up_s


@pytest.mark.parametrize(
    ("commands", "false"),
    [
        pytest.param("pjlink-serial", b"%1POWR=1\r", id="PJLink"),
        pytest.param("benq", b"*POW=ON#\r\n", id="BenQ"),
    ],
)
def test_one_false_answer_is_not_believed(commands: str, false: bytes) -> None:
    with bench(commands, {0: lambda _: false}) as lab:
        lab.control.power_on()
        assert lab.lamp.state is LampState.ON


def test_a_line_that_contradicts_itself_is_an_error() -> None:
    answers = cycle([b"%1POWR=0\r", b"%1POWR=1\r"])
    with connected(Device(lambda _: next(answers), b"\r")) as device:
        control = LampControl(device.port, "pjlink-serial", TIMING, SimulatedClock())
        with pytest.raises(SerialError, match="noisy"):
            control.state()
        control.close()


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        pytest.param(b"", "silent", id="silence"),
        pytest.param(b"\xfe\x81\x00\x13", "baud", id="another rate"),
        pytest.param(b"%1POWR", "baud", id="half an answer"),
        pytest.param(b"%1POWR=9\r", "baud", id="no such state"),
        pytest.param(b"%1INPT=31\r", "baud", id="another answer"),
        pytest.param(b"*POW=MAYBE#", "baud", id="neither on nor off"),
    ],
)
def test_a_line_without_sense_is_an_error_in_the_end(
    commands: str, reply: bytes, reason: str
) -> None:
    with connected(Device(lambda _: reply, b"\r")) as device:
        control = LampControl(device.port, commands, TIMING, SimulatedClock())
        started_s = time.monotonic()
        with pytest.raises(SerialError, match=reason):
            control.power_on()
        assert time.monotonic() - started_s < 1
        control.close()


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        pytest.param(b"%1POWR=ERR4\r", "defective", id="defective"),
        pytest.param(b"%1POWR=ERR1\r", "no such command", id="unknown"),
    ],
)
def test_a_projector_that_refuses_is_an_error(reply: bytes, reason: str) -> None:
    with connected(Device(lambda _: reply, b"\r")) as device:
        control = LampControl(device.port, "pjlink-serial", TIMING, SimulatedClock())
        with pytest.raises(ProjectorError, match=reason):
            control.power_on()
        control.close()


@pytest.mark.parametrize(
    ("set_", "request_", "line", "expected"),
    [
        pytest.param(PjLink(), b"%1POWR ?\r", b"%1POWR=OK", None, id="answer to a command before"),
        pytest.param(PjLink(), b"%1POWR 1\r", b"%1POWR=1", None, id="answer to a question before"),
        pytest.param(PjLink(), b"%1POWR ?\r", b"%1powr=3", LampState.WARMING, id="small letters"),
        pytest.param(PjLink(), b"%1POWR ?\r", b"PJLINK 0\0%1POWR=2", LampState.COOLING, id="late"),
        pytest.param(PjLink(), b"%1INPT 31\r", b"%1INPT=ERR2", Verdict.REFUSED, id="no input"),
        pytest.param(PjLink(), b"%1POWR ?\r", b"%1POWR ?", None, id="echo"),
        pytest.param(BenQ(), b"\r*pow=?#\r", b">*pow=?", None, id="BenQ echo"),
        pytest.param(BenQ(), b"\r*pow=?#\r", b"\r\n*POW=ON", LampState.ON, id="BenQ on"),
        pytest.param(BenQ(), b"\r*pow=?#\r", b"*Block item", Verdict.BUSY, id="BenQ busy"),
        pytest.param(BenQ(), b"\r*pow=on#\r", b"*POW=OFF", None, id="BenQ other value"),
        pytest.param(BenQ(), b"\r*sour=hdmi#\r", b"*SOUR=HDMI", Verdict.DONE, id="BenQ done"),
    ],
)
def test_lines_are_read_for_the_question_that_was_asked(
    set_: PjLink | BenQ, request_: bytes, line: bytes, expected: object
) -> None:
    assert set_.read(request_, line) is expected


def test_an_adapter_that_is_pulled_is_an_error() -> None:
    ours, theirs = os.openpty()
    line = SerialLine(os.ttyname(theirs), 9600)
    os.close(theirs)
    os.close(ours)
    with pytest.raises(SerialError, match="unplugged"):
        line.ask(b"?\r", b"\r", lambda line: line, 0.2)
    line.close()


def test_a_port_that_another_program_has_is_refused() -> None:
    with connected(Device(lambda _: b"", b"\r")) as device:
        line = SerialLine(device.port, 9600)
        with pytest.raises(SerialError, match="fuser"):
            SerialLine(device.port, 9600)
        line.close()


@pytest.mark.parametrize(
    ("port", "reason"),
    [
        pytest.param("/dev/ttyUSB97", "by-id", id="absent"),
        pytest.param("/dev/null", "serial port", id="no serial port"),
    ],
)
def test_a_port_that_cannot_be_opened_says_what_to_do(port: str, reason: str) -> None:
    with pytest.raises(DriverError, match=reason):
        LampControl(port, "benq", TIMING, SimulatedClock())


def test_an_unknown_command_set_is_refused() -> None:
    with pytest.raises(ValueError, match="pjlink-serial, benq"):
        LampControl("/dev/null", "optoma", TIMING, SimulatedClock())
