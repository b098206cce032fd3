"""Direct and global light of scenes in which both are known."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.frames.separation import ExtremaSeparation, Separator, SinusoidSeparation
from processing.patterns import Family, Pattern, shift_grid

SHAPE = (24, 36, 3)
PITCH_PX = 6

Image = NDArray[np.float32]
Capture = Callable[[Image, Image, float], Separator]


def light(seed: int) -> tuple[Image, Image]:
    """Direct and global light of a scene, each in (0, 1)."""
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(0.1, 0.9, SHAPE).astype(np.float32),
        rng.uniform(0.05, 0.5, SHAPE).astype(np.float32),
    )


def frame(direct: Image, global_: Image, code: NDArray[np.float64], leak: float) -> Image:
    """Lit in part by the pattern, and by half of all global light (Nayar et al. 2006)."""
    emitted = leak + (1 - leak) * code[..., np.newaxis]
    return (emitted * direct + (1 + leak) / 2 * global_).astype(np.float32)


def checkers(n_shifts: tuple[int, int] = (6, 6)) -> list[Pattern]:
    return [
        Pattern(Family.CHECKER, PITCH_PX, down, right)
        for down, right in shift_grid(PITCH_PX, n_shifts)
    ]


def with_checkers(direct: Image, global_: Image, leak: float) -> Separator:
    extrema = ExtremaSeparation(SHAPE)
    for pattern in checkers():
        extrema.add(frame(direct, global_, pattern.code(SHAPE[:2]), leak))
    return extrema


def with_sinusoids(direct: Image, global_: Image, leak: float) -> Separator:
    sinusoid = SinusoidSeparation(SHAPE)
    for shift_px in (0, 1, 3, 7, 10):
        pattern = Pattern(Family.SINUSOID_COLUMNS, PITCH_PX, 0, shift_px)
        sinusoid.add(frame(direct, global_, pattern.code(SHAPE[:2]), leak), pattern.phase)
    return sinusoid


@pytest.mark.parametrize("leak", [0.0, 0.04, 0.3])
@pytest.mark.parametrize("known_white", [False, True], ids=["no-white", "white"])
@pytest.mark.parametrize("captured", [with_checkers, with_sinusoids], ids=["checker", "sinusoid"])
def test_known_light_is_recovered(captured: Capture, known_white: bool, leak: float) -> None:
    direct, global_ = light(1)
    white = direct + global_ if known_white else None
    found = captured(direct, global_, leak).separate(white, leak)
    np.testing.assert_allclose(found.direct_light, direct, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.global_light, global_, rtol=0, atol=1e-5)
    assert found.direct_light.dtype == found.global_light.dtype == np.float32


def test_one_half_of_the_complements_serves_as_well() -> None:
    """Frame k + 18 is the complement of frame k; with white, 18 frames tell what 36 do."""
    direct, global_ = light(2)
    white = direct + global_
    half = ExtremaSeparation(SHAPE)
    for pattern in checkers()[:18]:
        half.add(frame(direct, global_, pattern.code(SHAPE[:2]), 0.0))
    np.testing.assert_allclose(half.separate(white).direct_light, direct, rtol=0, atol=1e-5)


def test_white_is_complemented_where_a_pixel_never_toggles() -> None:
    direct, global_ = light(3)
    white = direct + global_
    lit = frame(direct, global_, np.ones(SHAPE[:2]), 0.0)
    extrema = ExtremaSeparation(SHAPE)
    extrema.add(lit)
    extrema.add(lit)
    assert np.all(extrema.separate().direct_light == 0)
    np.testing.assert_allclose(extrema.separate(white).direct_light, direct, rtol=0, atol=1e-6)


@pytest.mark.parametrize("leak", [0.0, 0.1])
@pytest.mark.parametrize("captured", [with_checkers, with_sinusoids], ids=["checker", "sinusoid"])
def test_both_add_up_to_white_whatever_the_noise(captured: Capture, leak: float) -> None:
    direct, global_ = light(4)
    rng = np.random.default_rng(5)
    white = (direct + global_ + rng.normal(0, 0.05, SHAPE)).astype(np.float32)
    found = captured(direct, global_, leak).separate(white, leak)
    ulp = np.spacing(np.float32(2))
    np.testing.assert_allclose(found.direct_light + found.global_light, white, rtol=0, atol=ulp)


def test_frames_are_left_alone_and_not_held() -> None:
    direct, global_ = light(6)
    one = frame(direct, global_, checkers()[0].code(SHAPE[:2]), 0.0)
    kept = one.copy()
    extrema = ExtremaSeparation(SHAPE)
    extrema.add(one)
    np.testing.assert_array_equal(one, kept)
    one[:] = 9
    extrema.add(kept)
    assert np.all(extrema.separate().direct_light == 0)


def test_frames_need_not_lie_contiguous_in_memory() -> None:
    direct, global_ = light(7)
    extrema = ExtremaSeparation(SHAPE)
    for pattern in checkers():
        whole = frame(direct, global_, pattern.code(SHAPE[:2]), 0.0)
        extrema.add(np.asfortranarray(whole))
    np.testing.assert_allclose(extrema.separate().direct_light, direct, rtol=0, atol=1e-5)


def test_too_little_is_refused() -> None:
    zero = np.zeros(SHAPE, np.float32)
    extrema = ExtremaSeparation(SHAPE)
    extrema.add(zero)
    with pytest.raises(ValueError, match="at least 2 frames"):
        extrema.separate()
    sinusoid = SinusoidSeparation(SHAPE)
    with pytest.raises(ValueError, match="0 frames hold 0"):
        sinusoid.separate()
    for phase in (0.0, 1.0, 2 * np.pi, 1.0 - 4 * np.pi):
        sinusoid.add(zero, phase)
    with pytest.raises(ValueError, match="4 frames hold 2"):
        sinusoid.separate()


def test_what_does_not_fit_is_refused_by_both_shapes() -> None:
    extrema = ExtremaSeparation(SHAPE)
    wrong = np.zeros((24, 36), np.float32)
    with pytest.raises(ValueError, match=r"frame.*\(24, 36\).*\(24, 36, 3\)"):
        extrema.add(wrong)
    with pytest.raises(ValueError, match="float64"):
        extrema.add(np.zeros(SHAPE))  # type: ignore[arg-type]
    for _ in range(2):
        extrema.add(np.zeros(SHAPE, np.float32))
    with pytest.raises(ValueError, match=r"white.*\(24, 36\).*\(24, 36, 3\)"):
        extrema.separate(wrong)
    with pytest.raises(ValueError, match=r"\[0, 1\)"):
        extrema.separate(leak=1.0)


@pytest.mark.parametrize("edges", [(0, 24), (0, 1, 7, 24)], ids=["at-once", "in-blocks"])
@pytest.mark.parametrize("together", [1, 5, 36])
def test_blocks_of_lines_of_several_frames_are_the_same_bits(
    edges: tuple[int, ...], together: int
) -> None:
    frames = np.random.default_rng(8).random((36, *SHAPE), np.float32)
    frames[3, 2, 5, 1] = np.nan
    phases = [pattern.phase for pattern in checkers()]
    one, some = ExtremaSeparation(SHAPE), ExtremaSeparation(SHAPE)
    first, others = SinusoidSeparation(SHAPE), SinusoidSeparation(SHAPE)
    for frame_, phase in zip(frames, phases, strict=True):
        one.add(frame_)
        first.add(frame_, phase)
    for k in range(0, 36, together):
        for start, stop in pairwise(edges):
            lines = slice(start, stop)
            some.add_lines(frames[k : k + together, lines], lines)
            others.add_lines(frames[k : k + together, lines], phases[k : k + together], lines)
    for expected, found in ((one, some), (first, others)):
        np.testing.assert_array_equal(
            expected.separate().direct_light, found.separate().direct_light
        )
        np.testing.assert_array_equal(
            expected.separate().global_light, found.separate().global_light
        )
    assert np.isnan(some.separate().direct_light[2, 5, 1])


def test_lines_that_lack_a_frame_are_refused() -> None:
    frames = np.zeros((4, *SHAPE), np.float32)
    extrema, sinusoid = ExtremaSeparation(SHAPE), SinusoidSeparation(SHAPE)
    lines = slice(0, 20)
    extrema.add_lines(frames[:, lines], lines)
    with pytest.raises(ValueError, match="some lines were added of 0 frames, others of 4"):
        extrema.separate()
    sinusoid.add_lines(frames[:, lines], [0.0, 1.0, 2.0, 3.0], lines)
    with pytest.raises(ValueError, match="some lines were added of 0 frames, others of 1"):
        sinusoid.separate()
    with pytest.raises(ValueError, match=r"\(4, 20, 36, 3\).*\(3, 36, 3\)"):
        extrema.add_lines(frames[:, lines], slice(20, 23))
    with pytest.raises(ValueError, match="follow one another"):
        extrema.add_lines(frames[:, ::2], slice(0, 24, 2))
