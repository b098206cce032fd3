"""gphoto2, which this project did not write, as the host of the simulated camera."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import pytest

from drivers.image import LinearImage
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.devices import SimulationConfig
from drivers.sim.ptp_responder.body import Body, d4s, plain
from drivers.sim.ptp_responder.darkroom import Darkroom
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.scenery import simulated_scene
from drivers.sim.ptp_responder.server import PtpIpServer
from drivers.sim.ptp_responder.source import ImageSource

TIMEOUT_S = 60
Gphoto2: TypeAlias = Callable[..., str]


@pytest.fixture(autouse=True, scope="module")
def _installed() -> None:
    if shutil.which("gphoto2") is None:
        if os.environ.get("CI") == "true":
            pytest.fail("gphoto2 is not installed; apt-get install gphoto2")
        pytest.skip("gphoto2 is not installed; apt-get install gphoto2 to run these tests")


@pytest.fixture(scope="module")
def source() -> ImageSource:
    return simulated_scene(SimulationConfig(camera_px=(24, 32), projector_px=(72, 96)))


@pytest.fixture
def gphoto2(
    tmp_path: Path, request: pytest.FixtureRequest, source: ImageSource
) -> Iterator[Gphoto2]:
    """Run gphoto2 in `tmp_path` against a camera; its output."""
    body, misbehaviours = getattr(request, "param", (d4s, ()))
    with PtpIpServer(camera(source, body(), misbehaviours)) as server:
        host, port = server.address

        def run(*arguments: str) -> str:
            # gphoto2 calls for events at 15740 unless it is told the second port as well. Its
            # environment is bare: the wheel of the same name leaves the way to its own libraries.
            done = subprocess.run(
                ["gphoto2", "--port", f"ptpip:{host}:{port}:{port}", *arguments],
                cwd=tmp_path,
                env={"PATH": os.environ["PATH"], "HOME": str(tmp_path), "LC_ALL": "C"},
                capture_output=True,
                text=True,
                timeout=TIMEOUT_S,
                check=False,
            )
            assert done.returncode == 0, done.stdout + done.stderr
            assert "*** Error" not in done.stdout + done.stderr
            return done.stdout

        yield run


def camera(source: ImageSource, body: Body, misbehaviours: tuple[str, ...]) -> Responder:
    wrong = [Misbehaviour.parse(text) for text in misbehaviours]
    return Responder(source, body, wrong, developer=Darkroom())


def scene(source: ImageSource, settings: CameraSettings) -> LinearImage:
    return decode_raw(source(settings)[0])


def current(output: str) -> list[str]:
    return re.findall(r"^Current: (.*)$", output, re.MULTILINE)


def test_summary(gphoto2: Gphoto2) -> None:
    output = gphoto2("--summary")
    assert "Manufacturer: Nikon Corporation" in output
    assert "Model: D4S" in output
    assert "Nikon Capture 1, Nikon Capture 2, Nikon Capture 3" in output
    assert "Free Space (Images): 999" in output
    assert re.search(r"F-Number\(0x5007\):\(readwrite\) .* value: f/8", output)


def test_list_config(gphoto2: Gphoto2) -> None:
    output = gphoto2("--list-config")
    for name in ("iso", "imagequality", "f-number", "shutterspeed", "capturetarget", "focusmode"):
        assert re.search(rf"^/main/\w+/{name}$", output, re.MULTILINE), name


def test_set_config_and_capture(gphoto2: Gphoto2, tmp_path: Path, source: ImageSource) -> None:
    gphoto2("--set-config", "iso=400")
    gphoto2("--set-config", "f-number=f/5.6")
    gphoto2("--set-config", "shutterspeed=0.0125s")
    values = current(
        gphoto2("--get-config=iso", "--get-config=f-number", "--get-config=shutterspeed")
    )
    assert values == ["400", "f/5.6", "0.0125s"]
    gphoto2("--capture-image-and-download")
    taken = decode_raw((tmp_path / "capt0000.nef").read_bytes())
    expected = scene(source, CameraSettings(1 / 80, 5.6, 400))
    np.testing.assert_array_equal(taken.values, expected.values)
    assert expected.values.max() > 0.3


def test_capture_to_the_card(gphoto2: Gphoto2, tmp_path: Path, source: ImageSource) -> None:
    output = gphoto2("--set-config", "capturetarget=1", "--capture-image-and-download")
    assert "/store_00010001/DCIM/100ND4S/DSC_0001.NEF" in output
    taken = decode_raw((tmp_path / "DSC_0001.NEF").read_bytes())
    expected = scene(source, CameraSettings(0.1, 8.0, 200))
    np.testing.assert_array_equal(taken.values, expected.values)


def test_capture_of_a_pair_keep_and_list(gphoto2: Gphoto2, tmp_path: Path) -> None:
    gphoto2(
        *("--set-config", "capturetarget=1", "--set-config", "imagequality=6", "--keep"),
        "--capture-image-and-download",
    )
    assert decode_raw((tmp_path / "DSC_0001.NEF").read_bytes()).values.shape == (24, 32, 3)
    picture = cv2.imread(str(tmp_path / "DSC_0002.JPG"))
    assert picture is not None
    assert picture.shape == (24, 32, 3)
    output = gphoto2("--list-files")
    assert re.search(r"#1 +DSC_0001.NEF", output)
    assert re.search(r"#2 +DSC_0002.JPG", output)
    gphoto2("--get-all-thumbnails")
    gphoto2("--delete-all-files", "--recurse")
    assert "DSC_" not in gphoto2("--list-files")


def test_capture_of_a_pair_to_memory(gphoto2: Gphoto2, tmp_path: Path, source: ImageSource) -> None:
    gphoto2("--set-config", "imagequality=6", "--capture-image-and-download")
    taken = decode_raw((tmp_path / "capt0000.nef").read_bytes())
    expected = scene(source, CameraSettings(0.1, 8.0, 200))
    np.testing.assert_array_equal(taken.values, expected.values)
    picture = cv2.imread(str(tmp_path / "capt0001.jpg"))
    assert picture is not None
    assert picture.shape == (24, 32, 3)


def test_capture_preview(gphoto2: Gphoto2, tmp_path: Path) -> None:
    gphoto2("--capture-preview")
    picture = cv2.imread(str(tmp_path / "capture_preview.jpg"))
    assert picture is not None
    assert picture.shape == (24, 32, 3)
    assert picture.max() > 100


@pytest.mark.parametrize("gphoto2", [(plain, ())], indirect=True, ids=["plain"])
def test_capture_without_a_makers_extension(
    gphoto2: Gphoto2, tmp_path: Path, source: ImageSource
) -> None:
    gphoto2("--capture-image-and-download")
    (file,) = tmp_path.glob("DSC_*")
    expected = scene(source, CameraSettings(0.1, 8.0, 200))
    np.testing.assert_array_equal(decode_raw(file.read_bytes()).values, expected.values)


@pytest.mark.parametrize(
    "gphoto2",
    [(d4s, (text,)) for text in ("completion-first", "odd-event")],
    indirect=True,
    ids=["completion first", "odd events"],
)
def test_capture_although_the_camera_misbehaves(gphoto2: Gphoto2, tmp_path: Path) -> None:
    gphoto2("--capture-image-and-download")
    assert decode_raw((tmp_path / "capt0000.nef").read_bytes()).values.shape == (24, 32, 3)
