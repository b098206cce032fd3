"""gphoto2 before the simulated camera, on a real USB stack; its files are looked at outside."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

from tests.guest.inside.reporting import EXCHANGE

LIMIT_S = 60


def drivers(home: Path) -> dict[str, str]:
    """Where gphoto2 finds the driver that speaks PTP alone, if it can be told.

    Loading those of all makers takes an emulated processor longer than what is asked of this one.
    """
    for driver in Path("/usr/lib").glob("*/libgphoto2/*/ptp2.so"):
        folder = home / "drivers"
        folder.mkdir(exist_ok=True)
        shutil.copy(driver, folder)
        return {"CAMLIBS": str(folder)}
    return {}


def gphoto2(home: Path, place: str, *arguments: str) -> str:
    """What gphoto2 prints, with a new home as it remembers settings there."""
    command = ["gphoto2", "--port", place, *arguments]
    environment = {"PATH": os.environ["PATH"], "HOME": str(home), "LC_ALL": "C", **drivers(home)}
    ended = subprocess.run(
        command, check=False, env=environment, cwd=home, text=True, capture_output=True,
        timeout=LIMIT_S,
    )  # fmt: skip
    said = f"{' '.join(command)}\nstatus {ended.returncode}\n{ended.stdout}{ended.stderr}"
    assert ended.returncode == 0, said
    assert "*** Error" not in said, said
    return ended.stdout


def test_summary_and_list_config(place: str, tmp_path: Path) -> None:
    told = gphoto2(tmp_path, place, "--summary", "--list-config")
    assert "Manufacturer: Nikon Corporation" in told, told
    assert "Model: D4S" in told, told
    assert re.search(r"F-Number\(0x5007\):\(readwrite\) .* value: f/8", told), told
    for name in ("iso", "imagequality", "f-number", "shutterspeed", "capturetarget", "focusmode"):
        assert re.search(rf"^/main/\w+/{name}$", told, re.MULTILINE), (name, told)


def test_set_config_is_read_back_and_exposes(place: str, tmp_path: Path) -> None:
    wanted = {"iso": "400", "f-number": "f/5.6", "shutterspeed": "0.0125s"}
    settings = [word for name in wanted for word in ("--set-config", f"{name}={wanted[name]}")]
    gphoto2(tmp_path, place, *settings)
    told = gphoto2(tmp_path, place, *(f"--get-config={name}" for name in wanted))
    assert re.findall(r"^Current: (.*)$", told, re.MULTILINE) == list(wanted.values()), told
    gphoto2(tmp_path, place, "--capture-image-and-download", f"--filename={EXCHANGE}/set.dng")


def test_capture_image_and_download(place: str, tmp_path: Path) -> None:
    gphoto2(tmp_path, place, "--capture-image-and-download", f"--filename={EXCHANGE}/start.dng")


def test_capture_preview(place: str, tmp_path: Path) -> None:
    told = gphoto2(tmp_path, place, "--capture-preview")
    preview = tmp_path / "capture_preview.jpg"
    assert preview.exists(), told
    shutil.copy(preview, EXCHANGE / "preview.jpg")
