"""Elementary functions: right, and the same bits everywhere."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from processing.numerics import elementary

Array = NDArray[np.float64]

# Twice what a polynomial of rounded coefficients, a reduction and a product may lose together.
MOST_ULPS = 4.0


@pytest.mark.parametrize(
    ("function", "reference", "values"),
    [
        pytest.param(elementary.exp, np.exp, np.linspace(-708, 709, 200_001), id="exp"),
        pytest.param(elementary.exp, np.exp, np.linspace(-1, 1, 200_001), id="exp near 0"),
        pytest.param(elementary.log, np.log, np.linspace(1e-3, 4, 200_001), id="log"),
        pytest.param(elementary.log, np.log, 10.0 ** np.arange(-307, 308), id="log far"),
    ],
)
def test_the_last_places_alone_differ(
    function: Callable[[Array], Array], reference: Callable[..., Array], values: Array
) -> None:
    exact = reference(values.astype(np.longdouble))
    ulps = np.abs(function(values) - exact) / np.spacing(np.abs(exact.astype(np.float64)))
    assert float(ulps.max()) < MOST_ULPS


@pytest.mark.parametrize("largest", [10.0, 1e5, 4e6])
def test_angles(largest: float) -> None:
    angles = np.linspace(-largest, largest, 200_001)
    exact = angles.astype(np.longdouble)
    for function, reference in ((elementary.cos, np.cos), (elementary.sin, np.sin)):
        assert float(np.abs(function(angles) - reference(exact)).max()) < MOST_ULPS * 2**-53


def test_the_normal_distribution() -> None:
    deviates = np.linspace(-14, 10, 200_001)
    share = elementary.normal(deviates)
    assert np.abs(share - ndtr(deviates)).max() < 2e-14
    inner = deviates >= -12
    assert np.abs(share[inner] / ndtr(deviates[inner]) - 1).max() < 1e-10
    assert not share[~inner].any()
    assert share.min() >= 0
    assert share.max() <= 1


@pytest.mark.parametrize(
    ("function", "value", "found"),
    [
        (elementary.exp, -np.inf, 0.0),
        (elementary.exp, -745.1, 5e-324),
        (elementary.exp, 0.0, 1.0),
        (elementary.exp, 709.7, np.exp(709.7)),
        (elementary.exp, 710.0, np.inf),
        (elementary.exp, np.nan, np.nan),
        (elementary.log, 0.0, -np.inf),
        (elementary.log, 1.0, 0.0),
        (elementary.log, -1.0, np.nan),
        (elementary.log, np.inf, np.inf),
        (elementary.log, np.nan, np.nan),
        (elementary.cos, 0.0, 1.0),
        (elementary.cos, np.inf, np.nan),
        (elementary.sin, 0.0, 0.0),
        (elementary.sin, np.nan, np.nan),
        (elementary.normal, 0.0, 0.5),
        (elementary.normal, np.inf, 1.0),
        (elementary.normal, -np.inf, 0.0),
        (elementary.normal, np.nan, np.nan),
    ],
)
def test_ends(function: Callable[[float], Array], value: float, found: float) -> None:
    np.testing.assert_allclose(function(value), found, rtol=1e-15)


@pytest.mark.parametrize(
    ("function", "least", "most", "digest"),
    [
        (elementary.exp, -746.0, 711.0, "b3791ed97d950411"),
        (elementary.log, 1e-9, 50.0, "f4ed0180356af1f6"),
        (elementary.cos, -3e4, 3e4, "f040ca6e3c08fa7a"),
        (elementary.sin, -3e4, 3e4, "ae2b668724ed4faa"),
        (elementary.normal, -13.0, 10.0, "ebf0c56ea64c51b0"),
    ],
)
def test_bits_do_not_depend_on_the_processor(
    function: Callable[[Array], Array], least: float, most: float, digest: str
) -> None:
    """Recorded once; an x86-64 without fused or wide instructions gave the same."""
    # Multiples of a power of 2, so that the values themselves are exact.
    values = np.arange(int(least * 64), int(most * 64)) / 64
    values = values[values >= least]
    found = np.concatenate([function(values), function(values / 1024)])
    assert hashlib.sha256(found.astype("<f8").tobytes()).hexdigest()[:16] == digest


def test_angles_of_points() -> None:
    turn = np.linspace(-np.pi, np.pi, 100_001)[1:-1]
    for length in (1e-200, 1.0, 1e200):
        found = elementary.arctan2(length * np.sin(turn), length * np.cos(turn))
        assert np.abs(found - turn).max() < MOST_ULPS * np.spacing(np.pi)
    points = [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-2.0, 0.0), (3.0, -3.0), (0.0, 0.0)]
    found = elementary.arctan2(*np.array(points).T)
    assert found.tolist() == [0.0, np.pi, np.pi / 2, -np.pi / 2, 0.75 * np.pi, 0.0]
    assert np.isnan(elementary.arctan2(np.nan, 1.0))


def test_turns_and_their_sines() -> None:
    angles = np.linspace(-50, 50, 10_001)
    np.testing.assert_allclose(elementary.turned(angles), np.exp(1j * angles), atol=1e-15)
    np.testing.assert_allclose(elementary.sinc(angles), np.sinc(angles), atol=1e-15)
    assert elementary.sinc(0.0) == 1


def test_deviates_are_the_inverse() -> None:
    deviates = np.linspace(-11, 5, 1001)
    found = elementary.deviate(ndtr(deviates))
    # Above 0 the share itself is known to its rounding alone.
    density = np.exp(-(deviates**2) / 2) / np.sqrt(2 * np.pi)
    assert np.all(np.abs(found - deviates) < 1e-9 + 2e-14 / density * (deviates > 0))
    assert elementary.deviate(0.5) == 0
