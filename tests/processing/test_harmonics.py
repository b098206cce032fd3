"""Harmonics of a pitch: designs, sums, white and noise from one pass."""

from __future__ import annotations

import numpy as np
import pytest

from processing.frames.gathering import HarmonicsStack
from processing.frames.harmonics import PitchDesign, PitchHarmonics
from processing.patterns import Family, Pattern
from tests.processing.light import PROJECTOR_PX, checkers, waves

SHAPE = (5, 7, 3)


def test_sums_are_those_of_the_definition() -> None:
    patterns = checkers([12])
    frames = np.random.default_rng(0).random((36, *SHAPE), np.float32)
    gathered = PitchHarmonics(PitchDesign.of(patterns), SHAPE)
    for pattern, frame in zip(patterns, frames, strict=True):
        gathered.add(frame, pattern)
    assert gathered.is_complete
    for sign, rows in ((1, (0, 1)), (-1, (2, 3))):
        turns = [np.exp(1j * np.pi * (p.shift_y_px + sign * p.shift_x_px) / 12) for p in patterns]
        expected = np.tensordot(turns, frames, 1)
        np.testing.assert_allclose(gathered.harmonics[rows[0]], expected.real, atol=1e-4)
        np.testing.assert_allclose(gathered.harmonics[rows[1]], expected.imag, atol=1e-4)
    np.testing.assert_allclose(gathered.total, frames.sum(axis=0), rtol=1e-5)


def test_blocks_of_lines_of_several_frames_are_the_same_bits() -> None:
    patterns = checkers([12])
    frames = np.random.default_rng(0).random((36, *SHAPE), np.float32)
    one, some = (PitchHarmonics(PitchDesign.of(patterns), SHAPE) for _ in range(2))
    for pattern, frame in zip(patterns, frames, strict=True):
        one.add(frame, pattern)
    for k in range(0, 36, 7):
        for lines in (slice(0, 2), slice(2, 5)):
            some.add_lines(frames[k : k + 7, lines], patterns[k : k + 7], lines)
            assert some.is_complete == (k == 35 and lines.stop == 5)
    for found, expected in (
        (some.harmonics, one.harmonics),
        (some.total, one.total),
        (some.null, one.null),
    ):
        np.testing.assert_array_equal(found, expected)


def test_lines_are_added_once() -> None:
    patterns = checkers([12])
    frames = np.zeros((2, *SHAPE), np.float32)
    gathered = PitchHarmonics(PitchDesign.of(patterns), SHAPE)
    gathered.add_lines(frames[:, :2], patterns[:2], slice(0, 2))
    for lines in (slice(0, 2), slice(1, 3)):
        with pytest.raises(ValueError, match="still expected"):
            gathered.add_lines(frames[:, :2], patterns[:2], lines)
    with pytest.raises(ValueError, match="still expected"):
        gathered.add_lines(frames[:, 2:], [patterns[3]] * 2, slice(2, 5))


def test_a_pitch_that_was_gathered_elsewhere_joins() -> None:
    rng = np.random.default_rng(2)
    patterns = checkers([8, 12])
    whole, joined = (HarmonicsStack(patterns, SHAPE, PROJECTOR_PX) for _ in range(2))
    parts = [PitchHarmonics(design, SHAPE) for design in joined.designs]
    for pattern in patterns:
        frame = rng.random(SHAPE, np.float32)
        whole.add(frame, pattern)
        parts[(8, 12).index(pattern.pitch_px)].add(frame, pattern)
    with pytest.raises(ValueError, match=r"frames are missing of checker:8, checker:12"):
        joined.harmonics(np.zeros(SHAPE, np.float32), slice(None))
    for part in reversed(parts):
        copies = (one.copy() for one in (part.harmonics, part.total, part.null))
        joined.join(PitchHarmonics.whole(part.design, *copies))
    np.testing.assert_array_equal(joined.white(), whole.white())
    for lines in (slice(1, 4), slice(None, None, 2)):
        found = joined.harmonics(joined.white(), lines)
        np.testing.assert_array_equal(found, whole.harmonics(whole.white(), lines))
    with pytest.raises(ValueError, match="not waited for"):
        joined.join(parts[0])


@pytest.mark.parametrize(
    "patterns",
    [
        pytest.param(checkers([8]), id="checkers"),
        pytest.param(waves(Family.STRIPES_ROWS, 8, [12]), id="stripes"),
        pytest.param(waves(Family.SINUSOID_COLUMNS, 8, [16]), id="sinusoids"),
    ],
)
def test_the_null_combination_hears_noise_and_no_light(patterns: list[Pattern]) -> None:
    design = PitchDesign.of(patterns)
    assert design.null is not None
    codes = np.stack([pattern.code((40, 40)) for pattern in patterns])
    np.testing.assert_allclose(np.tensordot(design.null, codes, 1), 0, atol=1e-12)
    assert np.sum(design.null**2) == pytest.approx(1)


def test_no_null_combination_without_complements() -> None:
    patterns = [Pattern(Family.CHECKER, 8, down, right) for down in (0, 3) for right in range(6)]
    assert PitchDesign.of(patterns).null is None


def test_scattered_shifts_are_fitted() -> None:
    """Weights of no grid: constant light adds nothing, the harmonics come out as from a grid."""
    rng = np.random.default_rng(3)
    shifts = {(int(a), int(b)) for a, b in rng.integers(0, 32, (40, 2))}
    design = PitchDesign.of([Pattern(Family.CHECKER, 16, *shift) for shift in sorted(shifts)])
    assert not design.is_grid
    np.testing.assert_allclose(design.offset, 0, atol=1e-9)
    down, right = np.array(sorted(shifts)).T * np.pi / 16
    frames = np.cos(down + 0.3) * np.cos(right - 0.5)
    plus, minus = (frames @ design.weights).reshape(2, 2)
    quarter = len(shifts) / 4
    np.testing.assert_allclose(plus, quarter * np.array([np.cos(0.2), np.sin(0.2)]), rtol=1e-9)
    np.testing.assert_allclose(minus, quarter * np.array([np.cos(0.8), -np.sin(0.8)]), rtol=1e-9)


def test_white_and_noise_come_from_the_patterns() -> None:
    rng = np.random.default_rng(1)
    patterns = checkers([8, 12, 16, 20])
    white = rng.uniform(0.2, 1, (30, 40, 3))
    stack = HarmonicsStack(patterns, white.shape, PROJECTOR_PX)
    for k in rng.permutation(len(patterns)):
        clean = white * patterns[k].code((30, 40))[..., np.newaxis]
        stack.add((clean + rng.normal(0, 0.01, white.shape)).astype(np.float32), patterns[k])
    deviation = 2 * 0.01 / np.sqrt(len(patterns))
    residual = stack.white() - white
    assert np.std(residual) == pytest.approx(deviation, rel=0.05)
    variance = stack.noise_variance()
    assert variance is not None
    assert np.sqrt(variance.mean()) == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize(
    ("frame_shape", "pattern", "said"),
    [
        pytest.param((4, 7, 3), "checker:8", r"\(4, 7, 3\).*\(5, 7, 3\)", id="shape"),
        pytest.param(SHAPE, "checker:12", "not announced", id="stranger"),
        pytest.param(SHAPE, "checker:8:1,1", "still expected", id="strange-shift"),
    ],
)
def test_frames_that_do_not_belong_are_refused(
    frame_shape: tuple[int, ...], pattern: str, said: str
) -> None:
    stack = HarmonicsStack(checkers([8]), SHAPE, PROJECTOR_PX)
    with pytest.raises(ValueError, match=said):
        stack.add(np.zeros(frame_shape, np.float32), Pattern.parse(pattern))


@pytest.mark.parametrize(
    ("patterns", "said"),
    [
        pytest.param([], "no patterns", id="none"),
        pytest.param(checkers([8, 12]), "one family and pitch", id="two-pitches"),
        pytest.param(checkers([8])[:1] * 2, "twice", id="twice"),
        pytest.param(
            [Pattern(Family.CHECKER, 8, 0, 0), Pattern(Family.CHECKER, 8, 3, 3)], "fix", id="few"
        ),
    ],
)
def test_designs_that_cannot_be_are_refused(patterns: list[Pattern], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        PitchDesign.of(patterns)


def test_missing_frames_are_named() -> None:
    stack = HarmonicsStack(checkers([8, 12]), SHAPE, PROJECTOR_PX)
    with pytest.raises(ValueError, match=r"checker:8, checker:12"):
        stack.white()
