"""The same session, processed where processors can do less, gives the same bits."""

from __future__ import annotations

import ast
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import processing
from benchmarks.same_bits import NUMBA, SETTINGS, THREADS, differences, run
from tests.acquire.captures import captured, small_bench, small_plan

PLAN = small_plan("[pattern]\npitch_px = [4, 8, 12]\nshifts = [4, 2]\n")


# Loops compiled for a lesser processor are left to `benchmarks.same_bits`: compiling takes long,
# and while nothing is reordered they are of the same operations.
LESSER = {name: value for name, value in SETTINGS["all"].items() if name not in NUMBA}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session and what is made of it here."""
    room = tmp_path_factory.mktemp("bits")
    bench = small_bench(full_well_e=20000.0, read_noise_e=5.0, blur_px=0.6)
    captured(room / "s", PLAN, bench)
    for method in ("ranges", "iva"):
        run(room, "process", "s", "--method", method, "--out", method, settings=THREADS)
    return room


@pytest.mark.parametrize("method", ["ranges", "iva"])
def test_another_processor_gives_the_same_bits(room: Path, tmp_path: Path, method: str) -> None:
    words = ("process", "s", "--method", method, "--out", str(tmp_path / "there"))
    run(room, *words, settings=LESSER)
    assert (tmp_path / "there" / "components").is_dir()
    assert list(differences(room / method, tmp_path / "there")) == []


def test_a_difference_is_found(room: Path, tmp_path: Path) -> None:
    shutil.copytree(room / "iva", tmp_path / "other")
    assert not list(differences(room / "iva", tmp_path / "other"))
    path = tmp_path / "other" / "white.tiff"
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    record = tmp_path / "other" / "result.json"
    text = record.read_text()
    share = json.loads(text)["pca_shares"][0]
    record.write_text(text.replace(str(share), str(np.nextafter(share, 0))))
    picture, number = differences(room / "iva", tmp_path / "other")
    assert picture.startswith("white.tiff: 1 of 960 values")
    assert number.startswith("result.json.pca_shares[0]")


def test_no_compiled_loop_may_be_reordered() -> None:
    """With any of `fastmath` the compiler's vectors, which are the processor's, order the sums."""
    (folder,) = processing.__path__
    named = [
        (path.name, node.lineno)
        for path in sorted(Path(folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.keyword) and node.arg == "fastmath"
    ]
    assert named == []
