"""How much of each of several frames adds up to another, robustly.

Σ a_k I_k = I holds at every pixel: there are many more equations than unknowns. Those that fit
badly, of what moved or shone, lose their weight (Tukey's biweight). Standard errors are those of
sums over tiles, within which pixels need not err independently.

Frames of a pattern and its complement that camera or projector do not resolve are alike: only the
sum of both a_k is known, and noise in the frames draws one towards the other. Each of them then has
half of the light as a whole, as far as the tiles of the picture agree on that, which ties them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import inverse, product, solved

Array: TypeAlias = NDArray[np.float64]
Index: TypeAlias = NDArray[np.int64]

_ROUNDS = 16
# Huber's weights first, which lead to one solution only; then Tukey's.
_HUBER_ROUNDS, _HUBER, _BIWEIGHT = 4, 1.345, 4.685
_LIT = 0.1
_FEWEST = 100
# Part of the mean light that errors have where there is little.
_DARK = 0.05
# Neighbouring tiles may miss half of the light alike: variances are so many times as large.
_ALIKE = 4.0
# Of full scale: fainter light has errors that are in no proportion to it.
_FAINT = 0.01
# Half of the light is never known better than this.
_TIE_ERROR = 0.002
_LEAST_SCALE = 1e-5
_RIDGE = 1e-9


@dataclass(frozen=True, slots=True)
class Equations:
    """Terms of one colour at the usable, lit sites of frames that are compared.

    Parameters
    ----------
    terms
        (2, n, p): light of the p frames whose inverse gains are sought.
    due
        (2, n): what they add up to.
    tiles
        (n,).
    relative
        Whether errors are in proportion to the light, as of a curve; else as of photons.
    """

    terms: Array
    due: Array
    tiles: Index
    relative: bool = False

    @property
    def level(self) -> Array:
        """(n,), > 0."""
        level: Array = np.maximum(_mean(self.due), 0)
        return level

    @property
    def variance(self) -> Array:
        """Of the errors, up to a factor, (n,): in proportion to the light, as of photons."""
        mean = max(float(self.level.mean()), 1e-30)
        if self.relative:
            parts: Array = self.level**2 + _FAINT**2
            return parts
        variance: Array = self.level * mean + (_DARK * mean) ** 2
        return variance

    def residual(self, inverse_gains: Array) -> Array:
        """(2, n)."""
        rest = self.due.copy()
        for k, gain in enumerate(inverse_gains):
            rest -= gain * self.terms[..., k]
        return rest

    def moments(self, weights: Array, noise: float = 0.0) -> tuple[Array, Array]:
        """(p, p) of the terms and (p,) of terms and sum, mean over the pixels of each site.

        Freed from what noise adds to the squares of the terms, if equations have errors of `noise`
        times their `variance`: half of that is the terms', in proportion to their light.
        """
        normal = np.zeros((self.terms.shape[-1],) * 2)
        right = np.zeros(self.terms.shape[-1])
        for terms, due in zip(self.terms, self.due, strict=True):
            weighted = (weights[:, np.newaxis] * terms).T / 2
            normal += product(weighted, terms)
            right += product(weighted, due)
        light = np.maximum(_mean(self.terms), 0)
        share = light / np.maximum(np.sum(light.T, axis=0), 1e-30)[:, np.newaxis]
        added = noise / 2 * product(share.T, weights * self.variance)
        return normal - np.diag(added), right

    def tie(self) -> Tie:
        """How far the first two frames have half of the light each."""
        light = np.stack([np.bincount(self.tiles, term) for term in _mean(self.terms).T[:2]])
        sums = np.maximum(light.sum(axis=1), 1e-30)
        half = self.level.sum() / 2 / sums
        unlike = _ALIKE * float(np.sum((half[0] * light[0] - half[1] * light[1]) ** 2))
        row = np.zeros(self.terms.shape[-1])
        row[:2] = sums[0], -sums[1]
        return Tie(row, unlike + (_TIE_ERROR * float(sums.mean())) ** 2)


@dataclass(frozen=True, slots=True)
class Tie:
    """That a sum of inverse gains times `row`, (p,), is 0 but for an error of some `variance`."""

    row: Array
    variance: float


@dataclass(frozen=True, slots=True)
class Fit:
    """Of equations.

    Parameters
    ----------
    inverse_gains, covariance
        (p,) and (p, p).
    trust
        In [0, 1], (n,): how much each equation counts.
    """

    inverse_gains: Array
    covariance: Array
    trust: Array


def equations(
    frames: Sequence[Array], due: Array, usable: NDArray[np.bool_], tiles: Index, lit: float = _LIT
) -> Equations | None:
    """Those of frames, (2, n) each, of one colour that add up to `due`, (2, n), where that is lit.

    None where too little is: sites have more than `lit` of the level above which half of the light
    is, by default so much that their equations tell more of light than of noise.
    """
    level = np.maximum(_mean(due), 0)
    if not np.any(level[usable] > 0):
        return None
    bright = usable & (level > lit * _median_of_light(level[usable]))
    if np.count_nonzero(bright) < _FEWEST:
        return None
    return Equations(np.stack(frames, axis=-1)[:, bright], due[:, bright], tiles[bright])


class Solver:
    """Solves equations robustly, round by round; the equations may change on the way.

    Parameters
    ----------
    halves
        Whether the first two frames are complements, which have half of the light each if nothing
        else tells them apart.
    """

    def __init__(self, *, halves: bool) -> None:
        self._halves = halves
        self._round = 0
        self._held = self._noise = 0.0
        self.trust: Array | None = None
        self._slope: Array = np.ones(0)

    def solve(self, given: Equations) -> Array:
        """Inverse gains, (p,), with the trust of the rounds before; raises `LinAlgError`."""
        variance = given.variance
        trust = np.ones_like(variance) if self.trust is None else self.trust
        tie = self._tie(given)
        normal, right = given.moments(trust / variance, self._noise)
        found = solved(_bread(normal, tie, self._held), right)
        rest = given.residual(found) / np.sqrt(variance)
        self._noise = (1.4826 * float(np.median(np.abs(rest)))) ** 2
        missed = np.abs(_mean(rest))
        scale = max(1.4826 * float(np.median(missed)), _LEAST_SCALE)
        weigh = _huber if self._round < _HUBER_ROUNDS else _biweight
        self.trust, self._slope = weigh(missed / scale)
        self._held = scale**2 / tie.variance
        self._round += 1
        return found

    def covariance(self, given: Equations, found: Array) -> Array:
        """(p, p), after some rounds; raises `LinAlgError`."""
        variance, tie = given.variance, self._tie(given)
        bread, _ = given.moments(self._slope / variance, self._noise)
        turned = inverse(_bread(bread, tie, self._held))
        trust = np.ones_like(variance) if self.trust is None else self.trust
        spread = _spread(given, found, trust / variance)
        spread += self._held**2 * tie.variance * np.outer(tie.row, tie.row)
        return product(product(turned, spread), turned.T)

    def _tie(self, given: Equations) -> Tie:
        return given.tie() if self._halves else Tie(np.zeros(given.terms.shape[-1]), 1.0)


def fit(given: Equations, *, halves: bool) -> Fit | None:
    """Solve equations robustly, `halves` as in `Solver`; None where they tell nothing."""
    solver = Solver(halves=halves)
    try:
        for _ in range(_ROUNDS):
            found = solver.solve(given)
        covariance = solver.covariance(given, found)
    except np.linalg.LinAlgError:
        return None
    trust = solver.trust
    return None if trust is None else Fit(found, covariance, trust)


def _spread(given: Equations, found: Array, weights: Array) -> Array:
    """Covariance of the scores, (p, p), each tile's sum independent of the others'."""
    rest = given.residual(found)
    scores = weights[:, np.newaxis] * _mean(given.terms * rest[..., np.newaxis])
    parts = [np.bincount(given.tiles, score) for score in scores.T]
    sums = np.stack(parts, axis=1).astype(np.float64)
    tiles = int(np.count_nonzero(np.bincount(given.tiles)))
    return product(sums.T, sums) * tiles / max(tiles - len(found), 1)


def _bread(normal: Array, tie: Tie, held: float) -> Array:
    """With the tie, and with just enough more to be solved where frames are equal."""
    ridge = _RIDGE * float(np.trace(np.abs(normal))) * np.eye(len(normal))
    bread: Array = normal + held * np.outer(tie.row, tie.row) + ridge
    return bread


def _huber(scaled: Array) -> tuple[Array, Array]:
    """Weight and slope of the influence of errors in units of their scale."""
    return np.minimum(1, _HUBER / np.maximum(scaled, 1e-30)), np.where(scaled < _HUBER, 1.0, 0.0)


def _biweight(scaled: Array) -> tuple[Array, Array]:
    square = np.minimum(scaled / _BIWEIGHT, 1) ** 2
    return (1 - square) ** 2, (1 - square) * (1 - 5 * square)


def _median_of_light(level: Array) -> float:
    """Half of the light is above it."""
    ordered = np.sort(level)
    risen = np.cumsum(ordered)
    return float(ordered[np.searchsorted(risen, risen[-1] / 2)])


def _mean(pixels: Array) -> Array:
    """Of the two pixels of each site, far faster than along a short axis."""
    mean: Array = (pixels[0] + pixels[1]) / 2
    return mean
