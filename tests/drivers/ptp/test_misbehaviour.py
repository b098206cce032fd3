"""What the simulated camera does wrong on request, and that it is right again after."""

from __future__ import annotations

import pytest

from drivers.ptp.codes import (
    ContainerType,
    Format,
    NikonOperation,
    Operation,
    Property,
    ResponseCode,
)
from drivers.ptp.datasets import ObjectInfo
from drivers.ptp.wire import Container
from drivers.sim.ptp_responder.answer import Cut, Output, Raw, Stall, Unplug
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour, Name
from tests.drivers.ptp.host import Host
from tests.drivers.ptp.shots import ALL, CAPTURE, CARD, NO_AF, RAW_FILE, Bench, outputs

EVENTS = {
    "lost-event": [],
    "lost-object-event": [0x400D],
    "lost-completion": [0x4002],
    "completion-first": [0x400D, 0x4002],
    "odd-event": [0xC1FF, 0x4002, 0xC1FF, 0x400D],
    "zero-handle": [0x4002, 0x400D],
}


@pytest.mark.parametrize("name", EVENTS)
def test_events_go_wrong_once_and_the_file_is_there(name: str) -> None:
    bench = Bench(name)
    events = bench.capture(CARD)
    assert [event.code for event in events] == EVENTS[name]
    if name == "zero-handle":
        assert events[0].parameters == (0,)
    assert bench.host.call(Operation.GET_NUM_OBJECTS, ALL, 0, 0).parameters == (3,)
    assert [event.code for event in bench.capture(CARD)] == [0x4002, 0x400D]


def test_of_a_pair_the_jpeg_may_come_first() -> None:
    bench = Bench("jpeg-first")
    bench.host.set(Property.COMPRESSION, 5)
    first, _, _ = bench.capture(CARD)
    info = ObjectInfo.decode(bench.host.fetch(Operation.GET_OBJECT_INFO, *first.parameters))
    assert info.object_format == Format.EXIF_JPEG


def ok(transaction: int) -> Container:
    return Container.with_parameters(ContainerType.RESPONSE, ResponseCode.OK, transaction)


def fetched(transaction: int) -> Container:
    return Container(ContainerType.DATA, Operation.GET_OBJECT, transaction, RAW_FILE)


OUTPUTS: dict[str, list[Output]] = {
    "busy@1009": [Container.with_parameters(ContainerType.RESPONSE, 0x2019, 9)],
    "busy=A004@1009": [Container.with_parameters(ContainerType.RESPONSE, 0xA004, 9)],
    "stall": [Stall()],
    "timeout@1009": [],
    "wrong-transaction@1009": [fetched(10), ok(10)],
    "stale-answer@1009": [ok(0x1234), fetched(9), ok(9)],
    "garbage": [Raw(bytes.fromhex("deadbeef") * 16)],
    "cut-object": [Cut(fetched(9), len(RAW_FILE) // 2), ok(9)],
    "unplug@1009": [Cut(fetched(9), len(RAW_FILE) // 2), Unplug()],
    "sleep@1009": [],
}


@pytest.mark.parametrize("text", OUTPUTS)
def test_answers_go_wrong_as_the_script_has_it(text: str) -> None:
    bench = Bench(f"{text}+1*2")
    (handle,) = bench.capture(CARD)[0].parameters
    usual: list[Output] = [fetched(9), ok(9)]
    told = [outputs(bench, Operation.GET_OBJECT, handle) for _ in range(4)]
    after: list[Output] = [] if text.startswith("sleep") else usual
    assert told == [usual, OUTPUTS[text], OUTPUTS[text], after]


def test_a_reset_wakes_it_and_ends_the_session() -> None:
    bench = Bench("sleep")
    bench.host.call(NikonOperation.CHANGE_CAMERA_MODE, 1)
    assert bench.responder.is_remote
    assert outputs(bench, CAPTURE, NO_AF, CARD) == []
    assert outputs(bench, Operation.GET_DEVICE_INFO) == []
    assert bench.responder.due_events() == []
    bench.responder.reset()
    assert not bench.responder.is_open
    assert not bench.responder.is_remote
    refused = Container.with_parameters(ContainerType.RESPONSE, ResponseCode.SESSION_NOT_OPEN, 9)
    assert outputs(bench, CAPTURE, NO_AF, CARD) == [refused]
    assert Host(bench.responder).call(CAPTURE, NO_AF, CARD).code == ResponseCode.OK


@pytest.mark.parametrize(
    "text", ["asleep", "busy=19", "busy@", "busy+x", "busy*", ""], ids=lambda text: text or "empty"
)
def test_misbehaviours_are_named_exactly(text: str) -> None:
    with pytest.raises(ValueError, match=r"no misbehaviour .* cut-object, "):
        Misbehaviour.parse(text)


def test_a_misbehaviour_is_written_in_one_word() -> None:
    expected = Misbehaviour(Name.BUSY, operation=0x90C8, skip=2, times=3, code=0xA200)
    assert Misbehaviour.parse("busy=A200@90C8+2*3") == expected
