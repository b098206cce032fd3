"""The camera against libgphoto2's virtual Nikon: a responder that this project did not write."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import SettingsError
from drivers.protocols import CameraSettings
from drivers.ptp.camera import PtpCamera
from drivers.ptp.discovery import open_camera
from tests.drivers.ptp.usb_backend import Bus
from tests.drivers.ptp.virtual_nikon import VirtualNikon

SETTINGS = CameraSettings(exposure_s=0.1, aperture=8.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pictures")
    pixels = np.random.default_rng(0).integers(0, 256, (300, 400, 3), np.uint8)
    cv2.imwrite(str(folder / "scene.jpg"), pixels)
    return folder


@pytest.fixture
def bus(folder: Path) -> Bus:
    return Bus(VirtualNikon(folder, SystemClock()))


def open_one(bus: Bus) -> PtpCamera:
    return open_camera(None, SystemClock(), bus)


def test_it_captures_and_delivers_the_file(bus: Bus, folder: Path) -> None:
    expected = (folder / "scene.jpg").read_bytes()
    with open_one(bus) as camera:
        for _ in range(2):
            frame = camera.capture(SETTINGS)
            assert frame.data == expected
            assert frame.media_type == "image/jpeg"
            assert frame.settings == SETTINGS


def test_settings_are_set_and_read_back(bus: Bus) -> None:
    settings = CameraSettings(exposure_s=0.02, aperture=11.0)
    with open_one(bus) as camera:
        assert camera.capture(settings).settings == settings
        state = camera.state()
    assert state.settings == settings
    assert state.battery_percent == 50


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        pytest.param(CameraSettings(0.3), ["0.1 s (1/10)", "1 s"], id="time"),
        pytest.param(CameraSettings(0.1, 2.0), ["f/2.8", "f/3.5"], id="aperture"),
        pytest.param(CameraSettings(0.1, 8.0, 200), ["ISO speed cannot be set"], id="ISO"),
    ],
)
def test_what_it_cannot_be_set_to_is_refused_by_name(
    bus: Bus, settings: CameraSettings, named: list[str]
) -> None:
    with open_one(bus) as camera, pytest.raises(SettingsError) as caught:
        camera.capture(settings)
    assert all(text in str(caught.value) for text in named)


def test_what_is_on_its_card_is_listed_and_fetched(bus: Bus, folder: Path) -> None:
    with open_one(bus) as camera:
        handle, about = camera.pictures()[0]
        file = camera.fetch(handle)
    assert about.filename.lower().endswith(".jpg")
    assert len(file.data) == about.size == (folder / "scene.jpg").stat().st_size
