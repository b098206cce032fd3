"""The driver before a responder that this project did not write: QEMU's, on xHCI."""

from __future__ import annotations

import pytest

from drivers.errors import CameraError
from drivers.protocols import CameraSettings
from drivers.ptp.discovery import open_camera
from tests.guest.inside.conftest import QEMU, address_of
from tests.guest.inside.reporting import EXCHANGE


def test_it_is_listed_and_read_and_refuses_to_capture() -> None:
    with open_camera(address_of(QEMU)) as driver:
        assert "QEMU" in driver.device.manufacturer
        (handle, about), *others = driver.pictures()
        assert (about.filename, others) == ("object.bin", [])
        assert driver.fetch(handle).data == (EXCHANGE / "mtp" / "object.bin").read_bytes()
        with pytest.raises(CameraError, match="takes no pictures for a computer"):
            driver.capture(CameraSettings(0.1))
