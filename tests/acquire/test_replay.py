from __future__ import annotations

from pathlib import Path

import pytest

from acquire.errors import BenchError, LumisplitError
from acquire.rig import find_bench
from acquire.session import Session
from drivers.errors import DriverError
from tests.acquire.captures import Notes, captured, recorded_bytes, small_bench, small_plan

WITH_REPEATS = "[pattern]\npitch_px = [8, 12]\nshifts = [4, 2]\n[references]\nevery_frames = 5\n"


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    captured(tmp_path / "first", small_plan(WITH_REPEATS), small_bench(full_well_e=20000.0))
    return tmp_path / "first"


def test_recapturing_a_recording_is_bit_identical(recorded: Path, tmp_path: Path) -> None:
    bench = find_bench(f"replay:{recorded}")
    captured(tmp_path / "again", small_plan(WITH_REPEATS), bench)
    assert recorded_bytes(tmp_path / "again") == recorded_bytes(recorded)


def test_a_replay_of_a_replay_too(recorded: Path, tmp_path: Path) -> None:
    for source, name in [(recorded, "second"), (tmp_path / "second", "third")]:
        captured(tmp_path / name, small_plan(WITH_REPEATS), find_bench(f"replay:{source}"))
    assert recorded_bytes(tmp_path / "third") == recorded_bytes(recorded)


def test_an_interrupted_replay_goes_on_with_the_right_repeats(
    recorded: Path, tmp_path: Path
) -> None:
    for index in range(len(Session.open(recorded).plan)):
        bench = find_bench(f"replay:{recorded}")
        captured(tmp_path / "pieces", small_plan(WITH_REPEATS), bench, Notes(stop_after=index))
    assert recorded_bytes(tmp_path / "pieces") == recorded_bytes(recorded)


@pytest.mark.parametrize(
    ("plan", "reason"),
    [
        pytest.param("[pattern]\npitch_px = [16]\n", "no frame for this raster", id="raster"),
        pytest.param(WITH_REPEATS + "[camera]\niso = 400\n", "iso=400", id="settings"),
        pytest.param(
            WITH_REPEATS.replace("every_frames = 5", "every_frames = 2"),
            "all have been handed over",
            id="more repeats than recorded",
        ),
    ],
)
def test_what_was_not_recorded_cannot_be_replayed(
    recorded: Path, tmp_path: Path, plan: str, reason: str
) -> None:
    with pytest.raises(DriverError, match=reason):
        captured(tmp_path / "other", small_plan(plan), find_bench(f"replay:{recorded}"))


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        pytest.param("replay:nowhere", "no session at nowhere", id="no session"),
        pytest.param("nowhere.toml", "There is no bench", id="no file"),
        pytest.param("replay:", "There is no bench", id="no name"),
    ],
)
def test_benches_that_cannot_be_found(name: str, reason: str) -> None:
    with pytest.raises(LumisplitError, match=reason):
        find_bench(name)


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        pytest.param("kind = 'sim'\n[sim]\nblurr_px = 1", ["blurr_px", "no such key"], id="key"),
        pytest.param("kind = 'sim'\n[sim]\nlate = 2", ["late", "less than or equal"], id="range"),
        pytest.param("kind = 'sim'\n[sim]\nscene = 'moon'", ["scene", "corner"], id="scene"),
        pytest.param("kind = 'sim'\n[sim]\ncamera_px = [96]", ["camera_px"], id="size"),
        pytest.param(
            "kind = 'sim'\n[sim]\ncamera_px = [9999999, 99999999]", ["camera_px"], id="huge"
        ),
        pytest.param("kind = 'magic'", ["kind"], id="kind"),
        pytest.param("[sim]", ["kind"], id="no kind"),
        pytest.param("kind =", ["not valid TOML"], id="no TOML"),
    ],
)
def test_bench_files_that_cannot_be_used(tmp_path: Path, content: str, parts: list[str]) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(content)
    with pytest.raises(BenchError) as refusal:
        find_bench(str(path))
    assert all(part in str(refusal.value) for part in [*parts, "bench.toml"])
