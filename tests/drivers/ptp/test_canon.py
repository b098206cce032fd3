"""Canon EOS, as far as it is described, against a small body of the tests' own."""

from __future__ import annotations

import struct

import pytest

from drivers.errors import CameraError, SettingsError
from drivers.protocols import CameraSettings
from drivers.ptp.codes import CanonOperation, CanonProperty, ResponseCode
from drivers.ptp.discovery import open_camera
from drivers.sim.clock import SimulatedClock
from tests.drivers.ptp.benches import picture
from tests.drivers.ptp.canon_eos import RAW_AND_JPEG, CanonEos
from tests.drivers.ptp.usb_backend import Bus, ResponderPipe

SETTINGS = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
RAW = picture(SETTINGS)[0] + bytes(3 << 20)  # more than one block
JPEG = b"\xff\xd8\xff" + bytes(1000) + b"\xff\xd9"


@pytest.fixture
def clock() -> SimulatedClock:
    return SimulatedClock()


def plugged(eos: CanonEos, clock: SimulatedClock) -> Bus:
    return Bus(ResponderPipe(eos, clock), vendor=0x04A9, product=0x3218)


def test_a_shot_is_fetched_in_blocks_and_control_is_given_back(clock: SimulatedClock) -> None:
    eos = CanonEos(RAW, JPEG, clock)
    with open_camera(None, clock, plugged(eos, clock)) as camera:
        assert eos.is_remote
        for _ in range(2):
            frame = camera.capture(SETTINGS)
            assert frame.data == RAW
            assert frame.settings == SETTINGS
        assert camera.state().settings == SETTINGS
    assert eos.log.count(CanonOperation.TRANSFER_COMPLETE) == 2
    assert not eos.is_remote
    assert eos.values[CanonProperty.CAPTURE_DESTINATION] == struct.pack("<I", 2)


@pytest.mark.parametrize("jpeg_first", [False, True], ids=["raw first", "JPEG first"])
def test_of_a_pair_the_raw_file_is_delivered(clock: SimulatedClock, jpeg_first: bool) -> None:
    eos = CanonEos(RAW, JPEG, clock, jpeg_first)
    eos.values[CanonProperty.IMAGE_FORMAT] = RAW_AND_JPEG
    with open_camera(None, clock, plugged(eos, clock)) as camera:
        assert camera.capture(SETTINGS).data == RAW
    assert eos.log.count(CanonOperation.TRANSFER_COMPLETE) == 2


@pytest.mark.parametrize("code", [ResponseCode.DEVICE_BUSY, 0xA102, 0xA106], ids=hex)
def test_a_busy_body_is_asked_again(clock: SimulatedClock, code: int) -> None:
    eos = CanonEos(RAW, JPEG, clock)
    eos.busy = [code] * 3
    with open_camera(None, clock, plugged(eos, clock)) as camera:
        assert camera.capture(SETTINGS).data == RAW


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        pytest.param(CameraSettings(0.2, 8.0, 200), ["0.1 s (1/10)", "1 s"], id="time"),
        pytest.param(CameraSettings(0.1, 4.0, 200), ["f/5.6", "f/8"], id="aperture"),
        pytest.param(CameraSettings(0.1, 8.0, 3200), ["100", "200"], id="ISO"),
    ],
)
def test_values_that_it_does_not_have_are_refused_with_the_nearest(
    clock: SimulatedClock, settings: CameraSettings, named: list[str]
) -> None:
    eos = CanonEos(RAW, JPEG, clock)
    with open_camera(None, clock, plugged(eos, clock)) as camera:
        with pytest.raises(SettingsError) as caught:
            camera.capture(settings)
        assert all(text in str(caught.value) for text in named)
        assert camera.capture(SETTINGS).data == RAW


def test_a_setting_that_it_keeps_is_an_error(clock: SimulatedClock) -> None:
    eos = CanonEos(RAW, JPEG, clock)
    eos.keeps = {CanonProperty.APERTURE}
    with (
        open_camera(None, clock, plugged(eos, clock)) as camera,
        pytest.raises(SettingsError, match="aperture"),
    ):
        camera.capture(SETTINGS)


def test_a_refused_release_says_why(clock: SimulatedClock) -> None:
    eos = CanonEos(RAW, JPEG, clock)
    eos.busy = [ResponseCode.STORE_NOT_AVAILABLE]
    with (
        open_camera(None, clock, plugged(eos, clock)) as camera,
        pytest.raises(CameraError, match="put one in"),
    ):
        camera.capture(SETTINGS)


def test_live_view(clock: SimulatedClock) -> None:
    eos = CanonEos(RAW, JPEG, clock)
    with open_camera(None, clock, plugged(eos, clock)) as camera:
        frames = camera.live_view()
        assert [next(frames) for _ in range(2)] == [JPEG] * 2
        frames.close()
    assert eos.values[CanonProperty.VIEWFINDER_OUTPUT] == struct.pack("<I", 0)
