"""Frames are predicted from where each place lies in the period of the pattern."""

from __future__ import annotations

import numpy as np
import pytest

from processing.patterns import Family, Pattern
from processing.proof.phases import Phases

CHECKERS = [Pattern(Family.CHECKER, 12, down, right) for down in (0, 8, 16) for right in (0, 4, 8)]
STRIPES = [Pattern(Family.STRIPES_ROWS, 20, shift) for shift in (0, 8, 16, 24, 32)]
WAVES = [Pattern(Family.SINUSOID_COLUMNS, 16, 0, shift) for shift in (0, 8, 16, 24)]


@pytest.mark.parametrize(
    ("patterns", "certain_part"),
    [
        # A product of three by three signs: any one follows from the others.
        pytest.param(CHECKERS, 0.9, id="checkers without complements"),
        # Of the period's ten cells four differ from a neighbour in the missing frame alone.
        pytest.param(STRIPES, 0.5, id="five stripes"),
        pytest.param(WAVES, 0.9, id="sinusoids"),
    ],
)
def test_what_is_certain_is_right(patterns: list[Pattern], certain_part: float) -> None:
    codes = np.stack([pattern.code((48, 48)).ravel() for pattern in patterns])
    height = np.linspace(0.1, 0.4, codes.shape[1])
    noise = np.full(codes.shape[1], 1e-4)
    deviations = height * (2 * codes - 1)
    deviations += np.random.default_rng(5).normal(0, 0.01, deviations.shape)
    phases = Phases.of(patterns)
    for k in range(len(patterns)):
        believed = np.arange(len(patterns)) != k
        expected, variance = phases.predicted(deviations, noise, believed, k)
        looked_at = np.isfinite(variance)
        certain = looked_at & (variance < 0.15 * height**2)
        assert certain.sum() >= certain_part * looked_at.sum()
        off = np.abs(expected - deviations[k])[certain] / height[certain]
        # A standard deviation is at most √0.15; twice that holds for all but a few.
        assert np.mean(off > 2 * np.sqrt(0.15)) < 0.05


def test_nothing_is_predicted_from_nothing() -> None:
    phases = Phases.of(STRIPES)
    expected, variance = phases.predicted(np.zeros((5, 9)), np.ones(9), np.zeros(5, bool), 0)
    assert not expected.any()
    assert np.isinf(variance).all()
