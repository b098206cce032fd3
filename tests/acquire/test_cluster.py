"""Processing by a real scheduler and two worker processes on the loopback."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acquire.cli.main import app
from acquire.cluster import PARKED, connected
from acquire.errors import ResultError, StackError
from acquire.pipeline import Options, process
from acquire.session import Session
from tests.acquire.captures import captured, small_bench, small_plan

pytest.importorskip("distributed", reason="needs Dask: pip install lumisplit[cluster]")

ENVIRONMENT = {
    **os.environ,
    "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "10s",
    "DASK_DISTRIBUTED__WORKER__DAEMON": "False",
    "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
}


@dataclass
class Silent:
    units: int = 0

    def stage(self, name: str, total: int) -> None:
        pass

    def advance(self) -> None:
        self.units += 1


@dataclass(frozen=True)
class Machines:
    address: str
    workers: list[subprocess.Popen[bytes]]


def started(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]]
    with (folder / "log").open("ab") as log:
        return subprocess.Popen(command, env=ENVIRONMENT, cwd=folder, stdout=log, stderr=log)


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machines]:
    folder = tmp_path_factory.mktemp("cluster")
    contact = folder / "scheduler.json"
    local = ["--host", "127.0.0.1", "--no-dashboard"]
    scheduler = started(
        folder, "dask_scheduler", *local, "--port", "0", "--scheduler-file", str(contact)
    )
    workers = [
        started(
            folder, "dask_worker", *local, "--scheduler-file", str(contact), "--no-nanny",
            "--nthreads", "1", "--local-directory", str(folder),
        )
        for _ in range(2)
    ]  # fmt: skip
    try:
        until = time.monotonic() + 30
        while not contact.exists() and time.monotonic() < until:
            time.sleep(0.1)
        import json

        yield Machines(json.loads(contact.read_text())["address"], workers)
    finally:
        for one in (*workers, scheduler):
            one.kill()
            one.wait()


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Of a lamp that drifts, so that the frames are corrected."""
    text = (
        "[pattern]\npitch_px = [8, 12, 16, 24]\nshifts = [4, 2]\n[references]\nevery_frames = 16\n"
    )
    folder = tmp_path_factory.mktemp("captured") / "s"
    return captured(folder, small_plan(text), small_bench(full_well_e=20_000.0, drift=-0.1))[0]


def contents(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@pytest.mark.parametrize("method", ["ranges", "iva"])
def test_a_cluster_gives_the_same_bytes(
    tmp_path: Path, session: Session, machines: Machines, method: str
) -> None:
    process(session, tmp_path / "here", Options(method), Silent())
    observer = Silent()
    with connected(machines.address) as cluster:
        process(session, tmp_path / "there", Options(method), observer, cluster)
    assert contents(tmp_path / "here") == contents(tmp_path / "there")
    assert not (tmp_path / "there" / PARKED).exists()
    assert observer.units >= len(session.frames)


def test_one_call_processes_several_sessions(
    tmp_path: Path, session: Session, machines: Machines
) -> None:
    sessions = [tmp_path / name for name in ("one", "two")]
    for folder in sessions:
        shutil.copytree(session.folder, folder)
    words = ["process", *map(str, sessions), "--out", str(tmp_path / "there"), "--method", "iva"]
    run = CliRunner().invoke(app, [*words, "--scheduler", machines.address, "--quiet"])
    assert run.exit_code == 0, run.output
    for folder in sessions:
        process(Session.open(folder), tmp_path / "here", Options("iva"), Silent())
        there = contents(tmp_path / "there" / folder.name)
        assert there.pop("report.html")
        assert there == contents(tmp_path / "here")


def test_a_worker_that_is_killed_costs_only_its_tasks(
    tmp_path: Path, session: Session, machines: Machines
) -> None:
    """Stopped first, so that it holds a task for certain when it dies."""
    process(session, tmp_path / "here", Options("iva"), Silent())
    victim = machines.workers[0]
    victim.send_signal(signal.SIGSTOP)
    killing = threading.Timer(1.5, victim.kill)
    with connected(machines.address) as cluster:
        killing.start()
        process(session, tmp_path / "there", Options("iva"), Silent(), cluster)
    killing.join()
    assert victim.wait(120) == -signal.SIGKILL
    assert machines.workers[1].poll() is None
    assert contents(tmp_path / "here") == contents(tmp_path / "there")


@pytest.mark.parametrize(
    ("address", "words"),
    [
        pytest.param("127.0.0.1:port", "is no scheduler", id="no port"),
        pytest.param("http://127.0.0.1:80", "is no scheduler", id="no scheduler's scheme"),
        pytest.param("tcp://127.0.0.1:9", "No scheduler answers", id="nobody there"),
    ],
)
def test_no_scheduler_is_one_message(address: str, words: str) -> None:
    with pytest.raises(StackError, match=words), connected(address, wait_s=1.0):
        raise AssertionError


def test_results_of_sessions_of_one_name_do_not_replace_one_another(tmp_path: Path) -> None:
    from acquire.cli.processing import _jobs

    sessions = [tmp_path / "a" / "s", tmp_path / "b" / "s"]
    with pytest.raises(ResultError, match="'s'"):
        _jobs(sessions, tmp_path)
    assert _jobs(sessions[:1], tmp_path / "r") == [(sessions[0], tmp_path / "r")]
