"""Noise against signal from pairs of equal frames: the photon transfer method.

The variance of a value is that of the read-out plus that of the light, which is proportional to
it (Janesick, Photon Transfer, 2007; EMVA 1288 release 4.0, eq. 14):

    σ²(s) = σ_r² + s/N,

s the signal in fractions of the sensor's range and N the electrons that fill that range. The
difference of two frames of the same scene holds nothing but noise, twice its variance, whatever
the scene looks like: no flat field is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import UnsupportedError

Image = NDArray[np.float32]
Array = NDArray[np.float64]

_BINS = np.linspace(-0.02, 1.0, 52)
_LEAST_PIXELS = 100
_LEAST_POINTS = 5
_LEAST_RISE_DEVIATIONS = 5.0
_LEAST_SPAN = 0.1
_ROUNDS = 4


@dataclass(frozen=True, slots=True)
class TransferPoints:
    """Variance at signals, for one colour; (points,) each.

    Parameters
    ----------
    signal
        Mean of the pixels in a bin, fraction of the sensor's range.
    variance
        Of one frame's value, the same unit squared.
    pixels
        Number of pixels that it was measured on.
    """

    signal: Array
    variance: Array
    pixels: Array


@dataclass(frozen=True, slots=True)
class NoiseLine:
    """σ²(s) = constant + rise·s of one colour.

    Parameters
    ----------
    constant, rise
        Variance at signal 0 and its rise, fractions of the range squared.
    covariance
        (2, 2), of (constant, rise), scaled by the misfit where that is above 1.
    reduced_chi_square
        Misfit per degree of freedom: about 1 where the line holds.
    residuals
        (points,): measured over fitted variance, less 1.
    """

    constant: float
    rise: float
    covariance: Array
    reduced_chi_square: float
    residuals: Array


class TransferPairs:
    """Collects pairs of frames of the same light; holds no image."""

    def __init__(self, n_colours: int = 3) -> None:
        self._points: list[list[tuple[float, float, int]]] = [[] for _ in range(n_colours)]

    def add(self, first: Image, second: Image, usable: NDArray[np.bool_]) -> None:
        """Two frames of the same scene, (height, width, colours), and where both count.

        What moves the whole of a bin between the two, a lamp that changed, is taken off.
        """
        if first.shape != second.shape or usable.shape != first.shape[:2]:
            raise ValueError(f"frames {first.shape} and {second.shape}, usable {usable.shape}")
        for colour, points in enumerate(self._points):
            one, other = (
                image[..., colour][usable].astype(np.float64) for image in (first, second)
            )
            mean, step = (one + other) / 2, one - other
            place = np.digitize(mean, _BINS)
            counts, means, steps, squares = (
                np.bincount(place, weights, len(_BINS) + 1)
                for weights in (np.ones_like(mean), mean, step, step**2)
            )
            for k in np.flatnonzero(counts >= _LEAST_PIXELS):
                n = counts[k]
                variance = (squares[k] - steps[k] ** 2 / n) / (n - 1) / 2
                points.append((means[k] / n, variance, int(n)))

    def points(self) -> tuple[TransferPoints, ...]:
        """All bins of all pairs, one set for each colour."""
        return tuple(
            TransferPoints(*np.array(points, np.float64).reshape(-1, 3).T)
            for points in self._points
        )


def fit_noise_line(points: TransferPoints) -> NoiseLine:
    """Weighted least squares of the variance against the signal.

    The variance of a variance from n pixels is 2σ⁴/(n − 1); σ comes from the line itself, four
    times over.

    Raises
    ------
    UnsupportedError
        Too few signals, too narrow a range, or no rise that stands out from its error.
    """
    signal, variance = points.signal, points.variance
    if len(signal) < _LEAST_POINTS or np.ptp(signal) < _LEAST_SPAN:
        span = np.ptp(signal) if len(signal) else 0.0
        raise UnsupportedError(
            f"the pairs of frames cover {100 * span:.0f} % of the sensor's range in {len(signal)} "
            "usable groups of pixels; a noise line needs 10 % and 5: expose so that white reaches "
            "half of the range and more, unsaturated"
        )
    design = np.stack([np.ones_like(signal), signal], axis=1)
    model = np.maximum(variance, variance[variance > 0].min() if np.any(variance > 0) else 1e-12)
    for _ in range(_ROUNDS):
        weight = np.sqrt((points.pixels - 1) / 2) / model
        line, *_ = np.linalg.lstsq(design * weight[:, np.newaxis], variance * weight, rcond=None)
        model = np.maximum(design @ line, 1e-3 * model)
    misfit = (variance - design @ line) * weight
    chi_square = float(misfit @ misfit) / max(len(signal) - 2, 1)
    normal = (design * weight[:, np.newaxis]).T @ (design * weight[:, np.newaxis])
    covariance = np.asarray(np.linalg.inv(normal) * max(chi_square, 1.0), np.float64)
    if line[1] <= _LEAST_RISE_DEVIATIONS * np.sqrt(covariance[1, 1]):
        raise UnsupportedError(
            "the noise does not rise with the light: there is no shot noise to measure the camera "
            "by. The frames are too dark, were smoothed in the camera, or are of a simulated "
            "bench without full_well_e; expose more, in raw, without noise reduction"
        )
    return NoiseLine(
        constant=float(line[0]),
        rise=float(line[1]),
        covariance=covariance,
        reduced_chi_square=chi_square,
        residuals=variance / (design @ line) - 1,
    )


@dataclass(frozen=True, slots=True)
class Linearity:
    """How far the signal is proportional to the exposure time.

    Parameters
    ----------
    signal
        (bins,): middle of each bin of signal, fraction of the range.
    deviation
        (bins,): mean relative departure from proportionality.
    linear_to
        Signal up to which it stays within `tolerance`, as far as was measured.
    tolerance
        Of the departure, relative.
    reached
        Largest signal that was measured unsaturated.
    """

    signal: Array
    deviation: Array
    linear_to: float
    tolerance: float
    reached: float


def fit_linearity(
    exposures_s: Sequence[float], signals: Array, usable: NDArray[np.bool_], tolerance: float = 0.01
) -> Linearity:
    """Departure from proportionality (EMVA 1288 release 4.0, section 7.2).

    Each place of the scene has its own rate, signal over time, by least squares over its signals
    below half of the range; what its brighter signals miss it by is collected by signal.

    Parameters
    ----------
    exposures_s
        (times,), seconds; at least three different ones.
    signals
        (times, places): means over small blocks of pixels, dark light subtracted.
    usable
        (times, places): no pixel of the block was saturated.
    tolerance
        Largest relative departure that counts as linear.
    """
    times = np.asarray(exposures_s, np.float64)
    if signals.shape != usable.shape or signals.shape[0] != len(times):
        raise ValueError(f"signals {signals.shape}, usable {usable.shape} for {len(times)} times")
    if len(np.unique(times)) < 3:
        raise UnsupportedError("linearity needs three exposure times; the camera gave fewer")
    low = usable & (signals < 0.5) & (signals > 0.002)
    column = times[:, np.newaxis]
    weights = (low * column**2).sum(axis=0)
    known = low.sum(axis=0) >= 2
    if not known.any():
        raise UnsupportedError(
            "no part of the scene is unsaturated and lit at two exposure times: expose less"
        )
    rate = (low * signals * column).sum(axis=0)[known] / weights[known]
    expected = column * rate
    counted = usable[:, known] & (expected > 0.01)
    departure = signals[:, known][counted] / expected[counted] - 1
    level = signals[:, known][counted]
    edges = np.linspace(0, 1, 21)
    place = np.digitize(level, edges) - 1
    bins = [k for k in range(20) if np.sum(place == k) >= 5]
    middle = np.array([level[place == k].mean() for k in bins])
    mean = np.array([np.median(departure[place == k]) for k in bins])
    bad = np.flatnonzero(np.abs(mean) > tolerance)
    reached = float(level.max()) if len(level) else 0.0
    linear_to = reached if not len(bad) else float(edges[bins[bad[0]]])
    return Linearity(middle, mean, linear_to, tolerance, reached)
