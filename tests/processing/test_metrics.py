"""Errors whose value follows from how the estimate was made."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.metrics import (
    best_assignment,
    errors_of,
    oracle,
    relative_error,
    relative_error_with_gains,
)

SHAPE = (20, 30, 3)
EVERYWHERE = np.ones(SHAPE[:2], bool)


def image(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(0.1, 1, SHAPE).astype(np.float32)


def test_a_gain_is_an_error_unless_gains_are_free() -> None:
    truth = image(0)
    estimate = truth * np.array([0.5, 2.0, -1.0], np.float32)
    expected = np.linalg.norm(truth * np.array([-0.5, 1, -2])) / np.linalg.norm(truth)
    assert relative_error(estimate, truth, EVERYWHERE) == pytest.approx(expected, rel=1e-6)
    assert relative_error_with_gains(estimate, truth, EVERYWHERE) == pytest.approx(0, abs=1e-6)
    assert relative_error(truth, truth, EVERYWHERE) == 0


def test_the_best_gain_is_the_best() -> None:
    truth, estimate = image(0), image(1)
    least = min(
        relative_error((gain * estimate).astype(np.float32), truth, EVERYWHERE)
        for gain in np.linspace(0.5, 1.5, 2001)
    )
    grey_truth, grey = truth[..., :1], estimate[..., :1]
    found = relative_error_with_gains(estimate, truth, EVERYWHERE)
    assert found <= least
    assert relative_error_with_gains(grey, grey_truth, EVERYWHERE) == pytest.approx(
        min(
            relative_error((gain * grey).astype(np.float32), grey_truth, EVERYWHERE)
            for gain in np.linspace(0.5, 1.5, 2001)
        ),
        rel=1e-5,
    )


def test_masked_pixels_do_not_count() -> None:
    truth, estimate = image(0), image(0)
    mask = EVERYWHERE.copy()
    mask[:5] = False
    estimate[:5] = np.nan
    assert relative_error(estimate, truth, mask) == 0
    assert relative_error_with_gains(estimate, truth, mask) == pytest.approx(0, abs=1e-6)


def test_a_dark_truth_has_no_relative_error() -> None:
    assert np.isnan(relative_error(image(0), np.zeros(SHAPE, np.float32), EVERYWHERE))


def test_blind_components_find_their_truth() -> None:
    truths = np.stack([image(0), image(1), image(2)])
    noise = 0.01 * np.random.default_rng(7).standard_normal(truths.shape).astype(np.float32)
    shuffled = np.stack([3 * truths[2], -truths[0], 0.2 * truths[1], image(9)])
    found = best_assignment(shuffled, truths, EVERYWHERE)
    assert found.components == (1, 2, 0)
    np.testing.assert_allclose(found.errors, 0, atol=1e-6)
    assert best_assignment(shuffled[:3] + noise, truths[1:], EVERYWHERE).components == (2, 0)


def test_assignment_refuses_what_has_no_answer() -> None:
    with pytest.raises(ValueError, match=r"\(1, 20, 30, 3\).*\(2, 20, 30, 3\)"):
        best_assignment(image(0)[np.newaxis], np.stack([image(0), image(1)]), EVERYWHERE)
    with pytest.raises(ValueError, match="dark"):
        best_assignment(image(0)[np.newaxis], np.zeros((1, *SHAPE), np.float32), EVERYWHERE)


def test_the_oracle_chooses_the_best_pitch() -> None:
    direct, global_ = image(0), image(1)
    leaks = [0.3, 0.1, 0.2]
    rows = (direct + np.float32(leak) * global_ for leak in leaks)
    errors = errors_of(rows, direct, EVERYWHERE)
    for pitch, leak in zip(errors, leaks, strict=True):
        assert 0 < pitch.error_after_gains < pitch.error
        assert pitch.error == pytest.approx(
            leak * np.linalg.norm(global_) / np.linalg.norm(direct), rel=1e-5
        )
    assert oracle(errors).index == 1
    assert errors[0].index == 0


def test_shapes_that_do_not_fit_are_named() -> None:
    with pytest.raises(ValueError, match=r"\(20, 30, 3\), \(20, 30, 1\) and \(20, 30\)"):
        relative_error(image(0), image(0)[..., :1], EVERYWHERE)
