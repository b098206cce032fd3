"""The driver and the simulated camera on a real Linux USB stack, in a virtual machine."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from types import ModuleType

import cv2
import numpy as np
import pytest

from acquire.session import Session
from acquire.session.verification import problems
from drivers.protocols import CameraSettings, Raster
from drivers.raw import decode_raw
from drivers.sim.dng import BLACK_LEVEL, WHITE_LEVEL
from tests.guest.inside import gphoto2_checks, qemu_checks, session_checks, usb_checks
from tests.guest.rendering import AT_START, SET, bench, white
from tests.guest.visit import Visit, visit_once

pytestmark = pytest.mark.guest
STEP = 1 / (WHITE_LEVEL - BLACK_LEVEL)
# A JPEG of quality 95 keeps a smooth picture's shades to a few of 255 in the mean.
JPEG_STEPS = 4.0


@pytest.fixture(scope="session")
def visit(tmp_path_factory: pytest.TempPathFactory) -> Visit:
    return visit_once(tmp_path_factory)


def checks(*modules: ModuleType) -> Iterator[str]:
    for module in modules:
        file = (module.__file__ or "").rpartition("/")[2]
        for name, _ in inspect.getmembers(module, inspect.isfunction):
            if name.startswith("test_"):
                yield f"{file}::{name}"


@pytest.mark.parametrize(
    "check", [*checks(usb_checks, gphoto2_checks, qemu_checks, session_checks)]
)
def test_in_the_machine(visit: Visit, check: str) -> None:
    reports = visit.reports.get(check, [])
    failed = [f"{each['check']} ({each['when']})\n{each['text']}" for each in reports
              if each["outcome"] != "passed"]  # fmt: skip
    assert not failed, "\n\n".join(failed)
    ended = [each for each in reports if each["when"] == "teardown"]
    assert ended, f"{check} did not end in the machine, which said:\n{visit.log}"


def test_the_machine_ends_well(visit: Visit) -> None:
    assert visit.status == 0, visit.log


def light(raster: Raster, settings: CameraSettings) -> np.ndarray:
    """What a noise-free camera sees of the scene, (height, width, 3), linear."""
    return np.clip(sum(bench().components(raster, settings).values()), 0, 1)


@pytest.mark.parametrize(
    ("file", "settings"),
    [
        pytest.param("start.dng", AT_START, id="as the body starts"),
        pytest.param("set.dng", SET, id="as gphoto2 set it"),
    ],
)
def test_what_gphoto2_downloads_is_the_scene(
    visit: Visit, file: str, settings: CameraSettings
) -> None:
    image = decode_raw((visit.folder / file).read_bytes())
    expected = light(white(), settings)
    assert expected.max() > 0.1
    assert np.abs(image.values - expected).max() <= STEP


def test_what_gphoto2_previews_is_the_scene(visit: Visit) -> None:
    picture = cv2.imread(str(visit.folder / "preview.jpg"))
    assert picture is not None
    expected = 255 * light(white(), AT_START)[..., ::-1] ** (1 / 2.2)
    assert picture.shape == expected.shape
    assert expected.std() > 10 * JPEG_STEPS
    assert np.abs(picture - expected).mean() <= JPEG_STEPS


@pytest.mark.parametrize("name", ["stall@1009+2", "cut-object+2", "put-back", "stayed-out"])
def test_a_session_over_usb_is_sound(visit: Visit, name: str) -> None:
    session = Session.open(visit.folder / "sessions" / name)
    assert session.complete
    assert [problem for problem in problems(session) if problem] == []
    for frame in session.frames:
        assert frame.settings is not None
        expected = light(frame.pattern.raster(session_checks.PROJECTOR_PX), frame.settings)
        assert np.abs(decode_raw(session.read(frame)).values - expected).max() <= STEP
