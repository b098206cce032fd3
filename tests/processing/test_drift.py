"""Drift from repeated references whose light is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.frames.drift import Course, Drift, Level, measure_drift

RNG = np.random.default_rng(17)
SHAPE = (40, 50, 3)
LIGHT = RNG.uniform(0.05, 0.8, SHAPE)
DARK = RNG.uniform(0.0, 0.02, SHAPE)
ALL = np.ones(SHAPE[:2], bool)
NOISE = 0.005


def drift_of(
    gain: NDArray[np.float64],
    offset: NDArray[np.float64] | None = None,
    noise: float = NOISE,
    order: NDArray[np.int64] | None = None,
) -> Drift:
    """Measured on references of the given gains and offsets, (n, colours) or (n,)."""
    count = len(gain)
    order = np.arange(count) * 100 if order is None else order
    offset = np.zeros(count) if offset is None else offset
    whites, blacks = list[Level](), list[Level]()
    for k in range(count):
        black = DARK + offset[k]
        for levels, image in ((whites, black + gain[k] * LIGHT), (blacks, black)):
            seen = (image + RNG.normal(0, noise, SHAPE)).astype(np.float32)
            levels.append(Level(int(order[k]), seen))
    found = measure_drift(whites, blacks, ALL)
    assert found is not None
    return found


def test_gain_and_offset_are_found_within_their_errors_colour_by_colour() -> None:
    gain = np.array([[1, 1, 1], [1.03, 0.99, 1.0], [1.06, 0.98, 1.002]])
    offset = np.array([0, 0.004, 0.009])
    found = drift_of(gain, offset)
    # Noise of a thousand bright pixels: 0.5 % over a light of 0.6, two frames, median.
    assert found.gain.errors[1:].max() < 0.001
    assert (np.abs(found.gain.values - gain) <= 4.5 * found.gain.errors + 1e-9).all()
    off = np.abs(found.offset.values - offset[:, np.newaxis])
    assert (off <= 4.5 * found.offset.errors + 1e-9).all()
    assert found.course is Course.SMOOTH


@pytest.mark.parametrize(
    ("gain", "course"),
    [
        pytest.param([1, 1, 1, 1, 1], Course.STEADY, id="none"),
        pytest.param([1, 1.0005, 1.001, 1.0015], Course.STEADY, id="too little to be seen"),
        pytest.param([1, 1.05, 1.1, 1.15], Course.SMOOTH, id="line"),
        pytest.param([1, 0.97], Course.SMOOTH, id="two"),
        pytest.param([1, 1.01, 1.016, 1.019, 1.021], Course.SMOOTH, id="warming up"),
        pytest.param([1, 1, 1, 0.93], Course.ROUGH, id="step at the end"),
        pytest.param([1, 0.93, 0.93, 0.93], Course.ROUGH, id="step at the start"),
        pytest.param([1, 1, 1.006, 1.006], Course.ROUGH, id="small step"),
        pytest.param([1, 1.006, 0.996, 1.007, 0.999], Course.ROUGH, id="flicker"),
    ],
)
def test_the_course_of_the_light(gain: list[float], course: Course) -> None:
    assert drift_of(np.array(gain)).course is course


def test_a_rise_of_the_black_level_alone_leaves_the_gain_at_one() -> None:
    found = drift_of(np.ones(4), np.array([0, 0.003, 0.006, 0.009]))
    assert found.course is Course.SMOOTH
    seen = found.seen()
    assert (seen.gain.values == 1).all()
    assert seen.offset.values[-1] == pytest.approx(0.009, abs=0.001)


def test_between_references_it_goes_in_a_line_and_beyond_them_it_stays() -> None:
    found = drift_of(np.array([1, 1.1, 1.3]), noise=0.0, order=np.array([10, 20, 40]))
    at = found.gain.at(np.array([0, 10, 15, 30, 40, 99]))
    assert at[:, 1] == pytest.approx([1, 1, 1.05, 1.2, 1.3, 1.3], abs=1e-6)


def test_a_shadow_and_saturated_pixels_do_not_count() -> None:
    first, second = LIGHT.astype(np.float32), (1.05 * LIGHT).astype(np.float32)
    clipped = Level(9, np.minimum(second, 0.5))
    usable = np.all(second < 0.5, axis=-1)
    saturated = measure_drift([Level(0, first), clipped], [], np.asarray(usable))
    second[:8] *= 0.2
    shadowed = measure_drift([Level(0, first), Level(9, second)], [], ALL)
    assert shadowed is not None
    assert saturated is not None
    assert shadowed.gain.values[1] == pytest.approx(1.05, abs=1e-4)
    assert saturated.gain.values[1] == pytest.approx(1.05, abs=1e-4)


def test_noise_that_chooses_the_pixels_does_not_make_a_drift() -> None:
    """A flat board, much noise: which pixels are the brightest is chance."""
    whites = [Level(k, (0.5 + RNG.normal(0, 0.05, SHAPE)).astype(np.float32)) for k in range(2)]
    found = measure_drift(whites, [], ALL)
    assert found is not None
    assert np.abs(found.gain.values - 1).max() < 4.5 * found.gain.errors.max()


def test_without_light_nothing_is_said() -> None:
    dark = [Level(k, np.zeros(SHAPE, np.float32)) for k in range(2)]
    assert measure_drift(dark, dark, ALL) is None
    assert measure_drift([], dark, ALL) is None
    assert measure_drift(dark, dark, ~ALL) is None
