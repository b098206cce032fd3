"""Sessions of stripes in two positions, from plan or import to components."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from acquire.frames import Frames
from acquire.pipeline import Options, process
from acquire.result import Result
from acquire.session import Session
from acquire.table import import_table
from processing.metrics import relative_error
from processing.patterns import Family
from tests.acquire.captures import captured, small_bench, small_plan
from tests.acquire.test_pipeline import Silent

PITCHES_PX = [2, 4, 8, 16, 32, 64]
BENCH = {"camera_px": (48, 56), "projector_px": (96, 112), "scene": "groove"}


def session_of(folder: Path, family: Family) -> Session:
    shifts = [2, 1] if family.varies_down else [1, 2]
    text = f'[pattern]\nfamily = "{family}"\npitch_px = {PITCHES_PX}\nshifts = {shifts}\n'
    session, _ = captured(folder, small_plan(text), small_bench(**BENCH))
    return session


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> Session:
    return session_of(tmp_path_factory.mktemp("rows") / "s", Family.STRIPES_ROWS)


@pytest.fixture(scope="module")
def imported(rows: Session, tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Pictures of both families, as somebody else's program lists them."""
    folder = tmp_path_factory.mktemp("import")
    columns = session_of(folder / "columns", Family.STRIPES_COLUMNS)
    lines = ["file,role,pattern,pitch_px,shift_y_px,shift_x_px"]
    for session in (rows, columns):
        for k, (frame, image) in enumerate(Frames(session).images(session.frames)):
            pattern = frame.pattern
            if pattern.family.is_reference and session is columns:
                continue
            name = f"{pattern.family}-{k}.tiff"
            tifffile.imwrite(folder / name, image.values, photometric="rgb")
            role = pattern.family.value if pattern.family.is_reference else "pattern"
            shown = "" if role != "pattern" else pattern.family.value
            numbers = (pattern.pitch_px, pattern.shift_y_px, pattern.shift_x_px)
            said = ",".join(map(str, numbers)) if shown else ",,"
            lines.append(f"{name},{role},{shown},{said}")
    (folder / "t.csv").write_text("\n".join(lines) + "\n")
    return import_table(folder / "t.csv", folder / "s", progress=Silent())


def direct_error(result: Result, rows: Session) -> float:
    with np.load(rows.folder / "truth.npz") as truth:
        light = truth["direct"].astype(np.float32)
    return relative_error(result.component("direct"), light, result.mask == 0)


def best_pitch(result: Result, rows: Session) -> float:
    """Of the single pitches that max and min separated, the one nearest to the truth."""
    with np.load(rows.folder / "truth.npz") as truth:
        light = truth["direct"].astype(np.float32)
    images = (tifffile.imread(result.folder / pitch.direct) for pitch in result.record.pitches)
    return min(relative_error(one, light, result.mask == 0) for one in images)


def test_one_direction_is_decoded_and_better_than_its_best_pitch(
    rows: Session, tmp_path: Path
) -> None:
    result = process(rows, tmp_path / "r", Options(), Silent())
    assert result.record.method == "ranges"
    assert any("binary code" in warning for warning in result.record.warnings)
    assert not list(result.folder.glob(".*"))
    assert direct_error(result, rows) < 0.5 * best_pitch(result, rows)


def test_imported_pictures_of_both_directions_are_taken_apart(
    imported: Session, rows: Session, tmp_path: Path
) -> None:
    both = process(imported, tmp_path / "both", Options(), Silent())
    assert both.record.method == "ranges"
    assert both.record.components[0] == "direct"
    images = [both.component(name) for name in both.record.components]
    measured = both.mask == 0
    np.testing.assert_allclose(
        np.sum(images, axis=0)[measured], np.maximum(both.white, 0)[measured], atol=1e-5
    )
    assert direct_error(both, rows) < 0.5 * best_pitch(both, rows)
    assert len(both.record.pitches) == 2 * len(PITCHES_PX)


def test_iva_still_takes_them_where_it_is_asked_for(rows: Session, tmp_path: Path) -> None:
    result = process(rows, tmp_path / "r", Options("iva", n_components=2), Silent())
    assert result.record.method == "iva"
