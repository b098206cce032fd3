"""Pictures of the worst frames are of these frames, and their predictions are right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from acquire.frames import Frames
from acquire.proof import keep_portraits
from acquire.proof.portraits import MOST, worst_frames
from acquire.result import PortraitRecord, read_tiff
from acquire.session import FrameRecord, Session
from tests.acquire.captures import captured, small_bench, small_plan

PLAN = small_plan("[pattern]\npitch_px = [8, 12]\n[references]\nevery_frames = 60\n")
# Rounding of a 14-bit file, of white, black and the complement.
CODE = 3 / (16383 - 512)


def light_of(session: Session, record: FrameRecord) -> NDArray[np.float32]:
    ((_, image),) = Frames(session).images([record])
    return image.values


def portraits(session: Session, folder: Path) -> tuple[PortraitRecord, ...]:
    folder.mkdir()
    begun: list[int] = []
    done: list[None] = []
    found = keep_portraits(session, folder, begun.append, lambda: done.append(None))
    assert begun == ([len(found)] if found else [])
    assert len(done) == len(found)
    return found


@pytest.fixture(scope="module")
def mended(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Without noise; wrong frames were taken again."""
    bench = small_bench(seed=8, dropped=0.06, torn=0.06)
    return captured(tmp_path_factory.mktemp("mended") / "s", PLAN, bench)[0]


def test_what_was_taken_again_is_shown_beside_what_the_second_attempt_shows(
    mended: Session, tmp_path: Path
) -> None:
    found = portraits(mended, tmp_path / "r")
    again = [one for one in found if "taken again" in one.verdict]
    assert again
    lines = {(line.step, line.attempt): line for line in mended.lines}
    current = {frame.step: frame for frame in mended.frames}
    for one in again:
        size = (*one.shape, 3)
        measured = read_tiff(tmp_path / "r" / one.measured, size, np.float32)
        wrong, right = lines[one.step, one.attempt], current[one.step]
        assert wrong != right
        # Whatever it was, not only that it was wrong.
        assert not one.verdict.startswith("was found wrong")
        np.testing.assert_array_equal(measured, light_of(mended, wrong))
        assert not one.is_right
        assert one.miss is not None
        if one.predicted is None:
            continue
        predicted = read_tiff(tmp_path / "r" / one.predicted, size, np.float32)
        assert np.abs(predicted - light_of(mended, right)).max() <= CODE
        assert one.miss > 0.03


def test_at_most_six_and_the_worst_of_the_right_ones_among_them(
    mended: Session, tmp_path: Path
) -> None:
    assert len(mended.lines) - len(mended.frames) >= MOST
    found = portraits(mended, tmp_path / "r")
    assert len(found) == MOST
    assert [one.is_right for one in found] == [False] * 4 + [True] * 2
    assert all(one.verdict == "shows its pattern" for one in found[4:])
    assert all(one.miss is not None and one.miss < 1e-3 for one in found[4:])
    assert (found[4].residual or 0) >= (found[5].residual or 0)


def test_what_was_kept_comes_first_and_predicts_nothing(tmp_path: Path) -> None:
    bench = small_bench(seed=5, dropped=0.5)
    plan = small_plan("[pattern]\npitch_px = [8]\n")
    session, _ = captured(tmp_path / "s", plan, bench, keep_unproven=True)
    kept = [f.step for f, proof in worst_frames(session) if proof is not None and proof.is_wrong]
    assert kept
    found = portraits(session, tmp_path / "r")
    assert [one.step for one in found[: len(kept)]] == kept
    assert "kept all the same" in found[0].verdict
    for one in found:
        assert not any(f"step {step}" in one.how for step in kept)


def test_a_session_that_was_not_judged_has_no_pictures(mended: Session, tmp_path: Path) -> None:
    (tmp_path / "s" / "frames").mkdir(parents=True)
    for name in ("plan.json", "session.json", "frames.jsonl"):
        (tmp_path / "s" / name).write_bytes((mended.folder / name).read_bytes())
    assert portraits(Session.open(tmp_path / "s"), tmp_path / "r") == ()
    assert not (tmp_path / "r" / "proof").exists()
