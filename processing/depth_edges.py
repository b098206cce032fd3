"""Pixels that see two places: across a depth edge, the footprint lies on two surfaces.

One place explains the harmonics of such a pixel badly. What it leaves over is decoded once more,
which gives the second place, and both are then fitted together,

    Z = ½ Σ_j Σ_r x_jr Z_r(place j),    x ≥ 0,    Σ_j Σ_r x_jr = white,

and refined in turn, each on what the other leaves. Direct light is the sum of both x_j0. The
account of two places is believed only where it explains the harmonics much better than one does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray
from scipy import ndimage

from processing.blur import Blur
from processing.correspondence import decode_residual, refined
from processing.harmonics import PitchDesign
from processing.range_fit import look_up, model_errors
from processing.response import ResponseTables
from processing.spectrum import solve_spectrum

Array = NDArray[np.float64]
Harmonics = NDArray[np.complex64]

# Ranges of each place, beside direct light, in finest pitches.
_RANGES = (1.0, 4.0, 16.0)
_ROUNDS = 3
# χ² a degree of freedom from which a second place is looked for; what two places must leave of it.
_SUSPECT = 2.0
_MOST_LEFT = 0.6
# In camera pixels: what is a jump on the projector, how far from one footprints are divided, how
# far to look for a neighbour that sees the second place, and how well they must agree.
_JUMP_PX = 4.0
_REACH_PX = 2
_NEIGHBOUR_PX = 3
_AGREEMENT_PX = 3.0
_TOTAL_WEIGHT = 300.0


@dataclass(frozen=True, slots=True)
class Setting:
    """What is known of a capture, for each colour where it says so.

    Parameters
    ----------
    designs
        One a pitch.
    projector_px
        (height, width).
    tables, blur
        Of each colour.
    noise_gains
        (pitches,), see `processing.range_fit.slope_noise_gain`.
    """

    designs: Sequence[PitchDesign]
    projector_px: tuple[int, int]
    tables: Sequence[ResponseTables]
    blur: Sequence[Blur]
    noise_gains: Array


@dataclass(frozen=True, slots=True)
class TwoPlaces:
    """The account of two places of n pixels.

    Parameters
    ----------
    found
        bool, (n,): two places are much better than one.
    second_px
        float64, (2, n): y and x of the second place.
    direct_light, deviations
        float64, (n, colours): direct light of both, and its standard error.
    """

    found: NDArray[np.bool_]
    second_px: Array
    direct_light: Array
    deviations: Array


def misfit(
    setting: Setting, harmonics: Harmonics, places: Array, white: Array, variance: Array
) -> Array:
    """χ² of one place a degree of freedom, (n,), over all colours.

    Parameters
    ----------
    setting
        The capture.
    harmonics
        complex64, (pitches, 2, n, colours), constant light subtracted.
    places
        (2, n, colours).
    white, variance
        (n, colours), the second of the noise of a frame.
    """
    chi2 = np.zeros(white.shape[0])
    for colour in range(white.shape[1]):
        _, _, one, _ = _fitted(setting, harmonics, (places,), white, variance, colour)
        chi2 += one
    return chi2 / (4 * len(setting.designs) * white.shape[1])


def fit_two_places(
    setting: Setting, harmonics: Harmonics, places: Array, white: Array, variance: Array
) -> TwoPlaces:
    """Find and fit a second place; parameters as for `misfit`."""
    before = misfit(setting, harmonics, places, white, variance)
    first, second = places.copy(), places.copy()
    colours = range(white.shape[1])
    spectra = [_fitted(setting, harmonics, (places,), white, variance, c)[3][0] for c in colours]
    for turn in range(_ROUNDS):
        left = np.stack(spectra, axis=-1)
        if turn == 0:
            start = decode_residual(left, setting.designs, setting.tables, setting.projector_px)
        else:
            start = second
        second = refined(left, setting.tables, start)
        both = [_fitted(setting, harmonics, (first, second), white, variance, c) for c in colours]
        first = refined(np.stack([one[3][1] for one in both], axis=-1), setting.tables, first)
        spectra = [
            _fitted(setting, harmonics, (first, second), white, variance, c)[3][0] for c in colours
        ]
    both = [_fitted(setting, harmonics, (first, second), white, variance, c) for c in colours]
    after = np.sum([one[2] for one in both], axis=0) / (4 * len(setting.designs) * len(both))
    return TwoPlaces(
        (before > _SUSPECT) & (after < _MOST_LEFT * before),
        second.mean(axis=-1),
        np.stack([one[0] for one in both], axis=-1),
        np.stack([one[1] for one in both], axis=-1),
    )


def near_jumps(
    places_px: NDArray[np.floating], mask: NDArray[np.bool_], scale_px: float
) -> NDArray[np.bool_]:
    """Pixels beside which the place on the projector jumps, bool, (height, width).

    Parameters
    ----------
    places_px
        (2, height, width), y and x.
    mask
        bool, (height, width), where they are known.
    scale_px
        Usual distance on the projector between neighbouring pixels.
    """
    jumps = np.zeros(mask.shape, bool)
    for axis in range(2):
        ahead = [slice(None), slice(None)]
        behind = [slice(None), slice(None)]
        ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
        step = np.abs(np.diff(places_px, axis=axis + 1)).max(axis=0)
        jumped = (step > _JUMP_PX * scale_px) & mask[tuple(ahead)] & mask[tuple(behind)]
        jumps[tuple(ahead)] |= jumped
        jumps[tuple(behind)] |= jumped
    side = 2 * _REACH_PX - 1
    near: NDArray[np.bool_] = ndimage.binary_dilation(jumps, np.ones((side, side))) & mask
    return near


def seen_beside(
    places_px: NDArray[np.floating], pixels: NDArray[np.int64], second_px: Array, scale_px: float
) -> NDArray[np.bool_]:
    """Whether a pixel nearby sees the second place as its only one.

    A mirror image of the pattern is a second place, too, but no neighbour sees it.

    Parameters
    ----------
    places_px, scale_px
        As for `near_jumps`.
    pixels
        (2, n): rows and columns.
    second_px
        (2, n), see `TwoPlaces`.
    """
    agreed = np.zeros(pixels.shape[1], bool)
    height, width = places_px.shape[1:]
    offsets = range(-_NEIGHBOUR_PX, _NEIGHBOUR_PX + 1)
    for down in offsets:
        for right in offsets:
            row = np.clip(pixels[0] + down, 0, height - 1)
            column = np.clip(pixels[1] + right, 0, width - 1)
            apart = np.abs(places_px[:, row, column] - second_px).max(axis=0)
            agreed |= apart < _AGREEMENT_PX * scale_px
    away = np.abs(places_px[:, pixels[0], pixels[1]] - second_px).max(axis=0)
    return agreed & (away > _JUMP_PX * scale_px)


def _fitted(
    setting: Setting,
    harmonics: Harmonics,
    places: tuple[Array, ...],
    white: Array,
    variance: Array,
    colour: int,
) -> tuple[Array, Array, Array, NDArray[np.complex64]]:
    """Direct light, its error, χ², and what each place leaves: (places, pitches, 2, n)."""
    tables, blur = setting.tables[colour], setting.blur[colour]
    finest = tables.pitch_px.min()
    wanted = [0, *(int(np.argmin(np.abs(tables.spread_px - r * finest))) for r in _RANGES)]
    pixels = np.ascontiguousarray(np.moveaxis(harmonics[..., colour], -1, 0))
    stacked = np.stack([place[..., colour] for place in places])
    energy = np.array(
        [
            2
            * np.mean(np.abs(tables.down[a:b, 0]) ** 2)
            * np.mean(np.abs(tables.right[a:b, 0]) ** 2)
            for a, b in zip(tables.first, [*tables.first[1:], len(tables.down)], strict=True)
        ]
    )
    direct, error, chi2, left = _fit_all(
        pixels, stacked, tables.down[:, wanted].copy(), tables.right[:, wanted].copy(),
        tables.first, tables.pitch_px, blur.diagonal_gain(tables.pitch_px), white[:, colour].copy(),
        variance[:, colour].copy(), setting.noise_gains, energy, model_errors(tables.pitch_px),
    )  # fmt: skip
    return direct, error, chi2, np.ascontiguousarray(np.moveaxis(left, 1, -1))


@njit(parallel=True, cache=True)
def _fit_all(  # type: ignore[no-untyped-def]
    harmonics, places, down, right, first, pitch_px, gain, white, variance, noise_gains, energy,
    model,
):  # fmt: skip
    n_places, (n_pixels, n_pitches, _), n_ranges = len(places), harmonics.shape, down.shape[1]
    n_atoms = n_places * n_ranges + 1
    direct, error, chi2 = np.zeros(n_pixels), np.zeros(n_pixels), np.zeros(n_pixels)
    left = np.zeros((n_places, n_pixels, n_pitches, 2), np.complex64)
    for i in prange(n_pixels):
        atoms = np.zeros((n_atoms, 4 * n_pitches))
        seen, weight = np.zeros(4 * n_pitches), np.zeros(4 * n_pitches)
        for k in range(n_pitches):
            spread = noise_gains[k] * variance[i] + energy[k] * (model[k] * white[i]) ** 2
            for s in range(2):
                seen[4 * k + 2 * s] = harmonics[i, k, s].real
                seen[4 * k + 2 * s + 1] = harmonics[i, k, s].imag
            weight[4 * k : 4 * k + 4] = 4 / (spread + 1e-30)
            for p in range(n_places):
                for r in range(n_ranges):
                    y = look_up(down, first[k], 2 * pitch_px[k], places[p, 0, i], r)
                    x = look_up(right, first[k], 2 * pitch_px[k], places[p, 1, i], r)
                    plus, minus = 0.5 * y * x * gain[k], 0.5 * y * np.conj(x) / gain[k]
                    atom = atoms[p * n_ranges + r]
                    atom[4 * k], atom[4 * k + 1] = plus.real, plus.imag
                    atom[4 * k + 2], atom[4 * k + 3] = minus.real, minus.imag
        amounts = np.zeros(n_atoms)
        inverse = np.zeros((n_atoms, n_atoms))
        weighted = atoms * weight
        gram, moment = weighted @ atoms.T, weighted @ seen
        held = (_TOTAL_WEIGHT / max(white[i], 1e-12)) ** 2
        solve_spectrum(gram + held, moment + held * white[i], amounts, inverse)
        residual = seen.copy()
        for a in range(n_atoms):
            residual -= amounts[a] * atoms[a]
        for j in range(4 * n_pitches):
            chi2[i] += weight[j] * residual[j] ** 2
        total, spread = 0.0, 0.0
        for p in range(n_places):
            total += amounts[p * n_ranges]
            for q in range(n_places):
                spread += inverse[p * n_ranges, q * n_ranges]
            # What the light of place p leaves for the others.
            rest = seen.copy()
            for r in range(n_ranges):
                rest -= amounts[p * n_ranges + r] * atoms[p * n_ranges + r]
            for k in range(n_pitches):
                for s in range(2):
                    left[p, i, k, s] = rest[4 * k + 2 * s] + 1j * rest[4 * k + 2 * s + 1]
        direct[i] = min(total, white[i])
        error[i] = np.sqrt(max(spread, 0.0) * max(chi2[i] / (4 * n_pitches), 1.0))
    return direct, error, chi2, left
