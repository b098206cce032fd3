"""The curve that a camera gave its pictures, beyond the one that was undone, from complements.

Light of a pattern and of its complement adds up to white; numbers that went through a curve do not,
and how they fail to tells the curve. With I a frame as it was linearised, its light is taken to be
h(I)·I, h a factor that changes with the level, in straight lines between knots in the code of sRGB.
Then

    a₊ h(I₊)I₊ + a₋ h(I₋)I₋ = h(I_white) I_white + h(I_black) I_black

at every pixel, a₊ and a₋ the inverse gains of the frames (`exposure_gains`): pixels that both
frames light in part tell h, for gains are one number a frame. It is found by least squares, the
gains eliminated from each step, and held by a weak preference for none, which decides where
there is no such light. The mean white light stays what it was.

Whether there is such a curve is judged on pairs that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from processing.frames.exposure_gains import pair_gains
from processing.frames.light_sums import Array, Equations, Index, Solver, equations
from processing.frames.sites import Light
from processing.numerics.elementary import exp, log
from processing.numerics.linear_algebra import product, solved, symmetric_eigen

Image: TypeAlias = NDArray[np.float32]
Pair: TypeAlias = tuple[Light, Light]

# Codes of sRGB, parts of the largest.
KNOTS = (0.0, 0.06, 0.12, 0.18, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0)
# What pairs miss must fall to this part of it where the curve was not fitted; below so little of
# white no curve is looked for.
HELPS = 0.8
WORTH = 0.01
# Pairs that tell the curve are no more than these.
MOST_PAIRS = 24
# A factor that changes by 1 from knot to knot costs as much as missing white by 3 %.
_PREFERENCE = 1e-3
_STIFFER = (1.0, 10.0, 100.0, 1000.0)
# Others are no curve but too little to tell one: it is held more then.
_LEAST, _MOST = 0.1, 20.0
# Dim light tells of a curve too: sites of so much of the light's usual level count.
_LIT = 0.01
_ROUNDS = 16
_CODES = 1 << 16
_DECIMALS = 4


@dataclass(frozen=True, slots=True)
class ToneCurve:
    """What linearised numbers are multiplied by.

    Parameters
    ----------
    factors
        Of each colour at the `KNOTS`.
    """

    factors: tuple[tuple[float, ...], ...]

    def light(self, frame: Light) -> Light:
        """A frame's sites as light."""
        values = frame.values.copy()
        self.apply(values)
        return Light(values, frame.usable)

    def apply(self, image: Image) -> None:
        """Make light of (…, colours), numbers in [0, 1], in place."""
        codes = np.rint(image * np.float32(_CODES - 1)).astype(np.uint16)
        for colour, table in enumerate(_tables(self.factors)):
            image[..., colour] = table[codes[..., colour]]


@dataclass(frozen=True, slots=True)
class Evidence:
    """For a curve.

    Parameters
    ----------
    curve
        As the pairs have it.
    errors
        Of its factors: half of what two halves of the pairs differ by, (colours, knots).
    without, with_curve
        Root mean square of what pairs miss white by, their gains taken off, in parts of it:
        without a curve, and with that of the other half of the pairs.
    """

    curve: ToneCurve
    errors: tuple[tuple[float, ...], ...]
    without: float
    with_curve: float

    @property
    def convinces(self) -> bool:
        """Whether there is such a curve."""
        return self.without > WORTH and self.with_curve < HELPS * self.without


def find_curve(pairs: Sequence[Pair], references: Pair, tiles: Index) -> Evidence | None:
    """Look for a curve.

    Parameters
    ----------
    pairs
        Patterns and their complements; neighbours in the sequence are of unlike pitch or family.
    references
        White and black.
    tiles
        Of the sites.

    Returns
    -------
    None where there are fewer than four pairs, or too little light.
    """
    if len(pairs) < 4:
        return None
    halves = pairs[0::2], pairs[1::2]
    curves = [_curve(half, references, tiles) for half in (*halves, pairs)]
    first, second, whole = curves
    if first is None or second is None or whole is None:
        return None
    none = ToneCurve(tuple((1.0,) * len(KNOTS) for _ in whole.factors))
    plain = [left for half in halves for left in _left(half, references, tiles, none)]
    told = [
        left
        for half, curve in zip(halves, (second, first), strict=True)
        for left in _left(half, references, tiles, curve)
    ]
    if not plain or len(told) != len(plain):
        return None
    apart = np.abs(np.array(first.factors) - np.array(second.factors)) / 2
    errors = tuple(tuple(row) for row in np.round(apart, _DECIMALS).tolist())
    return Evidence(whole, errors, _mean_square(plain), _mean_square(told))


def due_of(references: Pair, black_inverse: Array | float = 1.0) -> tuple[Array, NDArray[np.bool_]]:
    """White and black light, (2, n, colours), and the sites where neither is saturated, (n,)."""
    white, black = references
    due = white.values.astype(np.float64) + black_inverse * black.values
    return due, white.usable & black.usable


def _left(pairs: Sequence[Pair], references: Pair, tiles: Index, curve: ToneCurve) -> list[float]:
    due, usable = due_of((curve.light(references[0]), curve.light(references[1])))
    found = [
        pair_gains((curve.light(one), curve.light(other)), due, usable, tiles)
        for one, other in pairs
    ]
    return [one.left for one in found if one is not None]


def _mean_square(values: Sequence[float]) -> float:
    return round(float(np.sqrt(np.mean(np.square(values)))), 6)


def _curve(pairs: Sequence[Pair], references: Pair, tiles: Index) -> ToneCurve | None:
    """Of all colours; None where one of them has too little light."""
    factors = []
    for colour in range(references[0].values.shape[-1]):
        stacks = [stack for pair in pairs if (stack := _stack(pair, references, colour, tiles))]
        if len(stacks) < 2:
            return None
        found = _held(stacks)
        if found is None:
            return None
        factors.append(tuple(np.round(found, _DECIMALS).tolist()))
    return ToneCurve(tuple(factors))


@dataclass(frozen=True, slots=True)
class _Stack:
    """A pair in one colour: terms of each knot, (2, n, knots), of what is added and of its sum."""

    frames: tuple[Array, Array]
    due: Array
    white: Array
    tiles: Index

    def equations(self, factors: Array) -> Equations:
        """With some curve."""
        light = [product(one.reshape(-1, len(factors)), factors) for one in self.frames]
        shape = self.due.shape[:2]
        terms = np.stack([one.reshape(shape) for one in light], axis=-1)
        return Equations(terms, np.sum(self.due * factors, axis=-1), self.tiles, relative=True)


def _stack(pair: Pair, references: Pair, colour: int, tiles: Index) -> _Stack | None:
    due, usable = due_of(references)
    usable = usable & pair[0].usable & pair[1].usable
    every = [one.values[..., colour].astype(np.float64) for one in (*pair, *references)]
    # Those of the frames themselves choose the sites that are lit.
    given = equations(every, due[..., colour], usable, tiles, _LIT)
    if given is None:
        return None
    first, second, white, black = (_terms(given.terms[..., k]) for k in range(4))
    return _Stack((first, second), white + black, white, given.tiles)


def _held(stacks: Sequence[_Stack]) -> Array | None:
    """Factors, held only as much as they must be."""
    for stiffness in _STIFFER:
        factors = _factors(stacks, stiffness * _PREFERENCE)
        if factors is None or np.all((factors > _LEAST) & (factors < _MOST)):
            return factors
    return np.ones(len(KNOTS))


def _factors(stacks: Sequence[_Stack], preference: float) -> Array | None:
    steps = np.diff(np.eye(len(KNOTS)), axis=0)
    stiff = product(steps.T, steps)
    share = np.sum([stack.white.sum(axis=(0, 1)) for stack in stacks], axis=0)
    share = share / share.sum()
    factors = np.ones(len(KNOTS))
    solvers = [Solver(halves=True) for _ in stacks]
    try:
        for turn in range(_ROUNDS):
            normal, right = np.zeros_like(stiff), np.zeros(len(KNOTS))
            for stack, solver in zip(stacks, solvers, strict=True):
                given = stack.equations(factors)
                gains = solver.solve(given)
                square, line = _step(stack, given, gains, solver.trust)
                normal += square / len(stacks)
                right += line / len(stacks)
            # Little is allowed at first, when the gains are still those without a curve.
            held_by = max(preference, 10.0 ** -(turn + 1))
            form = _positive(normal) + held_by * stiff + 1e-12 * np.eye(len(KNOTS))
            # The least value of it under the condition that the mean light stays (Lagrange).
            free, held = solved(form, right), solved(form, share)
            missing = 1 - float(np.sum(free * share))
            found = free + held * missing / float(np.sum(held * share))
            factors = np.clip(found, _LEAST / 2, 2 * _MOST)
    except np.linalg.LinAlgError:
        return None
    return factors


def _positive(form: Array) -> Array:
    """Without what only noise can have made negative."""
    values, vectors = symmetric_eigen((form + form.T) / 2)
    return product(vectors * np.maximum(values, 0), vectors.T)


def _step(
    stack: _Stack, given: Equations, inverse_gains: Array, trust: Array | None
) -> tuple[Array, Array]:
    """Squared residual of a pair, in parts of the light, near some factors.

    The best gain of both frames goes with each: it is eliminated. Returned are the form, (knots,
    knots), and what its gradient vanishes at, (knots,). In parts of the light: in absolute measure,
    factors that make dim light dimmer would make its errors smaller.
    """
    weights = (1.0 if trust is None else trust) / given.variance
    weights = weights / max(float(np.sum(weights * given.due[0] * given.due[1])), 1e-30)
    first, second = stack.frames
    rest = given.residual(inverse_gains)
    part = rest.mean(axis=0) / np.maximum(given.level, 1e-30)
    slopes = stack.due - inverse_gains[0] * first - inverse_gains[1] * second
    slopes = slopes - part[:, np.newaxis] * stack.due
    rest = rest[..., np.newaxis]
    common = np.sum(given.terms * inverse_gains, axis=-1)[..., np.newaxis]
    along = _crossed(common, slopes, weights) / max(_crossed(common, common, weights)[0, 0], 1e-30)
    form = _crossed(slopes, slopes, weights) - product(along.T, _crossed(common, slopes, weights))
    line = product(along.T, _crossed(common, rest, weights)) - _crossed(slopes, rest, weights)
    return form, line[:, 0]


def _crossed(one: Array, other: Array, weights: Array) -> Array:
    """Weighted products of either pixel's (2, n, k) with its neighbour's (2, n, m): (k, m).

    The noise of neighbours is not the same: it adds nothing.
    """
    weighted = [(weights[:, np.newaxis] * part).T / 2 for part in one]
    found: Array = product(weighted[0], other[1]) + product(weighted[1], other[0])
    return found


def _terms(values: Array) -> Array:
    """(…, knots): what each knot's factor is multiplied by."""
    codes = _encoded(values)
    terms = np.empty((*values.shape, len(KNOTS)))
    for k in range(len(KNOTS)):
        terms[..., k] = values * np.interp(codes, KNOTS, np.eye(len(KNOTS))[k])
    return terms


@lru_cache(maxsize=2)
def _tables(factors: tuple[tuple[float, ...], ...]) -> tuple[Image, ...]:
    """Light of every 16-bit number, by colours."""
    values = np.arange(_CODES) / (_CODES - 1)
    codes = _encoded(values)
    # A factor that falls steeply could make more light of a lower number.
    rising = (np.maximum.accumulate(values * np.interp(codes, KNOTS, one)) for one in factors)
    return tuple(one.astype(np.float32) for one in rising)


def _encoded(values: Array) -> Array:
    """Code of sRGB, IEC 61966-2-1, of light in [0, 1]."""
    clipped = np.clip(values, 0, 1)
    curved = 1.055 * _power(clipped, 1 / 2.4) - 0.055
    code: Array = np.where(clipped <= 0.0031308, 12.92 * clipped, curved)
    return code


def _decoded(codes: Array) -> Array:
    light: Array = np.where(codes <= 0.04045, codes / 12.92, _power((codes + 0.055) / 1.055, 2.4))
    return light


def _power(base: Array, exponent: float) -> Array:
    """Of bases ≥ 0, the same on every processor."""
    found: Array = exp(exponent * log(np.maximum(base, 1e-30)))
    return found
