from __future__ import annotations

import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.errors import SerialError
from drivers.trigger import TriggerBox
from tests.drivers.serial_device import FAULTS, HARMLESS, Device, Fault, connected
from tests.firmware.box import PATIENCE_S, SKETCH, behind_a_line, compile_sketch, exposures

PULSE_S = 0.02


@pytest.fixture(scope="module")
def sketch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_sketch(tmp_path_factory.mktemp("box"))


@contextmanager
def box_on_a_line(
    sketch: Path,
    log: Path,
    spoiled_requests: dict[int, Fault] | None = None,
    spoiled_answers: dict[int, Fault] | None = None,
) -> Iterator[Device]:
    """The real sketch behind a line that spoils what goes over it."""
    with (
        behind_a_line(sketch, log, spoiled_requests) as relay,
        connected(Device(relay, b"\n", spoiled_answers or {})) as device,
    ):
        yield device


def test_each_call_is_one_exposure_of_the_pulse(sketch: Path, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with box_on_a_line(sketch, log) as device:
        box = TriggerBox(device.port, PULSE_S, PATIENCE_S, PATIENCE_S)
        for _ in range(3):
            box.fire()
        box.close()
        box.close()
    made = exposures(log)
    assert len(made) == 3
    assert all(one.opened_ms - one.closed_ms >= 1000 * PULSE_S for one in made)


@pytest.mark.parametrize("direction", ["request", "answer"])
@pytest.mark.parametrize("fault", [*FAULTS.values(), *HARMLESS.values()], ids=[*FAULTS, *HARMLESS])
def test_whatever_the_line_does_every_exposure_is_made_once(
    sketch: Path, tmp_path: Path, fault: Fault, direction: str
) -> None:
    log = tmp_path / "log"
    spoiled = {1: fault, 3: fault}
    requests, answers = (spoiled, None) if direction == "request" else (None, spoiled)
    with box_on_a_line(sketch, log, requests, answers) as device:
        box = TriggerBox(device.port, PULSE_S, PATIENCE_S, PATIENCE_S)
        box.fire()
        box.fire()
        box.close()
    assert len(exposures(log)) == 2


def test_the_numbers_go_round(sketch: Path, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with box_on_a_line(sketch, log) as device:
        box = TriggerBox(device.port, PULSE_S, PATIENCE_S, PATIENCE_S)
        box._number = 253
        for _ in range(4):
            box.fire()
        box.close()
        assert [line[1:3] for line in device.heard] == [b"00", b"FE", b"FF", b"00", b"01"]
    assert len(exposures(log)) == 4


def test_a_new_program_with_the_same_numbers_is_not_taken_for_a_repetition(
    sketch: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    with box_on_a_line(sketch, log) as device:
        for _ in range(2):
            box = TriggerBox(device.port, PULSE_S, PATIENCE_S, PATIENCE_S)
            box.fire()
            box.close()
    assert len(exposures(log)) == 2


def test_a_box_that_restarted_is_an_error_and_no_exposure(sketch: Path, tmp_path: Path) -> None:
    greeted, restarted = tmp_path / "greeted", tmp_path / "restarted"
    with box_on_a_line(sketch, greeted) as first:
        box = TriggerBox(first.port, PULSE_S, PATIENCE_S, PATIENCE_S)
        with box_on_a_line(sketch, restarted) as second:
            first.answer = second.answer
            with pytest.raises(SerialError, match="restarted"):
                box.fire()
        box.close()
    assert exposures(restarted) == []


@pytest.mark.parametrize(
    ("reply", "reason"),
    [
        pytest.param(b"", "silent", id="silence"),
        pytest.param(b"\xfe\x81\n", "baud", id="another rate"),
        pytest.param(b"%1POWR=OK\n", "another kind", id="another device"),
        pytest.param(b"<00 OK lumisplit-trigger 2*4343\n", "baud", id="wrong check"),
        pytest.param(b"<01 OK*2524\n", "baud", id="wrong number"),
    ],
)
def test_what_is_no_box_is_refused(reply: bytes, reason: str) -> None:
    with connected(Device(lambda _: reply, b"\n")) as device:
        started_s = time.monotonic()
        with pytest.raises(SerialError, match=reason):
            TriggerBox(device.port, PULSE_S, PATIENCE_S, PATIENCE_S)
        assert time.monotonic() - started_s < 2


def test_the_examples_of_the_readme_hold(sketch: Path) -> None:
    text = SKETCH.with_name("README.md").read_text()
    examples = re.findall(r"`([<>]\d\d [^`]*\*[0-9A-F]{4})`", text)
    requests = [line for line in examples if line.startswith(">")]
    answers = [line for line in examples if line.startswith("<")]
    assert len(requests) == len(answers) == 2
    done = subprocess.run(
        [sketch], input="\n".join([*requests, ""]), capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == answers


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        pytest.param(">00 FIRE 5*", "", id="no check"),
        pytest.param(">00 FIRE 5*0000", "", id="wrong check"),
        pytest.param("00 HELLO*43BD", "", id="no start"),
        pytest.param(">" + "A" * 300, "", id="too long"),
        pytest.param(">*1D0F", "", id="empty"),
    ],
)
def test_the_box_ignores_what_is_no_request(sketch: Path, line: str, answer: str) -> None:
    done = subprocess.run(
        [sketch], input=f"{line}\n", capture_output=True, text=True, check=True, timeout=5
    )
    assert done.stdout == answer
    assert "7 1" not in done.stderr


@pytest.mark.parametrize("pulse_s", [0.0, -1.0, 3601.0, float("nan")])
def test_an_impossible_pulse_is_refused(pulse_s: float) -> None:
    with pytest.raises(ValueError, match="pulse"):
        TriggerBox("/dev/null", pulse_s)
