"""Live view of the simulated body."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.ptp.codes import (
    NikonOperation,
    NikonProperty,
    Property,
    ResponseCode,
)
from tests.drivers.ptp.shots import SDRAM, Bench


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
    assert bench.host.call(NikonOperation.MANUAL_FOCUS_DRIVE, 1, 50).code == ResponseCode.OK
    assert bench.host.call(NikonOperation.MANUAL_FOCUS_DRIVE, 3, 50).code == (
        ResponseCode.INVALID_PARAMETER
    )
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
