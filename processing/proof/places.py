"""Whether a frame shows its pattern where the projector's pixels are known to be seen.

A sample that sees the place (y, x) of the projector's raster has, in a frame of a pattern,

    (f − black)/(white − black) = a + ½ α s(y, x),    s = 2c − 1,

with the code c blurred by the sample's footprint. The gain of the lamp and light that forgot the
pattern go into a, what scattering and blur leave of the contrast is α; both are free. The weighted
correlation r of the left side with s says how much of the frame its pattern explains at its place,
and r with every other shift of the pattern over its period whether another one explains it better.
As a checker is the product of two waves, all shifts together are a few small products of matrices.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.patterns import Family, Pattern
from processing.proof.finding import Finding

Array = NDArray[np.float64]

# Shifts that are tried over a period; where one is found, shifts of half a pixel about it.
STEPS = 16
FINE_PX = 0.5
# Places of the raster are known to so many footprints of a sample, and projector pixels more:
# movement of the scene, the map's own error, light that bends the pattern.
KNOWN_TO_FOOTPRINTS, KNOWN_TO_PX = 1.0, 1.0
# Samples below which nothing is said.
FEWEST_PLACES = 300
# Part of the light by which right frames differ from a + ½ α s: it counts like noise.
MODEL_ERROR = 0.1
# r of a pattern that is seen at all: twice what chance makes of the best of all shifts.
SEEN_AT = 0.35
# By how much r is larger elsewhere where the pattern stands there.
CLEARLY = 0.02
# By how much it may be less for a raster that is turned over: shifts of the lattice fit so badly.
NEARLY = 0.05
# A part of the picture tells by more, from so many samples and periods of the pattern on.
PART_SEEN_AT, PART_CLEARLY = 0.6, 0.25
FEWEST_OF_A_PART, PERIODS = 150, 1.5
# Another pattern is found by more: those of few periods are like some others.
OTHER_AT, OTHER_CLEARLY = 0.5, 0.2
# Standard deviation of (f − black)/(white − black) from which a frame shows a pattern: ½ is full
# contrast.
CONTRAST_AT = 0.2


@dataclass(frozen=True, slots=True)
class Places:
    """Where n samples of a frame look.

    Parameters
    ----------
    row, column
        float64, (n,), projector pixels, 0 at the centre of the first.
    footprint_px
        Projector pixels from one camera pixel to the next.
    projector_px
        (height, width) of the raster.
    """

    row: Array
    column: Array
    footprint_px: float
    projector_px: tuple[int, int]

    @property
    def known_to_px(self) -> float:
        """By how much a pattern may stand elsewhere in a right frame."""
        return known_to_px(self.footprint_px)

    def of(self, part: NDArray[np.int64]) -> Places:
        """Those of some samples."""
        return replace(self, row=self.row[part], column=self.column[part])

    def spans(self, pattern: Pattern) -> bool:
        """Whether the samples see enough periods of a pattern to tell its shifts apart."""
        least = 2 * PERIODS * pattern.pitch_px
        down = not pattern.family.varies_down or np.ptp(self.row) >= least
        return bool(down and (not pattern.family.varies_right or np.ptp(self.column) >= least))

    @property
    def turned(self) -> Mapping[str, Places]:
        """Where samples looked if the raster were turned over, by how it then stands."""
        row = self.projector_px[0] - 1 - self.row
        column = self.projector_px[1] - 1 - self.column
        return {
            "mirrored left to right": replace(self, column=column),
            "upside down": replace(self, row=row),
            "turned by 180°": replace(self, row=row, column=column),
        }


@dataclass(frozen=True, slots=True)
class Fit:
    """How well a pattern explains a frame, at its place and elsewhere.

    Parameters
    ----------
    here
        Largest r within `Places.known_to_px` of the pattern's place.
    elsewhere
        Largest r beyond that; −1 where the period leaves no room for it.
    shift_px
        (down, right) that is to be added to the pattern's shift where r is largest of all.
    """

    here: float
    elsewhere: float
    shift_px: tuple[float, float]

    @property
    def largest(self) -> float:
        """The largest r of all."""
        return max(self.here, self.elsewhere)

    @property
    def is_elsewhere(self) -> bool:
        """Whether r is clearly larger at another place than at the pattern's."""
        return self.elsewhere >= max(SEEN_AT, self.here + CLEARLY)


@dataclass(frozen=True, slots=True)
class Sighting:
    """What a frame shows by the places that its samples see.

    Parameters
    ----------
    finding
        ``own``; ``misplaced``; ``partial`` where a part of the picture alone is; ``other``, which
        is another pattern or none that is known; ``unseen`` where nothing can be told.
    match
        r of the pattern at its place.
    displaced_px
        (down, right) of a pattern that stands elsewhere, by the shortest way; None otherwise.
    seen_as
        What explains a misplaced pattern as well (see `Places.turned`), or the other pattern
        that is seen.
    """

    finding: Finding
    match: float
    displaced_px: tuple[float, float] | None = None
    seen_as: tuple[str, ...] = ()

    @property
    def is_wrong(self) -> bool:
        """The frame shows something else than its pattern at its place."""
        return self.finding not in {Finding.OWN, Finding.UNSEEN}


def sighting(
    pattern: Pattern,
    places: Places,
    light: Array,
    variance: Array,
    others: Sequence[Pattern],
    parts: Sequence[NDArray[np.int64]] = (),
) -> Sighting:
    """Look whether a frame shows its pattern, and at its place.

    Parameters
    ----------
    pattern
        What it should show, of a family that varies.
    places
        Of n samples.
    light
        (n,): light of the frame less black over that of white less black.
    variance
        (n,), of its noise.
    others
        Patterns of other families or pitches that it may show, at any shift.
    parts
        Samples of parts of the picture, each looked at for itself.
    """
    weight = weights(variance)
    own = fit(pattern, places, light, weight)
    if len(light) < FEWEST_PLACES:
        return Sighting(Finding.UNSEEN, own.here)
    if own.is_elsewhere:
        turned = places.turned.items()
        as_well = own.elsewhere - NEARLY
        seen_as = [how for how, one in turned if fit(pattern, one, light, weight).here > as_well]
        moved = _displacement(pattern, places, light, weight, own)
        return Sighting(Finding.MISPLACED, own.here, moved, tuple(seen_as))
    if own.here >= SEEN_AT:
        whole = all(_is_own(pattern, places.of(part), light[part], weight[part]) for part in parts)
        return Sighting(Finding.OWN if whole else Finding.PARTIAL, own.here)
    if own.largest >= SEEN_AT or _contrast(light, variance, weight) < CONTRAST_AT:
        return Sighting(Finding.UNSEEN, own.here)
    found = [(fit(other, places, light, weight).largest, other) for other in others]
    best, other = max(found, key=lambda one: one[0], default=(-1.0, pattern))
    if best < max(OTHER_AT, own.here + OTHER_CLEARLY):
        return Sighting(Finding.OTHER, own.here)
    return Sighting(Finding.OTHER, own.here, None, (f"{other.family} of {other.pitch_px} px",))


def _is_own(pattern: Pattern, places: Places, light: Array, weight: Array) -> bool:
    """Whether nothing speaks against a part of the picture showing the pattern at its place."""
    if len(light) < FEWEST_OF_A_PART or not places.spans(pattern):
        return True
    found = fit(pattern, places, light, weight)
    return found.elsewhere < max(PART_SEEN_AT, found.here + PART_CLEARLY)


def known_to_px(footprint_px: float) -> float:
    """By how much a pattern may stand elsewhere in a right frame."""
    return KNOWN_TO_FOOTPRINTS * footprint_px + KNOWN_TO_PX


def weights(variance: Array) -> Array:
    """Of samples whose light, a part of white's, has this variance."""
    return np.asarray(1 / (variance + MODEL_ERROR**2), np.float64)


def fit(pattern: Pattern, places: Places, light: Array, weight: Array) -> Fit:
    """Correlate a frame with its pattern at every shift.

    Parameters
    ----------
    pattern
        Of a family that varies.
    places
        Of n samples.
    light
        (n,): light of the frame less black over that of white less black.
    weight
        (n,), ≥ 0, of each sample.
    """
    if light.shape != places.row.shape or weight.shape != light.shape:
        raise ValueError(f"{places.row.shape} places, light {light.shape}, weight {weight.shape}")
    family, pitch = pattern.family, pattern.pitch_px
    step = max(2 * pitch / STEPS, 1.0)
    down = np.arange(0, 2 * pitch, step) if family.varies_down else np.zeros(1)
    # Moved by a pitch both ways a checker is the same.
    span = pitch if family.varies_down else 2 * pitch
    right = np.arange(0, span, step) if family.varies_right else np.zeros(1)
    found = _correlations(pattern, places, light, weight, (down, right))
    ways = np.array([[shortest((a, b), pattern) for b in right] for a in down])
    near = np.abs(ways).max(axis=2) <= places.known_to_px
    best = ways[np.unravel_index(int(np.argmax(found)), found.shape)]
    return Fit(
        here=float(found[near].max()),
        elsewhere=float(found[~near].max()) if not near.all() else -1.0,
        shift_px=(float(best[0]), float(best[1])),
    )


def shortest(shift_px: tuple[float, float], pattern: Pattern) -> tuple[float, float]:
    """The shortest of the shifts (down, right) that show the same as one, each in [−P, P)."""
    pitch = pattern.pitch_px
    turns = (0, pitch) if pattern.family is Family.CHECKER else (0,)
    ways = [
        ((shift_px[0] + turn + pitch) % (2 * pitch) - pitch,
         (shift_px[1] + turn + pitch) % (2 * pitch) - pitch)
        for turn in turns
    ]  # fmt: skip
    return min(ways, key=lambda way: max(abs(way[0]), abs(way[1])))


def _displacement(
    pattern: Pattern, places: Places, light: Array, weight: Array, found: Fit
) -> tuple[float, float]:
    """Where the pattern stands, (down, right) from its place: it moves against its shift."""
    step = max(2 * pattern.pitch_px / STEPS, 1.0)
    about = np.arange(-step, step + FINE_PX, FINE_PX)
    down = found.shift_px[0] + (about if pattern.family.varies_down else np.zeros(1))
    right = found.shift_px[1] + (about if pattern.family.varies_right else np.zeros(1))
    closer = _correlations(pattern, places, light, weight, (down, right))
    first, second = np.unravel_index(int(np.argmax(closer)), closer.shape)
    return shortest((-float(down[first]), -float(right[second])), pattern)


def _contrast(light: Array, variance: Array, weight: Array) -> float:
    """Standard deviation of the light, that of the noise taken off."""
    share = weight / weight.sum()
    power = share @ (light - share @ light) ** 2 - share @ variance
    return float(np.sqrt(max(power, 0.0)))


def _correlations(
    pattern: Pattern, places: Places, light: Array, weight: Array, shifts: tuple[Array, Array]
) -> Array:
    """Values of r of the light with the pattern at all pairs of shifts (down, right)."""
    family, pitch, width_px = pattern.family, pattern.pitch_px, places.footprint_px
    first, second = np.ones((2, 1, len(light)))
    if family.varies_down:
        first = _waves(family, pitch, places.row + pattern.shift_y_px, shifts[0], width_px)
    if family.varies_right:
        second = _waves(family, pitch, places.column + pattern.shift_x_px, shifts[1], width_px)
    weight = weight / weight.sum()
    light = light - weight @ light
    power = float(weight @ light**2)
    mean = (first * weight) @ second.T
    spread = (first**2 * weight) @ (second**2).T - mean**2
    common = (first * (weight * light)) @ second.T
    return np.asarray(common / np.sqrt(np.maximum(spread * power, 1e-30)), np.float64)


def _waves(family: Family, pitch: int, along: Array, shifts: Array, width_px: float) -> Array:
    """Values of s along one direction at some shifts, (shifts, n), blurred by a box."""
    place = along + shifts[:, np.newaxis]
    if not family.is_binary:
        return np.asarray(np.cos(np.pi * place / pitch), np.float64)
    # Pixel 0 reaches from −½ to ½.
    inside = (place + 0.5) % (2 * pitch)
    from_edge = np.abs((inside + pitch / 2) % pitch - pitch / 2)
    sign = np.where(inside < pitch, 2.0, -2.0)
    return np.asarray(np.clip(sign * from_edge / min(width_px, pitch), -1, 1), np.float64)
