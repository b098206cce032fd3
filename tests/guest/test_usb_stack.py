"""The driver and the simulated camera on a real Linux USB stack, in a virtual machine."""

from __future__ import annotations

import os
import random
import sys
from pathlib import Path

import pytest

from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from tests.drivers.ptp.benches import IMAGE_PX, picture
from tests.guest import machine

TIMEOUT_S = 300.0
OBJECT_BYTES = 3_000_000
# An emulated processor takes 20 s to import hypothesis, and to compile what it could interpret.
QUICKLY = ("PYTEST_DISABLE_PLUGIN_AUTOLOAD=1", "NUMBA_DISABLE_JIT=1")


@pytest.fixture(scope="module")
def parts() -> machine.Parts:
    try:
        return machine.find_parts()
    except machine.PartsMissingError as error:
        if os.environ.get("CI") == "true":
            raise
        pytest.skip(str(error))


@pytest.mark.guest
def test_camera_and_driver_on_a_real_usb_stack(parts: machine.Parts, tmp_path: Path) -> None:
    served = tmp_path / "mtp" / "object.bin"
    served.parent.mkdir()
    served.write_bytes(random.Random(0).randbytes(OBJECT_BYTES))
    devices = ["-device", "qemu-xhci", "-device", f"usb-mtp,rootdir={served.parent}"]
    command = ["env", *QUICKLY, sys.executable, "-m", "pytest", "-o", "addopts="]
    command += ["-p", "no:cacheprovider", "tests/guest/inside/usb_checks.py"]
    outcome = machine.run(parts, command, tmp_path, TIMEOUT_S, devices)
    assert outcome.status == 0, outcome.log
    downloaded = (tmp_path / "gphoto2.dng").read_bytes()
    assert downloaded == picture(CameraSettings(0.1, 8.0, 200))[0]  # as the body starts
    assert decode_raw(downloaded).values.shape == (*IMAGE_PX, 3)
