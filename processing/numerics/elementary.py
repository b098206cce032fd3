"""Elementary functions that give the same bits on every processor.

The system's mathematical library and numpy choose their code by the processor: where it fuses a
multiplication with an addition, or takes another polynomial in wide registers, last bits differ,
and a decision that hangs on them may fall differently. These are polynomials and tables, evaluated
in one order from additions, multiplications, divisions and roots alone, which IEEE 754 fixes to
the bit; numba fuses none of them. They are right to a few units in the last place.

Each takes a number or an array of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
_Floats = TypeVar("_Floats", NDArray[np.float64], NDArray[np.float32])

_LOG2_E = float.fromhex("0x1.71547652b82fep+0")
# ln 2 and π/2 in parts, of which all but the last have so few digits that small multiples of them
# are exact.
_LN2 = (float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33"))
_HALF_PI = (
    float.fromhex("0x1.921fb544p+0"),
    float.fromhex("0x1.0b4611a6p-34"),
    float.fromhex("0x1.3198a2e037073p-69"),
)
# Angles beyond lose digits when whole turns are taken off.
_FARTHEST = 2.0**22
_SMALLEST_POWER = -1074
_POWERS = np.ldexp(1.0, np.arange(_SMALLEST_POWER, 1024))
_ROOT_HALF = math.sqrt(0.5)
# Taylor coefficients, the highest first: of exp, and of atanh, sin and cos in squares.
_EXP = tuple(1 / math.factorial(k) for k in range(13, -1, -1))
_ATANH = tuple(1 / (2 * k + 1) for k in range(12, -1, -1))
_SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(8, -1, -1))
_ARCTAN = tuple((-1) ** k / (2 * k + 1) for k in range(12, -1, -1))
_COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(9, -1, -1))
# Of Φ: the deviates between which it is tabulated, entries a unit, terms of each.
_LEAST_DEVIATE, _MOST_DEVIATE = -12, 9
_ENTRIES = 16
_TERMS = 10
_FRACTIONS = 60
_NEWTON_STEPS = 4


def exp(values: ArrayLike) -> Array:
    """The exponential function."""
    return _each(_exp, values)


def log(values: ArrayLike) -> Array:
    """The natural logarithm; −∞ of 0, NaN below."""
    return _each(_log, values)


def cos(values: ArrayLike) -> Array:
    """The cosine of angles in radians, up to some millions; NaN beyond."""
    return _each(_cos, values)


def sin(values: ArrayLike) -> Array:
    """The sine of angles in radians, up to some millions; NaN beyond."""
    return _each(_sin, values)


def arctan2(heights: ArrayLike, widths: ArrayLike) -> Array:
    """The angle of points (width, height), in [−π, π]."""
    y, x = np.broadcast_arrays(np.asarray(heights, np.float64), np.asarray(widths, np.float64))
    found = np.empty(y.shape)
    _angle(y.ravel(), x.ravel(), found.reshape(-1))
    return found


def sinc(values: ArrayLike) -> Array:
    """sin(πx)/(πx)."""
    angles = np.pi * np.asarray(values, np.float64)
    apart = angles != 0
    found: Array = np.where(apart, sin(angles) / np.where(apart, angles, 1.0), 1.0)
    return found


def turned(angles: ArrayLike) -> NDArray[np.complex128]:
    """e^{iφ} of angles in radians."""
    found = np.empty(np.shape(angles), np.complex128)
    found.real, found.imag = cos(angles), sin(angles)
    return found


def deviate(shares: ArrayLike) -> Array:
    """The inverse of `normal`, of shares between 1e-30 and 1 − 1e-15, to some 1e-12."""
    wanted, table = np.asarray(shares, np.float64), _normal_table()[:, 0]
    entry = np.clip(np.searchsorted(table, wanted), 0, len(table) - 1)
    found = _LEAST_DEVIATE + entry / _ENTRIES
    for _ in range(_NEWTON_STEPS):
        density = exp(-(found**2) / 2) / math.sqrt(2 * math.pi)
        found = found - (normal(found) - wanted) / density
    return np.asarray(found, np.float64)


def normal(values: ArrayLike) -> Array:
    """Φ, the part of a normal distribution that lies below a deviate; 0 below −12."""
    deviates = np.asarray(values, np.float64)
    found = np.empty(deviates.shape)
    _normal(np.ascontiguousarray(deviates).reshape(-1), _normal_table(), found.reshape(-1))
    return found


def hypot(first: _Floats, second: _Floats) -> _Floats:
    """√(x² + y²) of numbers whose squares are neither 0 nor infinite by their size alone."""
    return np.sqrt(first * first + second * second)


def _each(function: Callable[[Array, Array], object], values: ArrayLike) -> Array:
    """A function of every value; loops, as numba's own ufuncs mind being met by two threads."""
    given = np.asarray(values, np.float64)
    found = np.empty(given.shape)
    function(given.ravel(), found.reshape(-1))
    return found


@njit(cache=True)
def _exp_of(x):  # type: ignore[no-untyped-def]
    if not x < 709.782712893384:
        return x * np.inf
    if x < -745.2:
        return 0.0
    power = math.floor(x * _LOG2_E + 0.5)
    rest = (x - power * _LN2[0]) - power * _LN2[1]
    found = 0.0
    for coefficient in _EXP:
        found = found * rest + coefficient
    # 2 to the power in two factors: by itself the largest is none, and the smallest is 0.
    half = power // 2
    return found * _POWERS[half - _SMALLEST_POWER] * _POWERS[power - half - _SMALLEST_POWER]


@njit(cache=True)
def _log_of(x):  # type: ignore[no-untyped-def]
    if not 0 < x < np.inf:
        return x if x > 0 else (-np.inf if x == 0 else np.nan)
    mantissa, power = math.frexp(x)
    if mantissa < _ROOT_HALF:
        mantissa, power = 2 * mantissa, power - 1
    ratio = (mantissa - 1) / (mantissa + 1)
    square, found = ratio * ratio, 0.0
    for coefficient in _ATANH:
        found = found * square + coefficient
    return 2 * ratio * found + power * _LN2[1] + power * _LN2[0]


@njit(cache=True)
def _angle_of(y, x):  # type: ignore[no-untyped-def]
    high, wide = abs(y), abs(x)
    larger = max(high, wide)
    if not 0 < larger < np.inf or np.isnan(x + y):
        return x * y * 0.0
    ratio = min(high, wide) / larger
    # Halved twice, so that the series is short.
    for _ in range(2):
        ratio /= 1 + math.sqrt(1 + ratio * ratio)
    square, found = ratio * ratio, 0.0
    for coefficient in _ARCTAN:
        found = found * square + coefficient
    found *= 4 * ratio
    if high > wide:
        found = np.pi / 2 - found
    if x < 0:
        found = np.pi - found
    return math.copysign(found, y)


@njit(cache=True)
def cosine_after(x, quarters):  # type: ignore[no-untyped-def]
    """cos(x + quarters · π/2) of a number, for compiled code."""
    if not abs(x) < _FARTHEST:
        return np.nan
    turns = math.floor(x / (_HALF_PI[0] + _HALF_PI[1]) + 0.5)
    rest = ((x - turns * _HALF_PI[0]) - turns * _HALF_PI[1]) - turns * _HALF_PI[2]
    square, found = rest * rest, 0.0
    quarter = (turns + quarters) % 4
    if quarter % 2:
        for coefficient in _SINE:
            found = found * square + coefficient
        found *= rest
    else:
        for coefficient in _COSINE:
            found = found * square + coefficient
    return -found if quarter in (1, 2) else found


@njit(cache=True, error_model="numpy", forceinline=True)
def turn_each(angles, cosines, sines):  # type: ignore[no-untyped-def]
    """Cosines and sines of some angles at once, for compiled code; NaN beyond some millions.

    Both series are summed for each and one of them is taken: without a choice of ways, several
    angles go side by side.
    """
    for i in range(angles.size):
        x = angles[i]
        turns = math.floor(x / (_HALF_PI[0] + _HALF_PI[1]) + 0.5)
        rest = ((x - turns * _HALF_PI[0]) - turns * _HALF_PI[1]) - turns * _HALF_PI[2]
        square, sine, cosine = rest * rest, 0.0, 0.0
        for coefficient in _SINE:
            sine = sine * square + coefficient
        for coefficient in _COSINE:
            cosine = cosine * square + coefficient
        sine *= rest
        half = 0.5 * turns
        is_odd = half != math.floor(half)
        # +1 in the first two quarters from −π/4 on, −1 in the others; likewise a quarter on.
        sign = 1.0 if 0.5 * math.floor(half) == math.floor(0.5 * math.floor(half)) else -1.0
        one, other = (sine, cosine) if is_odd else (cosine, sine)
        cosines[i] = -sign * one if is_odd else sign * one
        sines[i] = sign * other


@cache
def _normal_table() -> Array:
    """Taylor coefficients of Φ around each entry, (entries, terms), the highest last."""
    deviates = np.arange(_LEAST_DEVIATE * _ENTRIES, _MOST_DEVIATE * _ENTRIES + 1) / _ENTRIES
    density = exp(-(deviates**2) / 2) / math.sqrt(2 * math.pi)
    # Below: Laplace's continued fraction for the tail; else a series of one sign (Marsaglia,
    # Evaluating the normal distribution, J. Stat. Softw. 11, 2004).
    tail, series, term = np.zeros_like(deviates), np.zeros_like(deviates), deviates.copy()
    far, near = np.minimum(deviates, -2.0), np.maximum(deviates, -2.0)
    for k in range(_FRACTIONS, 0, -1):
        tail = k / (tail - far)
    for k in range(1, 4 * _FRACTIONS, 2):
        series += term
        term = term * near * near / (k + 2)
    below = np.where(deviates < -2, density / (tail - far), 0.5 + density * series)
    columns, hermite, before = [below], np.ones_like(deviates), np.zeros_like(deviates)
    for k in range(1, _TERMS):
        columns.append((-1) ** (k - 1) * density * hermite / math.factorial(k))
        hermite, before = deviates * hermite - (k - 1) * before, hermite
    return np.stack(columns, axis=1)


@njit(cache=True)
def _normal(deviates, table, found):  # type: ignore[no-untyped-def]
    for i in range(len(deviates)):
        deviate = deviates[i]
        if _LEAST_DEVIATE <= deviate <= _MOST_DEVIATE:
            entry = math.floor((deviate - _LEAST_DEVIATE) * _ENTRIES + 0.5)
            beyond = deviate - (_LEAST_DEVIATE + entry / _ENTRIES)
            value = 0.0
            for k in range(_TERMS - 1, -1, -1):
                value = value * beyond + table[entry, k]
            found[i] = min(value, 1.0)
        elif deviate > 0:
            found[i] = 1.0
        else:
            found[i] = deviate * 0.0 if np.isnan(deviate) else 0.0


@njit(cache=True)
def _exp(values, found):  # type: ignore[no-untyped-def]
    for i in range(len(values)):
        found[i] = _exp_of(values[i])


@njit(cache=True)
def _log(values, found):  # type: ignore[no-untyped-def]
    for i in range(len(values)):
        found[i] = _log_of(values[i])


@njit(cache=True)
def _cos(values, found):  # type: ignore[no-untyped-def]
    for i in range(len(values)):
        found[i] = cosine_after(values[i], 0)


@njit(cache=True)
def _sin(values, found):  # type: ignore[no-untyped-def]
    for i in range(len(values)):
        found[i] = cosine_after(values[i], 3)


@njit(cache=True)
def _angle(heights, widths, found):  # type: ignore[no-untyped-def]
    for i in range(len(found)):
        found[i] = _angle_of(heights[i], widths[i])
