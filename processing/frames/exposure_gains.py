"""Gain of each frame of a camera whose exposure or white balance was left automatic.

A camera of gain g takes g·(B + T) of the light B of the room and T of a pattern. Light of a pattern
and of its complement add up to white, so with a = 1/g, the white frame's gain taken as 1,

    a₊ I₊ + a₋ I₋ = I_white + a_black I_black

at every pixel that is not saturated, in each colour (`light_sums` solves that). What gains cannot
explain is left. What goes with the level of the light tells of a tone curve, what goes with the
place of other light, of movement or of a lamp that is uneven in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.light_sums import Array, Equations, Fit, Index, equations, fit
from processing.frames.sites import Light

# Gains nearer to 1 than this are not told from none, nor those nearer than so many of their errors.
SMALLEST = 0.005
SURE = 6.0
# Gains explain a pair where they leave less than this part of what it missed white by (half of the
# square), or less than this part of white.
LEAVES = 0.71
LEAVES_OF_WHITE = 0.02
# No camera's gain differs by more between frames of one capture that could be used.
BOUNDS = 0.2, 5.0
# Black frames are often too dark to tell their gain: its deviation beforehand, and afterwards.
_BLACK_UNKNOWN, _BLACK_KNOWN = 1.0, 0.1
_ALIKE_PAIRS = 4
_LEVELS, _CONTRASTS = 6, 4
# Equations of less trust are said not to count.
_DISTRUST = 0.1
# Sums differ by a last bit from one processor to the next; what is rounded so far does not.
_DECIMALS = 6


@dataclass(frozen=True, slots=True)
class Gain:
    """Of a frame, and its standard error, (colours,) each."""

    value: Array
    error: Array

    @property
    def differs(self) -> bool:
        """Whether it differs from 1 by more than noise can make of it."""
        off = np.abs(self.value - 1)
        return bool(np.any(off > np.maximum(SMALLEST, SURE * self.error)))


@dataclass(frozen=True, slots=True)
class PairGains:
    """What was found of a pattern and its complement.

    Parameters
    ----------
    gains
        Of both.
    missed, left
        Root mean square of what both together miss white by, in parts of it and freed from noise:
        as they are, and divided by their gains.
    by_level, by_place
        Part of the square of `left` that goes with the level of the light, and part of it that
        goes with the place in the picture beyond that.
    outlying
        Part of the light whose equations fit so badly that they do not count.
    """

    gains: tuple[Gain, Gain]
    missed: float
    left: float
    by_level: float
    by_place: float
    outlying: float

    @property
    def differs(self) -> bool:
        """Whether one of them differs from 1."""
        return any(gain.differs for gain in self.gains)

    @property
    def fits(self) -> bool:
        """Whether gains explain what it missed."""
        low, high = BOUNDS
        within = all(np.all((one.value > low) & (one.value < high)) for one in self.gains)
        return bool(within and self.left <= max(LEAVES_OF_WHITE, LEAVES * self.missed))


def pair_gains(
    frames: tuple[Light, Light],
    due: Array,
    usable: NDArray[np.bool_],
    tiles: Index,
    due_error: Array | float = 0.0,
) -> PairGains | None:
    """Gains of a pattern and its complement, in all colours.

    Parameters
    ----------
    frames
        Both.
    due
        (2, n, colours): white and black light, at the gain of the white frame.
    usable
        bool, (n,): sites at which the references are not saturated.
    tiles
        Of the sites, (n,).
    due_error
        Standard error of the sum that is due, in parts of it, the same for all pairs, (colours,).

    Returns
    -------
    None where there is too little light.
    """
    usable = usable & frames[0].usable & frames[1].usable
    fits, misfit = [], _Misfit()
    for colour in range(due.shape[-1]):
        both = [_plain(frame, colour) for frame in frames]
        given = equations(both, due[..., colour], usable, tiles)
        found = None if given is None else fit(given, halves=True)
        if given is None or found is None or np.any(found.inverse_gains <= 0):
            return None
        fits.append(found)
        misfit.add(given, found)
    return misfit.pair((_gain(fits, 0, due_error), _gain(fits, 1, due_error)))


def single_gain(frame: Light, other: Light, tiles: Index) -> Gain | None:
    """Gain of a frame against another of the same light; None where there is too little of it."""
    fits = []
    for colour in range(frame.values.shape[-1]):
        one, due = _plain(frame, colour), _plain(other, colour)
        given = equations([one], due, frame.usable & other.usable, tiles)
        found = None if given is None else fit(given, halves=False)
        if found is None or found.inverse_gains[0] <= 0:
            return None
        fits.append(found)
    return _gain(fits, 0)


def black_gain(
    pairs: Sequence[tuple[Light, Light]], references: tuple[Light, Light], tiles: Index
) -> Gain | None:
    """Gain of the black frame, from all patterns and their complements.

    Parameters
    ----------
    pairs
        They.
    references
        White and black.
    tiles
        Of the sites, (n,).

    Returns
    -------
    None where it is too dark to tell.
    """
    white, black = references
    values, errors = [], []
    for colour in range(white.values.shape[-1]):
        weight, weighted = 1 / _BLACK_UNKNOWN**2, 1 / _BLACK_UNKNOWN**2
        for pair in pairs:
            frames = [_plain(frame, colour) for frame in pair]
            usable = white.usable & black.usable & pair[0].usable & pair[1].usable
            terms = [*frames, -_plain(black, colour)]
            given = equations(terms, _plain(white, colour), usable, tiles)
            found = None if given is None else fit(given, halves=True)
            if found is not None and found.covariance[2, 2] > 0:
                weight += 1 / found.covariance[2, 2]
                weighted += found.inverse_gains[2] / found.covariance[2, 2]
        inverse = weighted / weight
        # White is in all of the equations: the error of many is no smaller than that of a few.
        error = np.sqrt(min(len(pairs), _ALIKE_PAIRS) / weight)
        if inverse <= 0 or error > _BLACK_KNOWN * inverse:
            return None
        values.append(1 / inverse)
        errors.append(error / inverse**2)
    return Gain(np.round(np.array(values), _DECIMALS), np.round(np.array(errors), _DECIMALS))


def _plain(frame: Light, colour: int) -> Array:
    return frame.values[..., colour].astype(np.float64)


def _gain(fits: Sequence[Fit], which: int, due_error: Array | float = 0.0) -> Gain:
    """Of one of the frames that were fitted, one fit a colour."""
    inverse = np.array([one.inverse_gains[which] for one in fits])
    deviation = np.sqrt([max(one.covariance[which, which], 0.0) for one in fits])
    error = np.sqrt((deviation / inverse**2) ** 2 + (due_error / inverse) ** 2)
    return Gain(np.round(1 / inverse, _DECIMALS), np.round(error, _DECIMALS))


class _Misfit:
    """Squares of what pairs miss white by, over colours: products of neighbours, free of noise."""

    def __init__(self) -> None:
        self._missed = self._left = self._level = self._place = 0.0
        self._whole = self._light = self._trusted = 0.0

    def add(self, given: Equations, found: Fit) -> None:
        """One colour, each in parts of its own light."""
        level, trust = given.level, found.trust
        weight = trust / given.variance
        weight = weight / max(float(np.sum(weight * given.due[0] * given.due[1])), 1e-30)
        plain = given.residual(np.ones_like(found.inverse_gains))
        rest = given.residual(found.inverse_gains)
        self._missed += _power(plain, weight)
        self._left += _power(rest, weight)
        cells = _cells(given, found)
        by_level, rest = _explained(rest, weight, cells)
        by_place, _ = _explained(rest, weight, given.tiles)
        self._level += by_level
        self._place += by_place
        self._whole += 1
        self._light += float(level.sum())
        self._trusted += float(np.sum(level[trust > _DISTRUST]))

    def pair(self, gains: tuple[Gain, Gain]) -> PairGains:
        """What comes of it."""
        left = max(self._left, 1e-30)
        return PairGains(
            gains=gains,
            missed=_root(self._missed / self._whole),
            left=_root(self._left / self._whole),
            by_level=_part(self._level / left),
            by_place=_part(self._place / left),
            outlying=_part(1 - self._trusted / self._light),
        )


def _cells(given: Equations, found: Fit) -> Index:
    """Which sites have like light in white and like shares of it in the first frame."""
    level = given.level
    bounds = np.quantile(level, np.arange(1, _LEVELS) / _LEVELS)
    first = (given.terms[0, :, 0] + given.terms[1, :, 0]) / 2
    share = found.inverse_gains[0] * first / np.maximum(level, 1e-30)
    part = np.clip((_CONTRASTS * share).astype(np.int64), 0, _CONTRASTS - 1)
    cells: Index = np.searchsorted(bounds, level) * _CONTRASTS + part
    return cells


def _explained(residual: Array, weight: Array, cells: Index) -> tuple[float, Array]:
    """Square of the means of cells, and the residual without them."""
    whole = np.maximum(np.bincount(cells, weight), 1e-30)
    means = np.stack([np.bincount(cells, weight * one) / whole for one in residual])
    return float(np.sum(whole * means[0] * means[1])), residual - means[:, cells]


def _power(residual: Array, weight: Array) -> float:
    return float(np.sum(weight * residual[0] * residual[1]))


def _part(value: float) -> float:
    return round(float(np.clip(value, 0, 1)), _DECIMALS)


def _root(square: float) -> float:
    return round(float(np.sqrt(max(square, 0.0))), _DECIMALS)
