"""The simulated body: what hangs together in a camera hangs together in it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.errors import CameraError
from drivers.protocols import CameraSettings
from drivers.ptp.codes import (
    ContainerType,
    EventCode,
    Format,
    NikonEvent,
    NikonOperation,
    NikonProperty,
    Operation,
    Property,
    ResponseCode,
)
from drivers.ptp.cursor import value_bytes
from drivers.ptp.datasets import DeviceInfo, ObjectInfo, StorageInfo, decode_handles
from drivers.ptp.transaction import Event
from drivers.ptp.wire import Container
from drivers.raw import decode_raw
from drivers.sim.clock import SimulatedClock
from drivers.sim.devices import SimulationConfig
from drivers.sim.ptp_responder.answer import Cut, Output, Raw, Stall, Unplug
from drivers.sim.ptp_responder.body import BULB, d4s, plain
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour, Name
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.source import simulated_scene
from drivers.sim.ptp_responder.store import SDRAM_HANDLE
from tests.drivers.ptp.host import Host

CAPTURE = NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA
NO_AF, AF = 0xFFFFFFFF, 0xFFFFFFFE
CARD, SDRAM = 0, 1
RAW_FILE = b"raw" * 100
ALL = 0xFFFFFFFF


class Bench:
    """A camera on a clock that can be moved, and the host before it."""

    def __init__(
        self,
        *misbehaviours: str,
        body: str = "d4s",
        card_images: int = 9,
        autofocus_finds: bool = True,
        piece: int = 512,
    ) -> None:
        self.clock = SimulatedClock()
        self.asked: list[CameraSettings] = []
        self.responder = Responder(
            self.shoot,
            d4s() if body == "d4s" else plain(),
            [Misbehaviour.parse(text) for text in misbehaviours],
            self.clock,
            card_images,
            autofocus_finds,
        )
        self.host = Host(self.responder, piece)

    def shoot(self, settings: CameraSettings) -> tuple[bytes, str]:
        self.asked.append(settings)
        return RAW_FILE, "image/x-raw"

    def capture(self, target: int) -> list[Event]:
        """A whole shot; what the host is told of it."""
        assert self.host.call(CAPTURE, NO_AF, target).code == ResponseCode.OK
        self.clock.sleep(1.0)
        return self.host.listed_events()


def test_it_introduces_itself_as_the_published_report_has_it() -> None:
    info = DeviceInfo.decode(Bench().host.fetch(Operation.GET_DEVICE_INFO))
    assert (info.manufacturer, info.model, info.vendor_extension) == (
        "Nikon Corporation",
        "D4S",
        10,
    )
    assert len(info.operations) == 57
    assert {CAPTURE, NikonOperation.GET_EVENT, Operation.GET_PARTIAL_OBJECT} <= set(info.operations)
    vendor = Bench().host.fetch(NikonOperation.GET_VENDOR_PROP_CODES)
    assert len(info.properties) + int.from_bytes(vendor[:4], "little") == 207


@pytest.mark.parametrize("piece", [1, 2, 3, 11, 12, 13, 64, 511, 100_000])
def test_its_bytes_may_arrive_in_pieces_of_any_size(piece: int) -> None:
    bench = Bench(piece=piece)
    assert bench.capture(SDRAM)[0].parameters == (SDRAM_HANDLE,)
    assert bench.host.fetch(Operation.GET_OBJECT, SDRAM_HANDLE) == RAW_FILE
    assert bench.host.value(Property.F_NUMBER) == 800


def test_a_shot_to_sdram_is_told_fetched_and_deleted() -> None:
    bench = Bench()
    assert bench.host.call(CAPTURE, NO_AF, SDRAM).code == ResponseCode.OK
    assert bench.host.call(NikonOperation.DEVICE_READY).code == ResponseCode.DEVICE_BUSY
    assert bench.host.listed_events() == []
    bench.clock.sleep(1.0)
    assert bench.host.call(NikonOperation.DEVICE_READY).code == ResponseCode.OK
    assert bench.host.listed_events() == [
        Event(NikonEvent.OBJECT_ADDED_IN_SDRAM, (SDRAM_HANDLE,)),
        Event(NikonEvent.CAPTURE_COMPLETE_REC_IN_SDRAM, (0,)),
    ]
    info = ObjectInfo.decode(bench.host.fetch(Operation.GET_OBJECT_INFO, SDRAM_HANDLE))
    assert (info.object_format, info.size) == (Format.UNDEFINED, len(RAW_FILE))
    assert bench.host.fetch(Operation.GET_OBJECT, SDRAM_HANDLE) == RAW_FILE
    assert bench.host.call(CAPTURE, NO_AF, SDRAM).code == ResponseCode.DEVICE_BUSY
    assert bench.host.call(Operation.DELETE_OBJECT, SDRAM_HANDLE).code == ResponseCode.OK
    assert bench.host.call(CAPTURE, NO_AF, SDRAM).code == ResponseCode.OK


def test_a_shot_to_the_card_stays_there_until_it_is_deleted() -> None:
    bench = Bench()
    added, complete = bench.capture(CARD)
    assert (added.code, complete.code) == (EventCode.OBJECT_ADDED, EventCode.CAPTURE_COMPLETE)
    (handle,) = added.parameters
    info = ObjectInfo.decode(bench.host.fetch(Operation.GET_OBJECT_INFO, handle))
    assert info.filename == "DSC_0001.NEF"
    parent = ObjectInfo.decode(bench.host.fetch(Operation.GET_OBJECT_INFO, info.parent))
    assert (parent.object_format, parent.filename) == (Format.ASSOCIATION, "100ND4S")
    storage = bench.host.fetch(Operation.GET_STORAGE_INFO, info.storage)
    assert StorageInfo.decode(storage).free_images == 8
    handles = decode_handles(bench.host.fetch(Operation.GET_OBJECT_HANDLES, ALL, 0, info.parent))
    assert handles == (handle,)
    assert bench.host.call(Operation.GET_NUM_OBJECTS, ALL, 0, 0).parameters == (3,)
    assert bench.host.call(Operation.DELETE_OBJECT, handle).code == ResponseCode.OK
    assert bench.host.call(Operation.GET_OBJECT, handle).code == ResponseCode.INVALID_OBJECT_HANDLE


def test_parts_of_an_object() -> None:
    bench = Bench()
    (handle,) = bench.capture(CARD)[0].parameters
    parts = [
        bench.host.fetch(Operation.GET_PARTIAL_OBJECT, handle, start, 128)
        for start in range(0, len(RAW_FILE) + 1, 128)
    ]
    assert b"".join(parts) == RAW_FILE
    reply = bench.host.call(Operation.GET_PARTIAL_OBJECT, handle, len(RAW_FILE) - 5, 128)
    assert reply.parameters == (5,)
    beyond = bench.host.call(Operation.GET_PARTIAL_OBJECT, handle, len(RAW_FILE) + 1, 1)
    assert beyond.code == ResponseCode.INVALID_PARAMETER


def test_shutter_speed_and_exposure_time_are_one_wheel() -> None:
    bench = Bench()
    assert bench.host.set(NikonProperty.SHUTTER_SPEED, 1 << 16 | 3) == ResponseCode.OK
    assert bench.host.value(Property.EXPOSURE_TIME) == 3333
    for tenths_ms in (1, 2, 100, 4000, 13_000, 300_000, BULB):
        assert bench.host.set(Property.EXPOSURE_TIME, tenths_ms) == ResponseCode.OK
        assert bench.host.value(Property.EXPOSURE_TIME) == tenths_ms
        speed = bench.host.value(NikonProperty.SHUTTER_SPEED)
        assert isinstance(speed, int)
        if speed != BULB:
            assert 10_000 * (speed >> 16) // (speed & 0xFFFF) == tenths_ms


def test_a_shot_is_exposed_as_set() -> None:
    bench = Bench()
    bench.host.set(NikonProperty.SHUTTER_SPEED, 10 << 16 | 25)
    bench.host.set(Property.F_NUMBER, 1100)
    bench.host.set(Property.EXPOSURE_INDEX, 1600)
    bench.capture(CARD)
    assert bench.asked == [CameraSettings(0.4, 11.0, 1600)]


def test_values_that_are_not_on_the_list_are_refused() -> None:
    host = Bench().host
    assert host.set(Property.F_NUMBER, 801) == ResponseCode.INVALID_PROPERTY_VALUE
    assert host.set(NikonProperty.RECORDING_MEDIA, 3) == ResponseCode.INVALID_PROPERTY_VALUE
    assert host.value(Property.F_NUMBER) == 800
    for data in (b"\x20", b"\x20\x03\x00"):
        reply = host.call(Operation.SET_DEVICE_PROP_VALUE, Property.F_NUMBER, data=data)
        assert reply.code == ResponseCode.INVALID_PROPERTY_FORMAT
    assert host.call(Operation.GET_DEVICE_PROP_DESC, 0x5FFF).code == (
        ResponseCode.PROPERTY_NOT_SUPPORTED
    )


@pytest.mark.parametrize(
    ("program", "time_free", "aperture_free"),
    [(1, True, True), (2, False, False), (3, False, True), (4, True, False)],
    ids=["M", "P", "A", "S"],
)
def test_the_mode_dial_decides_what_can_be_set(
    program: int, time_free: bool, aperture_free: bool
) -> None:
    bench = Bench()
    bench.responder.turn(Property.EXPOSURE_PROGRAM, program)
    free = {
        Property.EXPOSURE_TIME: time_free,
        NikonProperty.SHUTTER_SPEED: time_free,
        Property.F_NUMBER: aperture_free,
    }
    for code, is_free in free.items():
        description = bench.host.describe(code)
        assert description.is_writable == is_free
        expected = ResponseCode.OK if is_free else ResponseCode.ACCESS_DENIED
        assert bench.host.set(code, description.current) == expected


def test_a_shot_is_refused_for_the_reason_that_a_camera_gives() -> None:
    bench = Bench()
    bench.responder.turn(Property.EXPOSURE_TIME, BULB)
    assert bench.host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.NIKON_SHUTTER_SPEED_BULB
    host = Bench(card_images=0).host
    assert host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.STORE_NOT_AVAILABLE
    assert host.call(CAPTURE, NO_AF, SDRAM).code == ResponseCode.OK
    bench = Bench(card_images=1)
    bench.capture(CARD)
    assert bench.host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.STORE_FULL
    bench = Bench(autofocus_finds=False)
    assert bench.host.call(CAPTURE, AF, CARD).code == ResponseCode.OK
    bench = Bench(autofocus_finds=False)
    bench.responder.turn(Property.FOCUS_MODE, 0x8010)
    assert bench.host.call(CAPTURE, AF, CARD).code == ResponseCode.NIKON_OUT_OF_FOCUS
    assert bench.host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.OK
    assert bench.host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.DEVICE_BUSY


def test_a_source_that_fails_is_a_general_error() -> None:
    def broken(_: CameraSettings) -> tuple[bytes, str]:
        raise CameraError("the lens is off")

    host = Host(Responder(broken))
    assert host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.GENERAL_ERROR


def test_quality_decides_which_files_a_shot_makes() -> None:
    bench = Bench()
    formats = []
    for quality in (4, 0, 6):
        bench.host.set(Property.COMPRESSION, quality)
        *objects, _ = bench.capture(CARD)
        infos = [
            ObjectInfo.decode(bench.host.fetch(Operation.GET_OBJECT_INFO, *event.parameters))
            for event in objects
        ]
        formats.append([info.object_format for info in infos])
    assert formats == [
        [Format.UNDEFINED],
        [Format.EXIF_JPEG],
        [Format.UNDEFINED, Format.EXIF_JPEG],
    ]


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


def outputs(bench: Bench, code: int, *parameters: int) -> list[Output]:
    command = Container.with_parameters(ContainerType.COMMAND, code, 9, parameters)
    return bench.responder.handle(command)


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


def test_live_view_needs_its_time_and_ends() -> None:
    bench = Bench()
    assert bench.host.call(NikonOperation.GET_LIVE_VIEW_IMAGE).code == 0xA00B
    assert bench.host.call(NikonOperation.START_LIVE_VIEW).code == ResponseCode.OK
    assert bench.host.call(NikonOperation.GET_LIVE_VIEW_IMAGE).code == ResponseCode.DEVICE_BUSY
    bench.clock.sleep(0.5)
    assert bench.host.call(NikonOperation.DEVICE_READY).code == ResponseCode.OK
    assert bench.host.value(NikonProperty.LIVE_VIEW_STATUS) == 1
    image = bench.host.fetch(NikonOperation.GET_LIVE_VIEW_IMAGE)
    start = image.index(b"\xff\xd8")
    assert start > 0
    picture = cv2.imdecode(np.frombuffer(image[start:], np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert bench.host.call(NikonOperation.END_LIVE_VIEW).code == ResponseCode.OK
    assert bench.host.value(NikonProperty.LIVE_VIEW_STATUS) == 0


PROHIBITIONS = {
    "battery": (8, Property.BATTERY_LEVEL, 5),
    "mode": (31, Property.EXPOSURE_PROGRAM, 0x8010),
}


@pytest.mark.parametrize("name", PROHIBITIONS)
def test_what_stands_against_live_view_is_told(name: str) -> None:
    bit, code, value = PROHIBITIONS[name]
    bench = Bench()
    bench.responder.turn(code, value)
    assert bench.host.value(NikonProperty.LIVE_VIEW_PROHIBITION) == 1 << bit
    assert bench.host.call(NikonOperation.START_LIVE_VIEW).code == (
        ResponseCode.NIKON_INVALID_STATUS
    )


def test_an_image_in_sdram_or_no_card_stand_against_live_view() -> None:
    bench = Bench()
    bench.capture(SDRAM)
    assert bench.host.value(NikonProperty.LIVE_VIEW_PROHIBITION) == 1 << 12
    host = Bench(card_images=0).host
    assert host.value(NikonProperty.LIVE_VIEW_PROHIBITION) == 1 << 14
    host.set(NikonProperty.RECORDING_MEDIA, 1)
    assert host.value(NikonProperty.LIVE_VIEW_PROHIBITION) == 0


def test_a_plain_body_pushes_its_events_and_knows_no_vendor_operation() -> None:
    bench = Bench(body="plain")
    assert bench.host.call(NikonOperation.GET_EVENT).code == (ResponseCode.OPERATION_NOT_SUPPORTED)
    assert bench.host.set(Property.EXPOSURE_TIME, 4000) == ResponseCode.OK
    assert bench.host.call(Operation.INITIATE_CAPTURE, 0, 0).code == ResponseCode.OK
    assert bench.host.pushed_events() == []
    bench.clock.sleep(1.0)
    added, complete = bench.host.pushed_events()
    assert (added.code, complete.code) == (EventCode.OBJECT_ADDED, EventCode.CAPTURE_COMPLETE)
    assert bench.host.fetch(Operation.GET_OBJECT, *added.parameters) == RAW_FILE
    assert bench.asked == [CameraSettings(0.4, 8.0, 200)]


def test_only_one_session_is_open() -> None:
    reply = Bench().host.call(Operation.OPEN_SESSION, 2)
    assert (reply.code, reply.parameters) == (ResponseCode.SESSION_ALREADY_OPEN, (1,))


def test_data_of_another_transaction_than_the_command_s_do_nothing() -> None:
    bench = Bench()
    code = Operation.SET_DEVICE_PROP_VALUE
    assert outputs(bench, code, Property.F_NUMBER) == []
    value = value_bytes(4, 1100)
    assert bench.responder.handle(Container(ContainerType.DATA, code, 8, value)) == []
    assert bench.responder.handle(Container(ContainerType.DATA, code, 9, value)) == []
    assert bench.host.value(Property.F_NUMBER) == 800


def test_the_default_source_is_a_simulated_scene() -> None:
    config = SimulationConfig(camera_px=(24, 32), projector_px=(72, 96))
    source = simulated_scene(config)
    host = Host(Responder(source))
    host.set(NikonProperty.SHUTTER_SPEED, 1 << 16 | 20)
    assert host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.OK
    assert host.call(CAPTURE, NO_AF, CARD).code == ResponseCode.DEVICE_BUSY
    expected, _ = source(CameraSettings(0.05, 8.0, 200))
    while not (events := host.listed_events()):
        pass
    data = host.fetch(Operation.GET_OBJECT, *events[0].parameters)
    np.testing.assert_array_equal(decode_raw(data).values, decode_raw(expected).values)
    thumb = host.fetch(Operation.GET_THUMB, *events[0].parameters)
    picture = cv2.imdecode(np.frombuffer(thumb, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (120, 160, 3)
