"""What is true on a real USB stack: run by `tests.guest.test_usb_stack`, inside its machine.

The simulated camera is a gadget; the driver, libusb and gphoto2 reach it through the kernel.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.errors import CameraError, CameraTimeoutError
from drivers.protocols import CameraSettings
from drivers.ptp.discovery import list_cameras, open_camera
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.usb_gadget import UsbGadget, plugged_in
from tests.drivers.ptp.benches import picture

EXCHANGE = Path("/mnt")
SETTINGS = CameraSettings(exposure_s=0.02, aperture=8.0, iso=200)
ENUMERATION_S = 10.0
NOBODY = 65534
JPEG = b"\xff\xd8\xff" + bytes(100_000) + b"\xff\xd9"
SERIAL = "0002049001"
GADGET, QEMU = "04b0:0435", "46f4:0004"


@pytest.fixture(scope="module")
def gadget() -> Iterator[UsbGadget]:
    with plugged_in(Responder(picture)) as gadget:
        yield gadget


@pytest.fixture
def place(gadget: UsbGadget) -> Iterator[str]:
    gadget.responder = Responder(picture)
    yield address_of(GADGET)
    assert not gadget.responder.is_open
    assert not gadget.responder.is_remote


def address_of(ids: str) -> str:
    """Where a device is, once the kernel has found it."""
    until_s = time.monotonic() + ENUMERATION_S
    while time.monotonic() < until_s:
        for camera in list_cameras():
            if f"{camera.vendor:04x}:{camera.product:04x}" == ids:
                return camera.address
        time.sleep(0.1)
    raise AssertionError(f"no device {ids} on the bus")


def misbehave(gadget: UsbGadget, *texts: str) -> None:
    gadget.responder = Responder(picture, None, [Misbehaviour.parse(text) for text in texts])


def gphoto2(home: Path, place: str, *arguments: str) -> str:
    """Run gphoto2, which remembers settings in its home, on the gadget."""
    ended = subprocess.run(
        ["gphoto2", "--port", place, *arguments], check=False,
        env={**os.environ, "HOME": str(home)}, cwd=home, text=True, capture_output=True, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_it_is_listed_and_captures(place: str) -> None:
    found = next(camera for camera in list_cameras() if camera.address == place)
    assert (found.name, found.serial_number) == ("NIKON DSC D4S", SERIAL)
    with open_camera(place) as camera:
        assert camera.device.model == "D4S"
        for _ in range(2):
            assert camera.capture(SETTINGS).data == picture(SETTINGS)[0]


def test_live_view(gadget: UsbGadget, place: str) -> None:
    gadget.responder = Responder(lambda _: (JPEG, "image/jpeg"))
    with open_camera(place) as camera:
        frames = camera.live_view()
        assert [next(frames) for _ in range(3)] == [JPEG] * 3
        frames.close()


@pytest.mark.parametrize("wrong", ["stall@1009", "cut-object", "stale-answer@1009", "lost-event"])
def test_faults_of_which_the_program_need_not_know(
    gadget: UsbGadget, place: str, wrong: str
) -> None:
    misbehave(gadget, wrong)
    with open_camera(place) as camera:
        assert camera.capture(SETTINGS).data == picture(SETTINGS)[0]


@pytest.mark.parametrize("wrong", ["garbage@1009", "sleep@9207"])
def test_after_a_lost_shot_the_next_try_succeeds(gadget: UsbGadget, place: str, wrong: str) -> None:
    misbehave(gadget, wrong)
    with open_camera(place) as camera:
        with pytest.raises(CameraTimeoutError):
            camera.capture(SETTINGS)
        assert camera.capture(SETTINGS).data == picture(SETTINGS)[0]


def test_a_cable_that_is_pulled_in_mid_transfer_and_put_back(gadget: UsbGadget) -> None:
    misbehave(gadget, "unplug@1009")
    with open_camera(SERIAL) as camera:
        back = threading.Timer(2.0, gadget.plug_in)
        back.start()
        assert camera.capture(SETTINGS).data == picture(SETTINGS)[0]
        back.join()


def test_a_cable_that_stays_out(gadget: UsbGadget) -> None:
    misbehave(gadget, "unplug@1009")
    with open_camera(SERIAL) as camera, pytest.raises(CameraError, match="did not come back"):
        camera.capture(SETTINGS)
    gadget.plug_in()


def test_a_program_that_was_killed_in_mid_transfer_leaves_nothing_behind(place: str) -> None:
    ready, tell = os.pipe()
    victim = os.fork()
    if not victim:
        camera = open_camera(place)
        while True:
            camera.capture(SETTINGS)
            os.write(tell, b".")
    assert os.read(ready, 1) == b"."
    os.kill(victim, signal.SIGKILL)
    os.waitpid(victim, 0)
    with open_camera(place) as camera:
        assert camera.capture(SETTINGS).data == picture(SETTINGS)[0]


def test_who_holds_the_camera_is_named(place: str) -> None:
    holder = shutil.copy(shutil.which("sleep") or "", EXCHANGE / "gvfsd-gphoto2")
    bus, device = place.removeprefix("usb:").split(",")
    with open_camera(place), Path(f"/dev/bus/usb/{bus}/{device}").open("rb") as file:
        process = subprocess.Popen([holder, "60"], stdin=file)
        with pytest.raises(CameraError, match=r"gvfsd-gphoto2.*systemctl --user stop"):
            open_camera(place)
        process.kill()
        process.wait()


def test_without_permission_the_udev_rule_is_printed(place: str) -> None:
    child = os.fork()
    if not child:
        os.setuid(NOBODY)
        try:
            open_camera(place)
        except CameraError as error:
            os._exit(0 if 'ATTR{idVendor}=="04b0"' in str(error) else 1)
        os._exit(2)
    assert os.waitpid(child, 0)[1] == 0


def test_gphoto2_knows_it_and_captures(place: str, tmp_path: Path) -> None:
    name = EXCHANGE / "gphoto2.dng"
    told = gphoto2(
        tmp_path, place, "--summary", "--capture-image-and-download", f"--filename={name}"
    )
    assert "Model: D4S" in told
    assert name.stat().st_size


def test_the_responder_of_qemu_is_listed_and_read_and_refuses_to_capture() -> None:
    with open_camera(address_of(QEMU)) as camera:
        assert "QEMU" in camera.device.manufacturer
        (handle, about), *others = camera.pictures()
        assert (about.filename, others) == ("object.bin", [])
        assert camera.fetch(handle).data == (EXCHANGE / "mtp" / "object.bin").read_bytes()
        with pytest.raises(CameraError, match="takes no pictures for a computer"):
            camera.capture(CameraSettings(0.1))
