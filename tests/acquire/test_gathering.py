"""The one read of a session's frames against the same frames taken in one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.frames import Frames, Reading
from acquire.gathering import LocalGatherer
from acquire.references import read_references
from acquire.session import Session
from acquire.stack import PitchGroup, Stack
from processing.frames.frame_noise import FrameSample
from processing.frames.harmonics import PitchDesign, PitchHarmonics
from processing.frames.separation import ExtremaSeparation
from tests.acquire.captures import captured, small_bench, small_plan

PLAN = small_plan(
    "[pattern]\npitch_px = [8, 12]\nshifts = [4, 2]\n[references]\nevery_frames = 4\n"
)
# So wide that some lines alone fill a block.
WIDE = {"camera_px": (18, 3000), "projector_px": (96, 128)}


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Of a lamp that drifts, in a room that is not dark; to be read only."""
    folder = tmp_path_factory.mktemp("drifting") / "s"
    bench = small_bench(**WIDE, full_well_e=20_000.0, drift=-0.2, ambient=0.02)
    return captured(folder, PLAN, bench)[0]


def evened(
    session: Session,
    reading: Reading,
    group: PitchGroup,
    dark: NDArray[np.float32],
    gains: NDArray[np.float32],
) -> list[NDArray[np.float32]]:
    """Whole frames, black subtracted and freed from drift."""
    images = [image.values for _, image in Frames(session, reading).images(group.frames)]
    return [(image - dark) / gain for image, gain in zip(images, gains, strict=True)]


@pytest.mark.parametrize("black", [None, (0.001, 0.002, 0.003)], ids=["plain", "black-given"])
def test_blocks_of_a_few_frames_give_the_bits_that_whole_frames_give(
    session: Session, black: tuple[float, ...] | None
) -> None:
    reading = Reading(black=black)
    stack = Stack(session, reading)
    levels = read_references(session, stack, lambda: None, correct_drift=True).levels
    assert levels.dark is not None
    assert levels.lit is not None
    assert levels.drift is not None
    # The black level was steady: an offset of 0 was taken off.
    assert not levels.drift.offset.values.any()
    done: list[None] = []
    gatherer = LocalGatherer(0.0, with_harmonics=True, frame_done=lambda: done.append(None))
    for group, found in zip(stack.groups, gatherer.gather(stack, levels), strict=True):
        orders = np.array([stack.order(frame) for frame in group.frames], np.float64)
        gains = levels.drift.gain.at(orders).astype(np.float32)
        assert np.ptp(gains) > 0.02
        frames = evened(session, reading, group, levels.dark, gains)
        extrema = ExtremaSeparation((18, 3000, 3))
        harmonics = PitchHarmonics(PitchDesign.of(group.patterns), (18, 3000, 3))
        sample = FrameSample(group.patterns)
        for frame, pattern in zip(frames, group.patterns, strict=True):
            extrema.add(frame)
            harmonics.add(frame, pattern)
            sample.add(frame, pattern)
        direct = extrema.separate().direct_light
        assert found.harmonics is not None
        for got, expected in (
            (found.separation.direct_light, direct),
            (found.separation.global_light, levels.lit - direct),
            (found.total, harmonics.total),
            (found.harmonics.harmonics, harmonics.harmonics),
            (found.harmonics.null, harmonics.null),
            (found.sample.frames, sample.frames),
        ):
            np.testing.assert_array_equal(got, expected)
    assert len(done) == sum(len(group.frames) for group in stack.groups)


def test_batches_hold_what_single_frames_do(session: Session) -> None:
    one, some = Frames(session), Frames(session)
    groups = session.frames[:3], session.frames[3:12], session.frames[12:13]
    expected = [(frame, image.values.sum(), image) for frame, image in one.images(session.frames)]
    places = set[int]()
    taken = 0
    for batch in some.batches(groups):
        for frame, image in zip(batch.frames, batch.images, strict=True):
            np.testing.assert_array_equal(image.values, expected[taken][2].values)
            assert frame == expected[taken][0]
            places.add(image.values.ctypes.data)
            taken += 1
    assert taken == 13
    assert len(places) < taken
    assert some.saturated is not None


def test_whoever_stops_in_the_middle_waits_for_nothing_more(session: Session) -> None:
    batches = Frames(session).batches([session.frames])
    next(batches)
    batches.close()
    with pytest.raises(StopIteration):
        next(batches)


def test_an_impossible_set_of_shifts_is_one_message(tmp_path: Path) -> None:
    plan = small_plan("[pattern]\npitch_px = [8]\nshifts = [2, 1]\n")
    bench = small_bench(camera_px=(32, 40), projector_px=(96, 128))
    session, _ = captured(tmp_path / "s", plan, bench)
    stack = Stack(session)
    levels = read_references(session, stack, lambda: None, correct_drift=True).levels
    with pytest.raises(StackError, match="--method iva"):
        list(LocalGatherer(0.0, with_harmonics=True, frame_done=lambda: None).gather(stack, levels))
