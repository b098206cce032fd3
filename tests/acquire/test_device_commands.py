from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from acquire.bench_file import LabBench, read_bench
from acquire.errors import BenchError
from drivers.raw import decode_raw
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.scenery import simulated_scene
from drivers.sim.ptp_responder.server import PtpIpServer


def test_a_simulated_camera_says_where_it_listens_once_it_does() -> None:
    words = [sys.executable, "-m", "acquire", "camera", "simulate", "--ptpip", "127.0.0.1:0"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            found = re.search(r"127\.0\.0\.1:(\d+)", process.stderr.readline())
            assert found is not None
            with socket.create_connection(("127.0.0.1", int(found[1])), timeout=1):
                pass
        finally:
            process.terminate()


@pytest.fixture
def camera() -> Iterator[str]:
    with PtpIpServer(Responder(simulated_scene())) as server:
        yield f"ptpip:127.0.0.1:{server.address[1]}"


def lumisplit(*words: str) -> subprocess.CompletedProcess[str]:
    """Run as on a computer without a display."""
    environment = {key: value for key, value in os.environ.items() if "DISPLAY" not in key}
    return subprocess.run(
        [sys.executable, "-m", "acquire", *words],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
    )


def test_a_frame_from_a_camera_on_the_network(camera: str, tmp_path: Path) -> None:
    out = tmp_path / "x.dng"
    words = ["camera", "shoot", "--camera", camera, "--out", str(out)]
    done = lumisplit(*words, "--exposure", "1/10", "--aperture", "8", "--iso", "200")
    assert done.returncode == 0, done.stderr
    assert "0.1 s, f/8, ISO 200" in done.stdout
    assert decode_raw(out.read_bytes()).values.max() == pytest.approx(0.8, abs=0.01)
    again = lumisplit(*words)
    assert again.returncode == 1
    assert "exists" in again.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        pytest.param(["--iso", "217"], "200", id="nearest value is named"),
        pytest.param(["--exposure", "a"], "1/10 or 0.1", id="no time"),
        pytest.param(["--exposure", "1/0"], "1/10 or 0.1", id="division by zero"),
    ],
)
def test_settings_that_the_camera_lacks(
    camera: str, tmp_path: Path, words: list[str], said: str
) -> None:
    done = lumisplit("camera", "shoot", "--camera", camera, "--out", str(tmp_path / "x"), *words)
    assert done.returncode == 1
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        pytest.param(["projector", "list"], "DISPLAY", id="list"),
        pytest.param(["projector", "show", "white", "--seconds", "1"], "DISPLAY", id="show"),
        pytest.param(["projector", "show", "dots"], "is no pattern", id="no pattern"),
        pytest.param(["camera", "shoot", "--out", "x"], "no camera|libusb", id="no camera"),
        pytest.param(
            ["camera", "shoot", "--out", "x", "--camera", "ptpip:127.0.0.1:9"],
            "127.0.0.1",
            id="nobody listens",
        ),
        pytest.param(["camera", "simulate", "--ptpip", "here"], "HOST:PORT", id="no address"),
        pytest.param(
            ["camera", "simulate", "--misbehave", "sing"], "lost-event", id="no misbehaviour"
        ),
        pytest.param(["plan", "--example", "--bench", "lab"], "", id="example needs no bench"),
    ],
)
def test_without_devices_there_is_one_message(words: list[str], said: str) -> None:
    done = lumisplit(*words)
    assert "Traceback" not in done.stderr
    assert any(part in done.stderr for part in said.split("|"))
    assert (done.returncode == 0) is (said == "")


def test_doctor_without_a_display_says_so_and_changes_nothing(tmp_path: Path) -> None:
    done = lumisplit("doctor", "--json", "--write-bench", str(tmp_path / "bench.toml"))
    findings = {finding["subject"]: finding for finding in json.loads(done.stdout)}
    assert done.returncode == 1
    assert findings["display"]["verdict"] == "bad"
    assert "DISPLAY" in findings["display"]["text"]
    assert {"OpenGL", "disk"} <= set(findings)
    assert isinstance(read_bench(tmp_path / "bench.toml"), LabBench)


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        pytest.param('kind = "lab"\n[camera]\nadress = "x"', ["lab.camera.adress"], id="key"),
        pytest.param('kind = "lab"\n[lamp]\nport = "p"', ["lab.lamp.commands"], id="no commands"),
        pytest.param('kind = "lab"\n[folder]\npath = "x"', ["trigger_port"], id="no trigger"),
        pytest.param(
            'kind = "lab"\n[lamp]\nport = "p"\ncommands = "sony"', ["benq"], id="command set"
        ),
    ],
)
def test_lab_files_that_cannot_be_used(tmp_path: Path, content: str, parts: list[str]) -> None:
    (tmp_path / "bench.toml").write_text(content)
    with pytest.raises(BenchError) as refusal:
        read_bench(tmp_path / "bench.toml")
    assert all(part in str(refusal.value) for part in parts)
