"""The camera's contract, held by a folder camera that a shutter box triggers."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from drivers.folder_camera import FolderCamera
from drivers.protocols import CameraSettings
from drivers.trigger import TriggerBox
from tests.contracts.benches import CONFIG, SETTINGS, CameraCase, lit_bench
from tests.contracts.test_camera import *  # noqa: F403 - run here with the `case` below
from tests.drivers.serial_device import Device, connected
from tests.firmware.box import PATIENCE_S, behind_a_line, compile_sketch


@pytest.fixture(scope="module")
def sketch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compile_sketch(tmp_path_factory.mktemp("box"))


@pytest.fixture  # type: ignore[no-redef]  # in place of the table's devices
def case(sketch: Path, tmp_path: Path) -> Iterator[CameraCase]:
    """A simulated camera that writes into a folder whenever the box releases its shutter."""
    bench = lit_bench()
    folder, numbers = tmp_path / "frames", count(1)
    folder.mkdir()
    with behind_a_line(sketch, tmp_path / "log") as relay, connected(Device(relay, b"\n")) as line:
        box = TriggerBox(line.port, 0.01, PATIENCE_S, PATIENCE_S)

        def release() -> None:
            box.fire()
            frame = bench.camera.capture(SETTINGS)
            (folder / f"DSC_{next(numbers):04}.DNG").write_bytes(frame.data)

        refused = CameraSettings(exposure_s=0.2, aperture=8.0, iso=200)
        camera = FolderCamera(release, folder, SETTINGS, 5.0, 1.0, bench.clock)
        yield CameraCase(camera, bench.clock, SETTINGS, refused, CONFIG.camera_px)
        camera.close()
        box.close()
