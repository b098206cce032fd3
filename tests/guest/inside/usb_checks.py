"""The driver and the simulated camera on a real USB stack: the kernel and libusb between."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import threading
from pathlib import Path

import pytest

from drivers.errors import CameraError, CameraTimeoutError
from drivers.protocols import CameraSettings
from drivers.ptp.discovery import list_cameras, open_camera
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.usb_gadget import UsbGadget
from tests.guest.inside.conftest import camera
from tests.guest.inside.rendered_scene import RenderedScene
from tests.guest.inside.reporting import EXCHANGE

SETTINGS = CameraSettings(exposure_s=0.02, aperture=8.0, iso=200)
NOBODY = 65534
JPEG = b"\xff\xd8\xff" + bytes(100_000) + b"\xff\xd9"
SERIAL = "0002049001"


def test_it_is_listed_and_captures(place: str, scene: RenderedScene) -> None:
    found = next(each for each in list_cameras() if each.address == place)
    assert (found.name, found.serial_number) == ("NIKON DSC D4S", SERIAL)
    with open_camera(place) as driver:
        assert driver.device.model == "D4S"
        for _ in range(2):
            assert driver.capture(SETTINGS).data == scene.shoot(SETTINGS)[0]


def test_live_view(gadget: UsbGadget, place: str) -> None:
    gadget.responder = Responder(lambda _: (JPEG, "image/jpeg"))
    with open_camera(place) as driver:
        frames = driver.live_view()
        assert [next(frames) for _ in range(3)] == [JPEG] * 3
        frames.close()


@pytest.mark.parametrize("wrong", ["stall@1009", "cut-object", "stale-answer@1009", "lost-event"])
def test_faults_of_which_the_program_need_not_know(
    gadget: UsbGadget, place: str, wrong: str, scene: RenderedScene
) -> None:
    gadget.responder = camera(scene, wrong)
    with open_camera(place) as driver:
        assert driver.capture(SETTINGS).data == scene.shoot(SETTINGS)[0]


@pytest.mark.parametrize("wrong", ["garbage@1009", "sleep@9207"])
def test_after_a_lost_shot_the_next_try_succeeds(
    gadget: UsbGadget, place: str, wrong: str, scene: RenderedScene
) -> None:
    gadget.responder = camera(scene, wrong)
    with open_camera(place) as driver:
        with pytest.raises(CameraTimeoutError):
            driver.capture(SETTINGS)
        assert driver.capture(SETTINGS).data == scene.shoot(SETTINGS)[0]


def test_a_cable_that_is_pulled_in_mid_transfer_and_put_back(
    gadget: UsbGadget, scene: RenderedScene
) -> None:
    gadget.responder = camera(scene, "unplug@1009")
    with open_camera(SERIAL) as driver:
        back = threading.Timer(2.0, gadget.plug_in)
        back.start()
        assert driver.capture(SETTINGS).data == scene.shoot(SETTINGS)[0]
        back.join()


def test_a_cable_that_stays_out(gadget: UsbGadget, scene: RenderedScene) -> None:
    gadget.responder = camera(scene, "unplug@1009")
    with open_camera(SERIAL) as driver, pytest.raises(CameraError, match="did not come back"):
        driver.capture(SETTINGS)
    gadget.plug_in()


def test_a_program_that_was_killed_in_mid_transfer_leaves_nothing_behind(
    place: str, scene: RenderedScene
) -> None:
    ready, tell = os.pipe()
    victim = os.fork()
    if not victim:
        driver = open_camera(place)
        while True:
            driver.capture(SETTINGS)
            os.write(tell, b".")
    assert os.read(ready, 1) == b"."
    os.kill(victim, signal.SIGKILL)
    os.waitpid(victim, 0)
    with open_camera(place) as driver:
        assert driver.capture(SETTINGS).data == scene.shoot(SETTINGS)[0]


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
