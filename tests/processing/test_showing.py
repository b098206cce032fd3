"""What frames show is judged from the frames of one pitch alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.patterns import Family, Pattern
from processing.proof.finding import Finding
from processing.proof.kind import Kind
from processing.proof.parts import Parts
from processing.proof.phases import Phases
from processing.proof.prediction import pattern_covariance
from processing.proof.sample_noise import SampleNoise
from processing.proof.showing import judge

SIDE = 64
NOISE = 0.002
CHECKERS = [Pattern(Family.CHECKER, 8, down, right) for down in (0, 4, 8, 12) for right in (0, 4)]
PAIR = [Pattern(Family.CHECKER, 8, 0), Pattern(Family.CHECKER, 8, 8)]
WAVES = [Pattern(Family.SINUSOID_COLUMNS, 16, 0, shift) for shift in (0, 10, 21)]
# A textured scene, smooth enough for a camera to see.
TEXTURE = 0.6 + 0.2 * np.sin(np.add.outer(np.arange(SIDE) * 0.9, np.arange(SIDE) * 0.7))
Array = NDArray[np.float64]


def seen(pattern: Pattern, contrast: float = 1.0) -> Array:
    """A pattern on the scene, (SIDE, SIDE), one camera pixel a projector pixel."""
    sign = 2 * pattern.code((SIDE, SIDE)) - 1
    light: Array = TEXTURE * (1 + contrast * sign) / 2
    return light


def kind(patterns: list[Pattern], pictures: list[Array]) -> Kind:
    """Frames of these pictures, each with noise, after each other; the scene is as at first."""
    chance = np.random.default_rng(11)
    exact = np.stack([one.ravel() for one in pictures])
    frames = (exact + chance.normal(0, NOISE, exact.shape)).astype(np.float32)
    beside = [
        np.roll(TEXTURE / 2, shift, axis) - TEXTURE / 2 for axis in (0, 1) for shift in (1, -1)
    ]
    places = np.divmod(np.arange(SIDE**2), SIDE)
    steps = np.arange(len(patterns))
    codes = np.stack([pattern.code((SIDE, SIDE)).ravel() for pattern in patterns])
    moves = np.mean((codes[1:] - codes[:-1]) ** 2, axis=1) * 4
    return Kind(
        frames=frames,
        before=np.concatenate([np.full_like(frames[:1], np.nan), frames[:-1]]),
        before_index=steps - 1,
        covariance=pattern_covariance(patterns, (SIDE, SIDE)),
        phases=Phases.of(patterns),
        change=np.concatenate([[1.0], moves]),
        partitions=tuple(
            Parts.grid(places, (SIDE, SIDE), counts) for counts in ((1, 1), (4, 4), (16, 1))
        ),
        white=TEXTURE.ravel(),
        noise=SampleNoise(NOISE**2),
        repeated=np.zeros(len(patterns), bool),
        slopes=np.stack([one.ravel() for one in beside]),
        replaced=np.full_like(frames, np.nan),
        void=np.zeros(len(patterns), bool),
        is_fine=True,
    )


def accused(one: Kind) -> dict[int, Finding]:
    return {k: found.finding for k, found in enumerate(judge(one)) if found.is_wrong}


@pytest.mark.parametrize("patterns", [CHECKERS, PAIR, WAVES], ids=["checkers", "pair", "waves"])
@pytest.mark.parametrize("contrast", [1.0, 0.15])
def test_a_scene_that_moved_by_half_a_pixel_shows_its_patterns_all_the_same(
    patterns: list[Pattern], contrast: float
) -> None:
    pictures = [seen(pattern, contrast) for pattern in patterns]
    moved = [(one + np.roll(one, 1, axis=1)) / 2 for one in pictures]
    assert accused(kind(patterns, moved)) == {}


@pytest.mark.parametrize("contrast", [1.0, 0.15])
@pytest.mark.parametrize("patterns", [CHECKERS, PAIR, WAVES], ids=["checkers", "pair", "waves"])
def test_a_frame_without_light_accuses_no_other(patterns: list[Pattern], contrast: float) -> None:
    for dark in range(len(patterns)):
        pictures = [seen(pattern, contrast) for pattern in patterns]
        pictures[dark] = np.zeros((SIDE, SIDE))
        assert accused(kind(patterns, pictures)) == {dark: Finding.BLANK}


@pytest.mark.parametrize("late", [1, 2])
def test_of_three_waves_the_one_that_shows_the_picture_before_is_found(late: int) -> None:
    pictures = [seen(pattern) for pattern in WAVES]
    pictures[late] = pictures[late - 1]
    assert set(accused(kind(WAVES, pictures))) == {late}


@pytest.mark.parametrize("part", [0.12, 0.16, 0.2, 0.3])
def test_a_mixture_with_the_picture_before_is_found(part: float) -> None:
    for wrong in range(1, len(CHECKERS)):
        pictures = [seen(pattern) for pattern in CHECKERS]
        pictures[wrong] = (1 - part) * pictures[wrong] + part * pictures[wrong - 1]
        assert set(accused(kind(CHECKERS, pictures))) == {wrong}


def test_what_looks_the_same_when_it_is_taken_again_is_not_the_wrong_one() -> None:
    """Something unheard of is on one of two complements: nothing tells on which."""
    pictures = [seen(pattern) for pattern in PAIR]
    strange = TEXTURE * np.random.default_rng(3).random((SIDE, SIDE))
    for wrong in range(2):
        shown = list(pictures)
        shown[wrong] = strange
        one = kind(PAIR, shown)
        assert set(accused(one)) == {0, 1}
        replaced = one.replaced.copy()
        replaced[1 - wrong] = kind(PAIR, pictures).frames[1 - wrong]
        assert set(accused(replace(one, replaced=replaced))) == {wrong}
