"""Whether the pitches of a session agree on where every sample looks.

Frames of one pitch tell the place t of the raster that a sample sees modulo the period 2P: the
phase of their harmonic Z (`processing.frames.harmonics`) is π t/P, along both diagonals for
checkers. If a pitch stands elsewhere by D, however steady its frames are, its phases differ from
those that the other pitches let expect by −π D/P at every sample alike. With t of each sample from
the others,

    Φ = Σ φ e^{−iπt/P},    κ = |Φ| / Σ |φ|,    D = −(P/π) arg Φ.

Where the others leave t open by a multiple of their common period G, phases are raised to the
power m = 2P/g, g the greatest common divisor of G and 2P: these tell D modulo g.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign
from processing.numerics.elementary import turned
from processing.patterns import Family, Pattern

Array = NDArray[np.float64]
Phasors = NDArray[np.complex128]

# Powers of noisy phases say nothing.
MOST_POWER = 3
# Phase, in radians, and κ, by which a pitch that stands elsewhere is told.
OFF_AT, COHERENT_AT = 1.0, 0.4
# κ of a pitch whose phases have nothing to do with those of the others.
LOST_AT = 0.2
# Part of the amplitude of the others that agrees on one place.
SURE_AT = 0.7
# Amplitude of a pitch over that of its noise, median, to be looked at.
VISIBLE_AT = 4.0
# By how much more of the others agrees without a pitch than without another: that is off.
CLEARLY = 0.02
# Pitches, in parts of the one in question, of which the finest tells places well enough for it.
FINE_ENOUGH = 2
_NEWTON_STEPS = 6


@dataclass(frozen=True, slots=True)
class PitchPhases:
    """What the frames of one pitch tell of the places of n samples.

    Parameters
    ----------
    family, pitch_px
        Of the patterns.
    phasors
        complex128, (directions, n): of phase π t/P, with t = y + x and y − x for checkers, y or x
        for patterns that vary along one direction.
    """

    family: Family
    pitch_px: int
    phasors: Phasors

    @property
    def directions(self) -> str:
        """Which t there are."""
        if self.family is Family.CHECKER:
            return "diagonal"
        return "down" if self.family.varies_down else "right"


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A pitch that does not agree with the others.

    Parameters
    ----------
    family, pitch_px
        Of its patterns.
    displaced_px
        (down, right) by which it stands elsewhere, as far as its period tells; None where the
        others leave that open, or where its phases have nothing to do with theirs.
    is_certain
        It is this pitch that is off, not one of the others.
    """

    family: Family
    pitch_px: int
    displaced_px: tuple[float, float] | None
    is_certain: bool = True


def pitch_phases(patterns: Sequence[Pattern], light: Array, variance: Array) -> PitchPhases | None:
    """The phases of a pitch; None where its shifts or its contrast do not tell them.

    Parameters
    ----------
    patterns
        Of one family and pitch.
    light
        (frames, n): over that of white, black taken off, in the light of a steady lamp.
    variance
        (n,), of the noise of such a value.
    """
    try:
        design = PitchDesign.of(patterns)
    except ValueError:
        return None
    if design.is_pair:
        return None
    family, pitch = design.family, design.pitch_px
    weights = design.weights[:, 0::2] + 1j * design.weights[:, 1::2]
    # Without the light that all frames have, which unequal lamps would spoil.
    sums = weights.T @ (light - light.mean(axis=0))
    kappa = 1j if family.is_binary else complex(turned(np.array(0.5 * np.pi / pitch)))
    if family is Family.CHECKER:
        constants = np.array([kappa * kappa, 1.0])
    else:
        sums, constants = sums[:1], np.array([kappa])
    noise = np.sqrt(np.sum(np.abs(weights[:, :1]) ** 2) * variance)
    if np.median(np.abs(sums) / noise) < VISIBLE_AT:
        return None
    return PitchPhases(family, pitch, np.conj(sums / constants[:, np.newaxis]))


def disagreements(
    pitches: Sequence[PitchPhases], projector_px: tuple[int, int]
) -> list[Disagreement]:
    """Pitches that stand elsewhere than the others say.

    Parameters
    ----------
    pitches
        Of the same samples; of patterns that vary along the same directions those are compared.
    projector_px
        (height, width).
    """
    found = []
    for directions in sorted({one.directions for one in pitches}):
        alike = [one for one in pitches if one.directions == directions]
        found += _among(alike, _spans(directions, projector_px))
    return found


def _spans(directions: str, projector_px: tuple[int, int]) -> list[tuple[int, int]]:
    height, width = projector_px
    if directions == "diagonal":
        return [(0, height + width), (-width, height)]
    return [(0, height if directions == "down" else width)]


@dataclass(frozen=True, slots=True)
class _Against:
    """One pitch against others: phase and κ, (directions,), and how well those agree."""

    phase: Array
    kappa: Array
    modulo_px: int
    others: float
    is_unique: bool

    @property
    def is_told(self) -> bool:
        """The others say where it should be."""
        return self.modulo_px > 0 and self.others >= SURE_AT

    @property
    def is_off(self) -> bool:
        """It stands elsewhere."""
        elsewhere = np.any((np.abs(self.phase) > OFF_AT) & (self.kappa >= COHERENT_AT))
        return self.is_told and (bool(elsewhere) or self.is_lost)

    @property
    def is_lost(self) -> bool:
        """Nothing of it agrees with the others, though these leave nothing open."""
        return self.is_told and self.is_unique and bool(np.all(self.kappa < LOST_AT))


def _among(pitches: Sequence[PitchPhases], spans: Sequence[tuple[int, int]]) -> list[Disagreement]:
    """Of pitches that vary along the same directions."""
    if len(pitches) < 2:
        return []
    against = _each(pitches, spans)
    if not any(one.is_off for one in against):
        return []
    # Without the odd one the others agree; of several that explain it like this the likeliest.
    odd = [k for k in range(len(pitches)) if len(pitches) > 2 and _agree(pitches, k, spans)]
    best = max((against[k].others for k in odd), default=0.0)
    odd = [k for k in odd if against[k].others > best - CLEARLY]
    if len(odd) == 1:
        return [_described(pitches[odd[0]], against[odd[0]])]
    which = [pitches[k] for k in odd] or pitches
    return [Disagreement(one.family, one.pitch_px, None, is_certain=False) for one in which]


def _agree(pitches: Sequence[PitchPhases], without: int, spans: Sequence[tuple[int, int]]) -> bool:
    """Whether all pitches but one agree."""
    rest = [one for k, one in enumerate(pitches) if k != without]
    return not any(one.is_off for one in _each(rest, spans))


def _each(pitches: Sequence[PitchPhases], spans: Sequence[tuple[int, int]]) -> list[_Against]:
    """Every one against the others."""
    return [_against(one, [q for q in pitches if q is not one], spans) for one in pitches]


def _described(one: PitchPhases, against: _Against) -> Disagreement:
    if not against.is_off or against.is_lost or not against.is_unique:
        return Disagreement(one.family, one.pitch_px, None)
    moved = -against.phase * one.pitch_px / np.pi
    if one.directions == "diagonal":
        way = float(moved[0] + moved[1]) / 2, float(moved[0] - moved[1]) / 2
    else:
        way = (float(moved[0]), 0.0) if one.directions == "down" else (0.0, float(moved[0]))
    return Disagreement(one.family, one.pitch_px, way)


def _against(
    one: PitchPhases, others: Sequence[PitchPhases], spans: Sequence[tuple[int, int]]
) -> _Against:
    """Compare a pitch with others."""
    common = 2 * math.lcm(*(other.pitch_px for other in others))
    reach = max(last - first for first, last in spans)
    period = 2 * one.pitch_px
    modulo = period if common >= reach else math.gcd(common, period)
    power = period // modulo
    phase, kappa, agreed, size = [], [], 0.0, 0.0
    for direction, span in enumerate(spans):
        phasors = np.stack([other.phasors[direction] for other in others])
        rates = np.pi / np.array([other.pitch_px for other in others], np.float64)
        place, together = _places(phasors, rates, span, common)
        agreed, size = agreed + float(together.sum()), size + float(np.abs(phasors).sum())
        own = one.phasors[direction]
        length = np.maximum(np.abs(own), 1e-30)
        total = np.sum(own**power / length ** (power - 1) * np.exp(-2j * np.pi * place / modulo))
        phase.append(float(np.angle(total)))
        kappa.append(float(np.abs(total) / length.sum()))
    finest = min(other.pitch_px for other in others)
    told = modulo if power <= MOST_POWER and finest <= FINE_ENOUGH * one.pitch_px else 0
    sure = agreed / max(size, 1e-30)
    return _Against(np.array(phase), np.array(kappa), told, sure, is_unique=power == 1)


def _places(
    phasors: Phasors, rates: Array, span: tuple[int, int], common: int
) -> tuple[Array, Array]:
    """Where Σ Re(φ e^{−iπt/P}) is largest, and that sum; (n,) each."""
    step = np.pi / rates.max() / 4
    lattice = np.arange(span[0], min(span[1], span[0] + common) + step, step)
    waves = np.exp(-1j * np.outer(lattice, rates))
    scores = waves.real @ phasors.real - waves.imag @ phasors.imag
    place = lattice[np.argmax(scores, axis=0)]
    curvature = np.maximum(rates**2 @ np.abs(phasors), 1e-30)
    for _ in range(_NEWTON_STEPS):
        aligned = phasors * np.exp(-1j * np.outer(rates, place))
        place = place + (rates @ aligned.imag) / curvature
    aligned = phasors * np.exp(-1j * np.outer(rates, place))
    return place, np.asarray(aligned.real.sum(axis=0), np.float64)
