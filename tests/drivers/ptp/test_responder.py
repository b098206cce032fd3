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
from drivers.sim.devices import SimulationConfig
from drivers.sim.ptp_responder.body import BULB
from drivers.sim.ptp_responder.darkroom import Darkroom
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.scenery import simulated_scene
from drivers.sim.ptp_responder.store import SDRAM_HANDLE
from tests.drivers.ptp.host import Host
from tests.drivers.ptp.shots import AF, ALL, CAPTURE, CARD, NO_AF, RAW_FILE, SDRAM, Bench, outputs


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


def test_its_pictures_may_be_of_a_simulated_scene() -> None:
    config = SimulationConfig(camera_px=(24, 32), projector_px=(72, 96))
    source = simulated_scene(config)
    host = Host(Responder(source, developer=Darkroom()))
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


@pytest.mark.parametrize(
    ("code", "focuses"), [(0x90C0, False), (0x90CB, True)], ids=["as it is", "focused"]
)
def test_older_bodies_shoot_to_sdram_only(code: int, focuses: bool) -> None:
    bench = Bench(autofocus_finds=False)
    bench.responder.turn(Property.FOCUS_MODE, 0x8010)
    expected = ResponseCode.NIKON_OUT_OF_FOCUS if focuses else ResponseCode.OK
    assert bench.host.call(code, NO_AF).code == expected
    assert bench.host.call(NikonOperation.AF_DRIVE).code == ResponseCode.NIKON_OUT_OF_FOCUS
    bench.responder.turn(Property.FOCUS_MODE, 1)
    bench.clock.sleep(1.0)
    bench.host.call(NikonOperation.DELETE_IMAGES_IN_SDRAM)
    assert bench.host.call(code, NO_AF).code == ResponseCode.OK
    bench.clock.sleep(1.0)
    (added, _) = bench.host.listed_events()[-2:]
    assert added == Event(NikonEvent.OBJECT_ADDED_IN_SDRAM, (SDRAM_HANDLE,))
    assert bench.host.fetch(NikonOperation.GET_LARGE_THUMB, SDRAM_HANDLE)[:2] == b"\xff\xd8"


REFUSED = {
    "another mode": (NikonOperation.CHANGE_CAMERA_MODE, (2,), ResponseCode.INVALID_PARAMETER),
    "focus without live view": (NikonOperation.MANUAL_FOCUS_DRIVE, (1, 9), 0xA00B),
    "another card": (Operation.GET_STORAGE_INFO, (0x20001,), ResponseCode.INVALID_STORAGE_ID),
    "handles of another card": (
        Operation.GET_OBJECT_HANDLES,
        (0x20001, 0, 0),
        ResponseCode.INVALID_STORAGE_ID,
    ),
    "thumbnail of a folder": (Operation.GET_THUMB, (1,), ResponseCode.NO_THUMBNAIL_PRESENT),
    "deleting a folder": (Operation.DELETE_OBJECT, (1,), ResponseCode.OBJECT_WRITE_PROTECTED),
    "an operation it has not": (0x9999, (), ResponseCode.OPERATION_NOT_SUPPORTED),
    "an operation not simulated": (0x90C9, (), ResponseCode.OPERATION_NOT_SUPPORTED),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_makes_no_sense_is_refused(name: str) -> None:
    code, parameters, expected = REFUSED[name]
    assert Bench().host.call(code, *parameters).code == expected


def test_formatting_empties_the_card_and_writing_to_it_is_refused() -> None:
    bench = Bench()
    bench.capture(CARD)
    assert bench.host.call(Operation.FORMAT_STORE, 0x10001).code == ResponseCode.OK
    assert bench.host.call(Operation.GET_NUM_OBJECTS, ALL, 0, 0).parameters == (2,)
    sent = bench.host.call(Operation.SEND_OBJECT_INFO, data=b"info")
    assert sent.code == ResponseCode.STORE_READ_ONLY


def test_a_session_needs_a_number() -> None:
    bench = Bench()
    bench.host.call(Operation.CLOSE_SESSION)
    assert not bench.responder.is_open
    assert bench.host.call(Operation.GET_STORAGE_IDS).code == ResponseCode.SESSION_NOT_OPEN
    assert bench.host.call(Operation.OPEN_SESSION, 0).code == ResponseCode.INVALID_PARAMETER
    assert bench.host.call(Operation.OPEN_SESSION, 1).code == ResponseCode.OK


def test_a_command_with_half_a_parameter_is_answered() -> None:
    command = Container(ContainerType.COMMAND, Operation.GET_STORAGE_IDS, 9, b"\0\0")
    refused = Container.with_parameters(
        ContainerType.RESPONSE, ResponseCode.PARAMETER_NOT_SUPPORTED, 9
    )
    assert Bench().responder.handle(command) == [refused]
