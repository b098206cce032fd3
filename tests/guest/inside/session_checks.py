"""Sessions whose cable is pulled in mid-capture: the sequencer, a real USB stack, lit rasters.

Their folders are verified outside.
"""

from __future__ import annotations

import shutil
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest

from acquire.plan import Step
from acquire.plan_file import read_plan
from acquire.recording import record
from acquire.rig import Bench, Resumption
from acquire.rig.bench import closed_with
from acquire.sequencer import Outcome
from acquire.session import Session
from drivers.clock import SystemClock
from drivers.errors import CameraError
from drivers.protocols import Devices
from drivers.ptp.discovery import open_camera
from drivers.sim.usb_gadget import UsbGadget
from tests.guest.inside.conftest import GADGET, address_of, camera
from tests.guest.inside.rendered_scene import MemoryProjector, RenderedScene
from tests.guest.inside.reporting import EXCHANGE

PROJECTOR_PX = (72, 96)
SERIAL = "0002049001"
PLUGGED_BACK_S = 1.5
FRAME_BYTES = 10_000


@dataclass
class Notes:
    """An observer that remembers."""

    steps: list[int] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def frame_kept(self, step: Step, total: int) -> None:
        assert step.index < total
        self.steps.append(step.index)

    def warning(self, message: str) -> None:
        self.warnings.append(message)


def connect(scene: RenderedScene, _: Resumption, closing: ExitStack) -> Devices:
    driver = open_camera(SERIAL)
    return closed_with(
        Devices(MemoryProjector(scene, PROJECTOR_PX), driver, SystemClock()), closing
    )


def captured(scene: RenderedScene, folder: Path) -> tuple[Session, Outcome]:
    """Capture the plan over USB, or go on with it."""
    bench = Bench(
        "the gadget",
        {"kind": "usb", "camera": SERIAL},
        PROJECTOR_PX,
        FRAME_BYTES,
        0.0,
        partial(connect, scene),
    )
    return record(read_plan(EXCHANGE / "plan.toml"), bench, folder, Notes(), threading.Event())


def put_back(gadget: UsbGadget) -> None:
    """Wait until the cable is out, and a little; then plug it in."""
    while gadget.is_plugged_in:
        time.sleep(0.05)
    time.sleep(PLUGGED_BACK_S)
    gadget.plug_in()


@pytest.mark.parametrize("wrong", ["stall@1009+2", "cut-object+2"])
def test_a_camera_that_fails_in_mid_capture_loses_no_frame(
    gadget: UsbGadget, scene: RenderedScene, tmp_path: Path, wrong: str
) -> None:
    gadget.responder = camera(scene, wrong)
    session, outcome = captured(scene, tmp_path / "s")
    assert (outcome, session.complete) == (Outcome.COMPLETE, True)
    shutil.copytree(tmp_path / "s", EXCHANGE / "sessions" / wrong)


def test_a_cable_that_is_pulled_and_put_back_loses_no_frame(
    gadget: UsbGadget, scene: RenderedScene, tmp_path: Path
) -> None:
    gadget.responder = camera(scene, "unplug@1009+2")
    hand = threading.Thread(target=put_back, args=(gadget,), daemon=True)
    hand.start()
    session, outcome = captured(scene, tmp_path / "s")
    hand.join(PLUGGED_BACK_S)
    assert not hand.is_alive()
    assert (outcome, session.complete) == (Outcome.COMPLETE, True)
    shutil.copytree(tmp_path / "s", EXCHANGE / "sessions" / "put-back")


def test_a_cable_that_stays_out_ends_the_session_and_the_next_goes_on(
    gadget: UsbGadget, scene: RenderedScene, tmp_path: Path
) -> None:
    gadget.responder = camera(scene, "unplug@1009+2")
    with pytest.raises(CameraError, match="did not come back"):
        captured(scene, tmp_path / "s")
    assert len(Session.open(tmp_path / "s").frames) == 2
    gadget.responder = camera(scene)
    gadget.plug_in()
    address_of(GADGET)
    session, outcome = captured(scene, tmp_path / "s")
    assert (outcome, session.complete) == (Outcome.COMPLETE, True)
    shutil.copytree(tmp_path / "s", EXCHANGE / "sessions" / "stayed-out")
