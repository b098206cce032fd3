"""Imported stacks of a camera that chose its gains: what processing finds, undoes and says."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from acquire.evaluation import evaluate, read_truth
from acquire.pipeline import Options, process
from acquire.report import write_report
from acquire.report.settings import commands
from acquire.result import Result
from acquire.session import FrameRecord, Session
from acquire.stack import Stack
from acquire.table import import_table
from processing.patterns import Family
from tests.acquire.captures import captured, small_bench, small_plan
from tests.acquire.test_pipeline import Silent

HEADER = ["file", "role", "pattern", "pitch_px", "shift_y_px", "shift_x_px"]
SIM = {
    "camera_px": (64, 64),
    "projector_px": (144, 192),
    "full_well_e": 20_000.0,
    "read_noise_e": 5.0,
    "ambient": 0.02,
    "black_level": 0.01,
}
STRIPES = "[pattern]\nfamily = 'stripes-columns'\npitch_px = [8, 16, 32]\n"
Gain = NDArray[np.float64]


@pytest.fixture(scope="module")
def in_four(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Stripes in four positions a pitch, from a camera of fixed gain; to be read only."""
    plan = small_plan(STRIPES + "shifts = [1, 4]\n")
    return captured(tmp_path_factory.mktemp("four") / "s", plan, small_bench(**SIM))[0]


@pytest.fixture(scope="module")
def in_two(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """The same in two positions a pitch; to be read only."""
    plan = small_plan(STRIPES + "shifts = [1, 2]\n")
    return captured(tmp_path_factory.mktemp("two") / "s", plan, small_bench(**SIM))[0]


@pytest.fixture(scope="module", params=["in_four", "in_two"])
def session(request: pytest.FixtureRequest) -> Session:
    """Either of them."""
    found: Session = request.getfixturevalue(request.param)
    return found


def drawn(seed: int) -> Callable[[FrameRecord], Gain]:
    """Gains of ±15 %, but of the white frame, which is the unit."""

    def gain(frame: FrameRecord) -> Gain:
        if frame.pattern.family is Family.WHITE:
            return np.ones(3)
        return 1 + 0.15 * np.random.default_rng((seed, frame.step)).uniform(-1, 1, 3)

    return gain


def fixed(_: FrameRecord) -> Gain:
    return np.ones(3)


def stranger(
    session: Session,
    folder: Path,
    gain: Callable[[FrameRecord], Gain] = fixed,
    keep: Callable[[FrameRecord], bool] = lambda _: True,
) -> Session:
    """The session as somebody else would hand it over: linear TIFFs and a table."""
    folder.mkdir()
    rows = [HEADER]
    kept = [frame for frame in session.frames if keep(frame)]
    for frame, image in Stack(session).images(kept):
        name, shown = f"{frame.step:03d}.tiff", frame.pattern
        codes = np.rint(np.clip(image.values * gain(frame), 0, 1) * 65535).astype(np.uint16)
        tifffile.imwrite(folder / name, codes, photometric="rgb")
        if shown.family.is_reference:
            rows.append([name, shown.family.value, "", "", "", ""])
        else:
            numbers = shown.pitch_px, shown.shift_y_px, shown.shift_x_px
            rows.append([name, "pattern", shown.family.value, *map(str, numbers)])
    with (folder / "table.csv").open("w", newline="") as file:
        csv.writer(file).writerows(rows)
    return import_table(folder / "table.csv", folder / "session", progress=Silent())


def processed(session: Session, folder: Path, *, gains: bool = True, tone: bool = True) -> Result:
    options = Options("iva", gain_correction=gains, tone_correction=tone)
    return process(session, folder, options, Silent())


def single_pitches(result: Result, truth: Session) -> dict[tuple[str, str], float]:
    found = evaluate(result, read_truth(truth.folder / "truth.npz", result.record.shape))
    rows = [row for row in found.rows if row.matching in {"finest pitch", "oracle's pitch"}]
    return {(row.truth, row.matching): row.error for row in rows}


def text_of(result: Result) -> str:
    return " ".join(result.record.warnings)


def bytes_of(paths: Iterable[Path]) -> list[bytes]:
    return [path.read_bytes() for path in sorted(paths)]


def test_drawn_gains_are_found_and_cost_nothing(session: Session, tmp_path: Path) -> None:
    """Against the same frames at a fixed gain: errors within a hundredth of theirs."""
    plain = processed(stranger(session, tmp_path / "0"), tmp_path / "r0")
    taken = stranger(session, tmp_path / "1", drawn(1))
    result = processed(taken, tmp_path / "r1")
    left = processed(taken, tmp_path / "r2", gains=False)
    usual, found = (single_pitches(one, session) for one in (plain, result))
    for key in usual:
        assert found[key] == pytest.approx(usual[key], rel=0.01), key
    assert max(abs(one.additivity_error or 0) for one in result.record.pitches) < 0.003
    exposures = result.record.exposures
    assert exposures is not None
    assert exposures.corrected
    assert all(pair.corrected for pair in exposures.pairs)
    assert exposures.unpaired == 0
    # Two gains of ±15 %, evenly drawn: their mean is off by 6 %, root mean square.
    assert np.mean([pair.missed for pair in exposures.pairs]) > 0.03
    told = [one for pair in exposures.pairs for one in pair.frames]
    true = np.array([drawn(1)(taken.frames[one.step]) for one in told])
    error = np.array([one.error for one in told])
    off_by = np.abs(np.array([one.gain for one in told]) - true)
    # White and black are the same in all: few of the values are independent.
    assert np.mean(off_by < error) > 0.4
    assert np.mean(off_by < 3 * error) > 0.9
    assert off_by.max() < 0.005
    assert "The camera's gain differs between frames" in text_of(result)
    assert "as asked" in text_of(left)
    assert any("--no-gain-correction" in command.line for command in commands(left.record))
    assert not any("gain-correction" in command.line for command in commands(result.record))
    page = write_report(result).read_text()
    assert "Gain of every frame" in page
    assert str(told[0].pattern) in page


def test_a_fixed_gain_is_left_alone_bit_for_bit(session: Session, tmp_path: Path) -> None:
    given = stranger(session, tmp_path / "0")
    results = [processed(given, tmp_path / str(on), gains=on, tone=on) for on in (True, False)]
    first, second = (bytes_of(one.folder.rglob("*.tiff")) for one in results)
    assert first == second
    exposures = results[0].record.exposures
    assert exposures is not None
    assert exposures.pairs
    assert not exposures.differs
    assert exposures.curve is None or not exposures.curve.corrected
    assert "gain differs" not in text_of(results[0])


def test_a_capture_of_this_program_is_not_looked_at(session: Session, tmp_path: Path) -> None:
    observer = Silent()
    result = process(session, tmp_path / "r", Options("iva"), observer)
    assert result.record.exposures is None
    assert "comparing exposures" not in [name for name, _ in observer.stages]


ABSENT = {
    "white": (lambda frame: frame.pattern.family is not Family.WHITE, "there is no white frame"),
    "black": (lambda frame: frame.pattern.family is not Family.BLACK, "there is no black frame"),
    "complements": (
        lambda frame: (
            frame.pattern.family.is_reference or frame.pattern.shift_x_px < frame.pattern.pitch_px
        ),
        "no pattern has its complement",
    ),
}


@pytest.mark.parametrize(("keep", "obstacle"), ABSENT.values(), ids=ABSENT)
def test_what_keeps_gains_from_being_found_is_told(
    in_four: Session, tmp_path: Path, keep: Callable[[FrameRecord], bool], obstacle: str
) -> None:
    result = processed(stranger(in_four, tmp_path / "0", drawn(2), keep), tmp_path / "r")
    assert result.record.exposures is not None
    assert obstacle in result.record.exposures.obstacle
    assert f"could not be found: {obstacle}" in text_of(result)


def test_frames_without_complement_are_left_and_counted(in_four: Session, tmp_path: Path) -> None:
    lost = next(frame.step for frame in in_four.frames if frame.pattern.pitch_px == 8)
    given = stranger(in_four, tmp_path / "0", drawn(3), lambda frame: frame.step != lost)
    exposures = processed(given, tmp_path / "r").record.exposures
    assert exposures is not None
    assert exposures.corrected
    assert exposures.unpaired == 1
