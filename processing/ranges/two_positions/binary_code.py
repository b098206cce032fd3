"""Where each camera pixel looks on the projector, read from patterns and their complements.

The difference of a pattern and its complement, relative to white, is r = Σ_r x_r s_r(t), with x_r
the share of light of range r and s_r the wave of the pattern at the pixel's place t
(`processing.ranges.two_positions.code_waves`). The signs of all pitches are a binary code. Along
each axis:

1. coarse: the place on a lattice at which all differences lie within what direct light of some to
   all of white would give. A pixel begins at the place of the one before and looks everywhere
   where that explains it badly;
2. fine: Newton's step of every pixel on its differences, weighted by what they tell of the place
   (nothing in the middle of a wide stripe, much at its edge and at blurred fine ones), then a
   plane through the steps of its neighbours, of which those that lie on another surface count
   little; several times over. How much of each pitch's contrast is left is that of a neighbourhood.

Colours of a mosaic see places apart: what their own differences say, averaged likewise, is added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.ranges.kernels import compiled
from processing.ranges.response import bin_of
from processing.ranges.two_positions.code_planes import gradients, smoothed
from processing.ranges.two_positions.code_waves import CodeWaves, first_waves

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# Pitches of which direct light leaves less contrast than this say nothing.
LEAST_CONTRAST = 0.1
# Fewer pitches are no code.
LEAST_PITCHES = 3
# Of the contrast of the sharper quarter of the picture: the least and most of direct light.
_SHARP_PERCENTILE = 75.0
_LEAST_SHARE, _MOST_SHARE, _MOST = 0.35, 1.3, 1.05
# Misfits count no more than this square of white; the typical contrast counts so much beside.
_MOST_MISFIT, _TYPICAL_WEIGHT = 0.3, 0.05
# A place is taken from beside the pixel before where its mean square misfit is below this.
_EXPLAINED, _NEAR_STEPS = 0.01, 12
_LATTICE = 0.25
# Stripes that are wide, in finest pitches, and what is left of contrast at their edges.
_WIDE, _AT_EDGE = 4.0, 0.5
# Newton's steps; of a difference's misfit, what the model leaves and where it is an outlier.
_ROUNDS = 7
_MODEL_ERROR, _OUTLIER = 0.04, 0.25
_LONGEST_STEP_PX = 1.0
_LEAST_PRECISION = 1e-3
# Neighbourhood of contrasts, and what typical ones weigh beside it.
_CONTRAST_PX, _CONTRAST_PRIOR = 7, 0.05
# A colour's own place: rounds, unless it changes by less; what holds it to that of all colours, how
# far it may lie, and what is an outlier where it is still to be found.
_COLOUR_ROUNDS, _ARRIVED_PX = 8, 0.02
_COLOUR_PRIOR, _MOST_COLOUR_PX, _COLOUR_OUTLIER = 0.02, 2.0, 1.0
# Lines beside a band that its places depend on.
HALO = 24


@dataclass(frozen=True, slots=True)
class BinaryCode:
    """What decodes the patterns of a session along one axis.

    Parameters
    ----------
    chosen
        (pitches,): which differences vary along the axis and are resolved.
    waves
        Of these alone.
    contrast
        (pitches,), typical contrast of direct light.
    extent_px
        Up to where places are looked for.
    """

    chosen: NDArray[np.int64]
    waves: CodeWaves
    contrast: Array
    extent_px: float

    def decoded(self, relative: Single, mask: NDArray[np.bool_], variance: Single) -> Decoded:
        """Places of a band of lines.

        Parameters
        ----------
        relative
            float32, (pitches, lines, columns): differences over white, all colours together, of
            the chosen pitches.
        mask
            bool, (lines, columns).
        variance
            float32, (lines, columns), of the noise of a difference.
        """
        seen = np.ascontiguousarray(np.moveaxis(relative, 0, -1))
        places = self._coarse(seen, mask)
        slopes = gradients(places, mask)
        contrast = np.broadcast_to(self.contrast.astype(np.float32), seen.shape)
        for _ in range(_ROUNDS):
            steps, precision = self._measured(seen, contrast, places, mask, variance)
            np.clip(steps, -_LONGEST_STEP_PX, _LONGEST_STEP_PX, out=steps)
            places, slopes = smoothed(
                places, steps, precision, mask, slopes, float(self.waves.pitch_px.min())
            )
            contrast = self._local_contrast(seen, places, mask)
        return Decoded(places.astype(np.float32), contrast)

    def beside(
        self, relative: Single, found: Decoded, mask: NDArray[np.bool_], variance: Single
    ) -> Single:
        """How far from the place of all colours one of them sees, float32, (lines, columns).

        Parameters as for `decoded`, the differences those of one colour.
        """
        seen = np.ascontiguousarray(np.moveaxis(relative, 0, -1))
        away = np.zeros(mask.shape)
        for _ in range(_COLOUR_ROUNDS):
            places = found.places_px + away
            steps, precision = self._measured(
                seen, found.contrast, places, mask, variance, _COLOUR_OUTLIER
            )
            np.clip(steps, -_LONGEST_STEP_PX, _LONGEST_STEP_PX, out=steps)
            weighted = ndimage.uniform_filter((away + steps) * precision, _CONTRAST_PX)
            weights = ndimage.uniform_filter(precision, _CONTRAST_PX)
            held = weights + _COLOUR_PRIOR * np.mean(precision[mask])
            before, away = away, np.clip(weighted / held, -_MOST_COLOUR_PX, _MOST_COLOUR_PX)
            if np.mean(np.abs(away - before)[mask]) < _ARRIVED_PX:
                break
        return away.astype(np.float32)

    def misfit(self, relative: Single) -> float:
        """Mean square that the best place leaves at edges of wide stripes, over all pitches.

        In the middle of all stripes a pixel reads as some place in any code. At the edge of one
        the others stand as only this code has them.

        Parameters
        ----------
        relative
            (pitches, n) of the chosen differences.
        """
        wide = self.waves.pitch_px >= _WIDE * self.waves.pitch_px.min()
        faint = np.abs(relative) < (_AT_EDGE * self.contrast)[:, np.newaxis]
        edges = faint[wide].any(axis=0)
        looked_at = relative[:, edges] if edges.any() else relative
        seen = np.ascontiguousarray(looked_at.T[:, np.newaxis])
        _, cost = self._found(seen, np.ones((len(seen), 1), bool))
        return float(np.mean(cost)) / len(relative)

    def _coarse(self, seen: Single, mask: NDArray[np.bool_]) -> Array:
        places, _ = self._found(seen, mask)
        return places

    def _found(self, seen: Single, mask: NDArray[np.bool_]) -> tuple[Array, Single]:
        """Places on the lattice, and the misfits that they leave."""
        step_px = self.waves.pitch_px.min() * _LATTICE
        lattice = np.arange(step_px / 2, self.extent_px, step_px)
        waves = first_waves(self.waves, lattice)
        least = (_LEAST_SHARE * self.contrast).astype(np.float32)
        most = np.minimum(_MOST_SHARE * self.contrast, _MOST).astype(np.float32)
        typical = self.contrast.astype(np.float32)
        index, cost = np.zeros(mask.shape, np.int64), np.zeros(mask.shape, np.float32)
        _search(seen, mask, waves, least, most, typical, index, cost)
        return np.where(mask, lattice[index], 0.0), cost

    def _measured(
        self,
        seen: Single,
        contrast: Single,
        places: Array,
        mask: NDArray[np.bool_],
        variance: Single,
        outlier: float = _OUTLIER,
    ) -> tuple[Array, Array]:
        """Newton's step of every pixel and its weight, (lines, columns)."""
        steps, precision = np.zeros(mask.shape), np.zeros(mask.shape)
        waves = self.waves
        _step(
            seen, contrast, places, mask, variance, np.ascontiguousarray(waves.wave[:, 0]),
            waves.slope, waves.first, waves.pitch_px, outlier, steps, precision,
        )  # fmt: skip
        return steps, precision

    def _local_contrast(self, seen: Single, places: Array, mask: NDArray[np.bool_]) -> Single:
        """Contrast that is left of each pitch around each pixel, (lines, columns, pitches)."""
        waves = self.waves
        wave = first_waves(waves, places.reshape(-1))
        wave = np.ascontiguousarray(wave.T).reshape(seen.shape)
        wave[~mask] = 0
        size = (_CONTRAST_PX, _CONTRAST_PX, 1)
        along = ndimage.uniform_filter(wave * seen, size)
        power = ndimage.uniform_filter(wave * wave, size)
        prior = np.float32(_CONTRAST_PRIOR)
        contrast: Single = (along + prior * self.contrast.astype(np.float32)) / (power + prior)
        return np.clip(contrast, 0, np.float32(_MOST))


@dataclass(frozen=True, slots=True)
class Decoded:
    """Places along one axis, (lines, columns), and the contrast, (lines, columns, pitches)."""

    places_px: Single
    contrast: Single


def binary_codes(
    waves: CodeWaves, relative: Single, projector_px: tuple[int, int]
) -> tuple[BinaryCode | None, BinaryCode | None]:
    """Codes down and right; None where too few resolved pitches vary in that direction.

    Parameters
    ----------
    waves
        Of all pitches.
    relative
        float32, (pitches, n): differences over white of some pixels.
    projector_px
        (height, width).
    """
    contrast = np.percentile(np.abs(relative), _SHARP_PERCENTILE, axis=1)
    codes: list[BinaryCode | None] = []
    for axis in range(2):
        members = np.flatnonzero((waves.axis == axis) & (contrast > LEAST_CONTRAST))
        if members.size < LEAST_PITCHES:
            codes.append(None)
            continue
        order = np.argsort(waves.pitch_px[members], kind="stable")
        chosen = members[order]
        # Wider stripes keep no less.
        typical = np.minimum(np.maximum.accumulate(contrast[chosen]), 1.0)
        period_px = 2.0 * float(np.lcm.reduce(waves.pitch_px[chosen].astype(np.int64)))
        # A code may begin left of the raster, to be even about its middle.
        extent_px = min(2.0 * float(projector_px[axis]), period_px)
        codes.append(BinaryCode(chosen, waves.only(chosen), typical, extent_px))
    return codes[0], codes[1]


def relative_to(light: Single, differences: Single | Sequence[Single]) -> Single:
    """Differences over white, 0 where there is no light."""
    inverse = np.where(light > 0, 1 / np.where(light > 0, light, 1), 0).astype(np.float32)
    relative: Single = np.asarray(differences, np.float32) * inverse
    return relative


@compiled
def _misfits(seen, waves, least, most, typical, begin, end, cost):  # type: ignore[no-untyped-def]
    """Of one pixel at the places of the lattice from `begin` to before `end`."""
    for j in range(begin, end):
        cost[j] = 0
    for k in range(seen.size):
        value, low, high, middle = seen[k], least[k], most[k], typical[k]
        for j in range(begin, end):
            wave = waves[k, j]
            one, other = low * wave, high * wave
            off = max(min(one, other) - value, value - max(one, other), np.float32(0))
            away = value - middle * wave
            cost[j] += min(off * off, np.float32(_MOST_MISFIT)) + np.float32(_TYPICAL_WEIGHT) * min(
                away * away, np.float32(_MOST_MISFIT)
            )


@compiled
def _search(seen, mask, waves, least, most, typical, index, left):  # type: ignore[no-untyped-def]
    """Best place of every pixel on the lattice, and its misfit."""
    n_places = waves.shape[1]
    cost = np.empty(n_places, np.float32)
    explained = np.float32(_EXPLAINED * len(waves))
    for y in range(mask.shape[0]):
        last = -1
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            begin, end = 0, n_places
            if last >= 0:
                begin, end = max(last - _NEAR_STEPS, 0), min(last + _NEAR_STEPS + 1, n_places)
            _misfits(seen[y, x], waves, least, most, typical, begin, end, cost)
            best = begin + int(np.argmin(cost[begin:end]))
            if last >= 0 and cost[best] > explained:
                _misfits(seen[y, x], waves, least, most, typical, 0, n_places, cost)
                best = int(np.argmin(cost))
            index[y, x], left[y, x] = best, cost[best]
            last = best


@compiled
def _step(  # type: ignore[no-untyped-def]
    seen, contrast, places, mask, variance, wave, slope, first, pitch_px, outlier, steps,
    precision,
):  # fmt: skip
    """Newton's steps on the differences of each pixel, and their weights."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            pull, weight = 0.0, 0.0
            known = 1 / (_MODEL_ERROR**2 + variance[y, x])
            for k in range(pitch_px.size):
                index, part = bin_of(places[y, x], 2 * pitch_px[k])
                at, left = first[k] + index, contrast[y, x, k]
                along = left * (slope[at] * (1 - part) + slope[at + 1] * part)
                off = seen[y, x, k] - left * (wave[at] * (1 - part) + wave[at + 1] * part)
                outlying = 1 + (off / outlier) ** 2
                trust = known / (outlying * outlying)
                pull += trust * along * off
                weight += trust * along * along
            steps[y, x] = pull / max(weight, 1e-30)
            precision[y, x] = weight
    largest = precision.max()
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            # Where nothing is told of the place, nor is a step.
            floor = _LEAST_PRECISION * largest
            if precision[y, x] < floor:
                steps[y, x] *= precision[y, x] / floor
