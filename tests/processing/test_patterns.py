from __future__ import annotations

import numpy as np
import pytest

from processing.patterns import (
    Family,
    Pattern,
    balanced,
    gray_code,
    shift_grid,
    untoggled_fraction,
)

PAPER_PITCHES = range(8, 97, 4)


def checkers(pitch_px: int, span: tuple[int, int] = (2, 1)) -> tuple[Pattern, ...]:
    grid = shift_grid(pitch_px, (6, 6), span)
    return tuple(Pattern(Family.CHECKER, pitch_px, *shift) for shift in grid)


@pytest.mark.parametrize("pitch_px", PAPER_PITCHES)
def test_default_grid_is_36_rasters_that_toggle_everything(pitch_px: int) -> None:
    patterns = checkers(pitch_px)
    period = (2 * pitch_px, 2 * pitch_px)
    rasters = [pattern.raster(period) for pattern in patterns]
    assert len({raster.tobytes() for raster in rasters}) == 36
    assert untoggled_fraction(patterns) == 0
    assert balanced(patterns)
    for first, second in zip(rasters[:18], rasters[18:], strict=True):
        assert np.array_equal(first, 255 - second)


@pytest.mark.parametrize(
    ("span", "different"), [pytest.param((2, 2), 18, id="2x2"), pytest.param((1, 1), 36, id="1x1")]
)
def test_other_spans_are_worse(span: tuple[int, int], different: int) -> None:
    patterns = checkers(24, span)
    assert len({pattern.raster((48, 48)).tobytes() for pattern in patterns}) == different


def test_one_pitch_by_one_leaves_pixels_untoggled() -> None:
    patterns = checkers(24, (1, 1))
    codes = np.stack([pattern.code((48, 48)) for pattern in patterns])
    stuck = (codes.max(axis=0) == codes.min(axis=0)).mean()
    assert stuck > 0
    assert untoggled_fraction(patterns) == pytest.approx(stuck)
    assert not balanced(patterns)


def test_checker_is_what_the_definition_says() -> None:
    raster = Pattern(Family.CHECKER, 5, shift_y_px=3, shift_x_px=7).raster((23, 31))
    for y in range(23):
        for x in range(31):
            lit = ((x + 7) // 5 + (y + 3) // 5) % 2 == 0
            assert raster[y, x] == 255 * lit


@pytest.mark.parametrize(
    ("family", "axis"),
    [
        pytest.param(Family.STRIPES_COLUMNS, 0, id="columns"),
        pytest.param(Family.STRIPES_ROWS, 1, id="rows"),
        pytest.param(Family.SINUSOID_COLUMNS, 0, id="sinusoid columns"),
        pytest.param(Family.SINUSOID_ROWS, 1, id="sinusoid rows"),
    ],
)
def test_stripes_and_sinusoids_vary_one_way(family: Family, axis: int) -> None:
    code = Pattern(family, 4).code((24, 40))
    assert np.ptp(code, axis=axis).max() == 0
    assert np.ptp(code, axis=1 - axis).min() == pytest.approx(1)


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_sinusoid_through_the_projector_is_a_sinusoid(gamma: float) -> None:
    pattern = Pattern(Family.SINUSOID_COLUMNS, 16, shift_x_px=5)
    emitted = (pattern.raster((2, 320), gamma) / 255) ** gamma
    half_a_step = 0.5 * gamma / 255
    assert np.abs(emitted - pattern.code((2, 320))).max() <= half_a_step + 1e-3


def test_references() -> None:
    assert (Pattern(Family.WHITE).raster((3, 4)) == 255).all()
    assert (Pattern(Family.BLACK).raster((3, 4)) == 0).all()


@pytest.mark.parametrize(
    "text",
    [
        "white",
        "black",
        "checker:8:0,2",
        "stripes-columns:16:4",
        "stripes-rows:16:4",
        "sinusoid-columns:9:1",
        "sinusoid-rows:9:1",
    ],
)
def test_text_round_trip(text: str) -> None:
    assert str(Pattern.parse(text)) == text


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        pytest.param("chequer:8", "is no pattern", id="unknown"),
        pytest.param("checker", "at least 1 px", id="no pitch"),
        pytest.param("checker:8.5", "whole projector pixels", id="fraction"),
        pytest.param("checker:8:1", "takes 2 shift", id="one shift"),
        pytest.param("stripes-rows:8:1,2", "takes 1 shift", id="two shifts"),
        pytest.param("checker:8:-1,0", "count from 0", id="negative"),
        pytest.param("white:8", "neither pitch nor shift", id="white with pitch"),
    ],
)
def test_what_is_no_pattern(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        Pattern.parse(text)


@pytest.mark.parametrize(("shifts_px", "even"), [([0, 8, 16, 24], True), ([0, 4, 8], False)])
def test_sinusoids_are_balanced_when_their_shifts_divide_the_period(
    shifts_px: list[int], even: bool
) -> None:
    patterns = [Pattern(Family.SINUSOID_ROWS, 16, shift_y_px=shift) for shift in shifts_px]
    assert balanced(patterns) is even
    mean = np.mean([pattern.code((32, 1)) for pattern in patterns], axis=0)
    assert bool(np.ptp(mean) < 1e-9) is even


def test_a_pair_of_stripes_one_pitch_apart_is_balanced() -> None:
    pair = [Pattern(Family.STRIPES_COLUMNS, 16, shift_x_px=shift) for shift in (0, 16)]
    assert balanced(pair)
    assert untoggled_fraction(pair) == 0


def test_a_pitch_of_any_size_is_judged_at_once() -> None:
    patterns = [Pattern(Family.CHECKER, 100_000, *shift) for shift in shift_grid(100_000, (6, 6))]
    assert untoggled_fraction(patterns) == 0


@pytest.mark.parametrize("text", ["uniform:128", "uniform:255,0,7", "focus:4"])
def test_calibration_patterns_read_as_written(text: str) -> None:
    pattern = Pattern.parse(text)
    assert str(pattern) == text
    assert not pattern.family.is_separable


@pytest.mark.parametrize(
    "text", ["uniform", "uniform:256", "uniform:1,2", "uniform:-1", "uniform:x", "focus", "white:1"]
)
def test_levels_and_charts_that_make_no_sense(text: str) -> None:
    with pytest.raises(ValueError, match=r"uniform|focus|white"):
        Pattern.parse(text)


def test_uniform_levels_are_shown_as_given_whatever_the_response() -> None:
    light = np.linspace(0, 1, 256)[np.newaxis] ** 3
    assert np.all(Pattern.parse("uniform:37").raster((3, 4), 2.2, light) == 37)
    assert np.all(Pattern.parse("uniform:1,2,3").raster((3, 4), 2.2) == (1, 2, 3))


@pytest.mark.parametrize("size_px", [96, 100, 128, 129, 1920])
@pytest.mark.parametrize("rows", [False, True])
def test_bits_and_complements_number_every_line(size_px: int, *, rows: bool) -> None:
    n_bits = int(size_px - 1).bit_length()
    resolution = (size_px, 2) if rows else (2, size_px)
    number = np.zeros(size_px, int)
    before = np.zeros(size_px, int)
    for bit in reversed(range(n_bits)):
        code = gray_code(bit, n_bits, rows=rows)
        shown = code.code(resolution)
        other = gray_code(bit, n_bits, rows=rows, complement=True).code(resolution)
        assert np.all(shown + other == 1)
        assert code.pitch_px < size_px
        before ^= (shown[:, 0] if rows else shown[0]).astype(int)
        number |= before << bit
    assert np.array_equal(number, np.arange(size_px))


def test_a_measured_response_makes_sinusoids_straight() -> None:
    light = (np.arange(256) / 255)[np.newaxis] ** np.array([[1.8], [2.2], [2.6]])
    pattern = Pattern(Family.SINUSOID_COLUMNS, 16)
    raster = pattern.raster((2, 64), light=light)
    assert raster.shape == (2, 64, 3)
    emitted = np.stack([light[k][raster[..., k]] for k in range(3)], axis=-1)
    # Half a level where the response is steepest: 2.6/255/2.
    assert np.abs(emitted - pattern.code((2, 64))[..., np.newaxis]).max() < 0.0052


def test_the_chart_has_fine_checks_white_and_black() -> None:
    code = Pattern.parse("focus:2").code((64, 64))
    assert np.array_equal(code[:2, :4], [[1, 1, 0, 0], [1, 1, 0, 0]])
    assert np.all(code[:16, 16:32] == 1)
    assert np.all(code[16:32, :16] == 0)
