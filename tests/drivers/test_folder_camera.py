from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.clock import SystemClock
from drivers.errors import CameraError, CameraTimeoutError, SerialError, SettingsError
from drivers.folder_camera import FolderCamera
from drivers.protocols import CameraSettings
from drivers.sim.clock import SimulatedClock

SETTINGS = CameraSettings(exposure_s=0.5, aperture=8.0, iso=200)
CUT_OFF = b"MM\x00*" + (9999).to_bytes(4) + bytes(500)  # its directory lies beyond its end
CR3 = b"\x00\x00\x00\x18ftypcrx " + bytes(range(256)) * 20
JPEG = b"\xff\xd8\xff\xe0" + bytes(1000)


def camera(folder: Path, trigger: Callable[[], None]) -> FolderCamera:
    return FolderCamera(trigger, folder, SETTINGS, 5.0, 1.0, SimulatedClock())


def delivering(folder: Path, *batches: dict[str, bytes]) -> Callable[[], None]:
    """A trigger after which the next of these batches of files is in the folder."""
    remaining = iter(batches)

    def trigger() -> None:
        for name, data in next(remaining).items():
            (folder / name).write_bytes(data)

    return trigger


@pytest.mark.parametrize(
    ("files", "data", "kind"),
    [
        pytest.param({"a.cr3": CR3}, CR3, "image/x-canon-cr3", id="raw"),
        pytest.param({"a.jpg": JPEG}, JPEG, "image/jpeg", id="JPEG alone"),
        pytest.param({"a.CR3": CR3, "A.jpg": JPEG}, CR3, "image/x-canon-cr3", id="pair"),
        pytest.param({"a.nef": CR3}, CR3, "image/x-canon-cr3", id="name lies"),
        pytest.param(
            {"a.cr3": CR3, ".a.cr3.x": b"", "b.part": b"half"},
            CR3,
            "image/x-canon-cr3",
            id="beside temporary files",
        ),
    ],
)
def test_the_new_file_is_the_frame(
    tmp_path: Path, files: dict[str, bytes], data: bytes, kind: str
) -> None:
    (tmp_path / "before.cr3").write_bytes(CR3[:100])
    frame = camera(tmp_path, delivering(tmp_path, files)).capture(SETTINGS)
    assert (frame.data, frame.media_type, frame.settings) == (data, kind, SETTINGS)
    assert (tmp_path / "before.cr3").read_bytes() == CR3[:100]


@pytest.mark.parametrize(
    ("files", "reason"),
    [
        pytest.param({"a.cr3": CR3, "b.cr3": CR3}, "2 files", id="two raws"),
        pytest.param({"a.cr3": CR3, "b.jpg": JPEG}, "2 files", id="no pair by name"),
        pytest.param({"a.jpg": JPEG, "a.jpeg": JPEG}, "2 files", id="two JPEGs"),
        pytest.param({"a.cr3": CR3, "a.cr2": CR3}, "2 files", id="two raws of a name"),
        pytest.param({f"{n}.cr3": CR3 for n in "abc"}, "3 files", id="burst"),
        pytest.param({"a.txt": b"hello"}, "no frame", id="no picture"),
        pytest.param({"a.nef": CUT_OFF}, "no frame", id="cut off"),
    ],
)
def test_anything_but_one_frame_is_refused(
    tmp_path: Path, files: dict[str, bytes], reason: str
) -> None:
    with pytest.raises(CameraError, match=reason):
        camera(tmp_path, delivering(tmp_path, files)).capture(SETTINGS)


@pytest.mark.parametrize(
    "files",
    [
        pytest.param({}, id="nothing"),
        pytest.param({"a.cr3": b""}, id="an empty file"),
        pytest.param({".a.cr3": CR3}, id="a hidden file"),
        pytest.param({"a.cr3.part": CR3}, id="an unfinished file"),
    ],
)
def test_no_file_is_worth_another_try(tmp_path: Path, files: dict[str, bytes]) -> None:
    device = camera(tmp_path, delivering(tmp_path, files, {"b.cr3": CR3}))
    with pytest.raises(CameraTimeoutError, match="release cable"):
        device.capture(SETTINGS)
    assert device.capture(SETTINGS).data == CR3


def test_a_file_is_taken_when_it_is_whole(tmp_path: Path) -> None:
    def deliver_slowly() -> None:
        with (tmp_path / "a.cr3").open("wb", buffering=0) as file:
            for start in range(0, len(CR3), 1024):
                file.write(CR3[start : start + 1024])
                time.sleep(0.1)
        (tmp_path / "a.jpg").write_bytes(JPEG)

    delivery = threading.Thread(target=deliver_slowly)
    device = FolderCamera(delivery.start, tmp_path, SETTINGS, 5.0, 0.3, SystemClock())
    frame = device.capture(SETTINGS)
    delivery.join()
    assert frame.data == CR3
    assert frame.finished_s - frame.started_s >= 0.5


def test_a_file_that_is_renamed_when_whole_is_taken(tmp_path: Path) -> None:
    def deliver() -> None:
        (tmp_path / "a.cr3.tmp").write_bytes(CR3)
        (tmp_path / "a.cr3.tmp").rename(tmp_path / "a.cr3")

    assert camera(tmp_path, deliver).capture(SETTINGS).data == CR3


def test_a_file_that_comes_between_two_frames_is_noticed(tmp_path: Path) -> None:
    device = camera(tmp_path, delivering(tmp_path, {"a.cr3": CR3}, {"b.cr3": CR3}))
    device.capture(SETTINGS)
    (tmp_path / "late.jpg").write_bytes(JPEG)
    with pytest.raises(CameraError, match=r"late\.jpg came"):
        device.capture(SETTINGS)


def test_other_settings_are_refused_before_the_shutter_is_released(tmp_path: Path) -> None:
    released = []
    device = camera(tmp_path, lambda: released.append(1))
    with pytest.raises(SettingsError, match=r"exposure_s=0\.5"):
        device.capture(CameraSettings(0.25, 8.0, 200))
    assert not released


def test_an_error_of_the_trigger_passes_through(tmp_path: Path) -> None:
    def trigger() -> None:
        raise SerialError("silent")

    with pytest.raises(SerialError, match="silent"):
        camera(tmp_path, trigger).capture(SETTINGS)


def test_a_folder_that_is_missing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="no folder"):
        camera(tmp_path / "absent", lambda: None)
    folder = tmp_path / "drive"
    folder.mkdir()
    device = camera(folder, folder.rmdir)
    with pytest.raises(CameraError, match="drive still connected"):
        device.capture(SETTINGS)


def test_folders_and_sockets_are_no_frames(tmp_path: Path) -> None:
    def trigger() -> None:
        (tmp_path / "DCIM").mkdir()
        os.mkfifo(tmp_path / "pipe")
        (tmp_path / "a.cr3").write_bytes(CR3)

    assert camera(tmp_path, trigger).capture(SETTINGS).data == CR3
