"""The simulated camera on the machine's bus."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from drivers.ptp.discovery import list_cameras
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.usb_gadget import UsbGadget, plugged_in
from tests.guest.inside.rendered_scene import RenderedScene
from tests.guest.inside.reporting import EXCHANGE

ENUMERATION_S = 10.0
GADGET, QEMU = "04b0:0435", "46f4:0004"


def camera(scene: RenderedScene, *wrong: str) -> Responder:
    """A simulated camera before the scene that does this wrong."""
    misbehaviours = [Misbehaviour.parse(text) for text in wrong]
    return Responder(scene.shoot, None, misbehaviours, developer=scene)


def address_of(ids: str) -> str:
    """Where a device is, once the kernel has found it."""
    until_s = time.monotonic() + ENUMERATION_S
    while time.monotonic() < until_s:
        for found in list_cameras():
            if f"{found.vendor:04x}:{found.product:04x}" == ids:
                return found.address
        time.sleep(0.1)
    raise AssertionError(f"no device {ids} on the bus")


@pytest.fixture(scope="session")
def scene() -> RenderedScene:
    return RenderedScene(EXCHANGE / "scene")


@pytest.fixture(scope="session")
def gadget(scene: RenderedScene) -> Iterator[UsbGadget]:
    with plugged_in(camera(scene)) as gadget:
        yield gadget


@pytest.fixture
def place(gadget: UsbGadget, scene: RenderedScene) -> Iterator[str]:
    gadget.responder = camera(scene)
    yield address_of(GADGET)
    assert not gadget.responder.is_open
    assert not gadget.responder.is_remote
