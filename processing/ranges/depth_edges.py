"""Pixels that see two places: across a depth edge, the footprint lies on two surfaces.

One place explains the harmonics of such a pixel badly. The second place is what is left over
decodes to, or a neighbour's place, whichever explains them better, and both are then fitted
together,

    Z = ½ Σ_j Σ_r x_jr Z_r(place j),    x ≥ 0,    Σ_j Σ_r x_jr = white,

and refined in turn, each on what the other leaves. Direct light is the sum of both x_j0.

The account of two places is believed where it explains the harmonics much better than one does and
a neighbour sees the second place; and, whatever it finds, where one place explains them hopelessly:
there the footprint is drawn out over many projector pixels, as at the rim of a round object, and
what a single place would lose of the direct light is far more than two can feign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign
from processing.ranges.account_fit import add_row, held_weight
from processing.ranges.correspondence import decode_residual, refined
from processing.ranges.kernels import compiled
from processing.ranges.response import ResponseTables, bin_of
from processing.ranges.slopes import between, model_errors
from processing.ranges.spectrum import solve_passive, solve_spectrum

Array = NDArray[np.float64]
Harmonics = NDArray[np.complex64]

# Ranges of each place, beside direct light, in finest pitches.
_RANGES = (1.0, 4.0, 16.0)
_ROUNDS = 3
# χ² a degree of freedom from which a second place is looked for; what two places must leave of it.
_SUSPECT = 2.0
_MOST_LEFT = 0.6
# χ² a degree of freedom from which one place is no account at all.
_HOPELESS = 5.0


@dataclass(frozen=True, slots=True)
class Setting:
    """What is known of a capture, for each colour where it says so.

    Parameters
    ----------
    designs
        One a pitch.
    projector_px
        (height, width).
    tables
        Of each colour.
    noise_gains
        (pitches,), see `processing.ranges.slopes.slope_noise_gain`.
    """

    designs: Sequence[PitchDesign]
    projector_px: tuple[int, int]
    tables: Sequence[ResponseTables]
    noise_gains: Array


@dataclass(frozen=True, slots=True)
class Seen:
    """n pixels.

    Parameters
    ----------
    harmonics
        complex64, (pitches, 2, n, colours), constant light subtracted.
    places
        (2, n, colours), decoded as if there were one.
    gains
        (n, pitches, 2, colours), see `processing.ranges.blur.Blur.gains`.
    white, variance
        (n, colours), the second of the noise of a frame.
    beside
        (2, n, neighbours), `processing.ranges.jumps.places_beside`.
    """

    harmonics: Harmonics
    places: Array
    gains: Array
    white: Array
    variance: Array
    beside: Array

    def only(self, pixels: NDArray[np.int64]) -> Seen:
        """Some of them."""
        return Seen(
            self.harmonics[:, :, pixels],
            self.places[:, pixels],
            self.gains[pixels],
            self.white[pixels],
            self.variance[pixels],
            self.beside[:, pixels],
        )


@dataclass(frozen=True, slots=True)
class TwoPlaces:
    """Those m of n pixels that two places explain much better than one does, or one not at all.

    Parameters
    ----------
    pixels
        int64, (m,): which.
    second_px
        float64, (2, m): y and x of the second place.
    direct_light, deviations
        float64, (m, colours): direct light of both, and its standard error.
    hopeless
        bool, (m,): one place explains nothing.
    """

    pixels: NDArray[np.int64]
    second_px: Array
    direct_light: Array
    deviations: Array
    hopeless: NDArray[np.bool_]

    def only(self, kept: NDArray[np.bool_]) -> TwoPlaces:
        """Some of them, `kept`, (m,)."""
        return TwoPlaces(
            self.pixels[kept],
            self.second_px[:, kept],
            self.direct_light[kept],
            self.deviations[kept],
            self.hopeless[kept],
        )


def fit_two_places(setting: Setting, seen: Seen) -> TwoPlaces:
    """Find and fit a second place of the pixels that one explains badly."""
    alone = _Fit.of(setting, seen, (seen.places,))
    degrees = 4 * len(setting.designs) * seen.white.shape[1]
    suspect = np.flatnonzero(alone.chi2 > _SUSPECT * degrees)
    seen, left = seen.only(suspect), alone.left[0][:, :, suspect]
    first, second = seen.places, _best_start(setting, seen, left)
    left = _Fit.of(setting, seen, (first, second)).left[0]
    for _ in range(_ROUNDS):
        second = refined(left, setting.tables, second)
        both = _Fit.of(setting, seen, (first, second))
        first = refined(both.left[1], setting.tables, first)
        both = _Fit.of(setting, seen, (first, second))
        left = both.left[0]
    hopeless = alone.chi2[suspect] > _HOPELESS * degrees
    two = TwoPlaces(
        suspect, second.mean(axis=-1), both.direct_light, both.deviations, hopeless
    )  # fmt: skip
    return two.only(hopeless | (both.chi2 < _MOST_LEFT * alone.chi2[suspect]))


def _best_start(setting: Setting, seen: Seen, left: Harmonics) -> Array:
    """The second places, (2, n, colours), that explain best beside the first before any step."""
    rough = decode_residual(left, setting.designs, setting.tables, setting.projector_px)
    best = refined(left, setting.tables, rough)
    least = _Fit.of(setting, seen, (seen.places, best)).chi2
    for beside in np.moveaxis(seen.beside, -1, 0):
        start = np.repeat(beside[..., np.newaxis], best.shape[-1], axis=-1)
        chi2 = _Fit.of(setting, seen, (seen.places, start)).chi2
        better = chi2 < least
        best[:, better], least[better] = start[:, better], chi2[better]
    return best


@dataclass(frozen=True, slots=True)
class _Fit:
    """(n, colours) of direct light and its error, χ² over all colours, what each place leaves."""

    direct_light: Array
    deviations: Array
    chi2: Array
    left: Harmonics

    @classmethod
    def of(cls, setting: Setting, seen: Seen, places: tuple[Array, ...]) -> _Fit:
        """Fit the pixels as seeing some places, (2, n, colours) each."""
        fits = []
        for colour, tables in enumerate(setting.tables):
            finest = tables.pitch_px.min()
            apart = [np.abs(tables.spread_px - ratio * finest) for ratio in _RANGES]
            wanted = [0, *(int(np.argmin(one)) for one in apart)]
            fits.append(
                _fit_all(
                    np.ascontiguousarray(np.moveaxis(seen.harmonics[..., colour], -1, 0)),
                    np.stack([place[..., colour] for place in places]),
                    np.ascontiguousarray(tables.down[:, wanted]),
                    np.ascontiguousarray(tables.right[:, wanted]),
                    tables.first,
                    tables.pitch_px,
                    np.ascontiguousarray(seen.gains[..., colour]),
                    np.ascontiguousarray(seen.white[:, colour]),
                    np.ascontiguousarray(seen.variance[:, colour]),
                    setting.noise_gains,
                    _mean_energy(tables),
                    model_errors(tables.pitch_px, tables.blur_error_px2),
                )
            )
        direct, error, chi2, left = zip(*fits, strict=True)
        return cls(
            np.stack(direct, axis=-1),
            np.stack(error, axis=-1),
            np.sum(chi2, axis=0),
            np.moveaxis(np.stack(left, axis=-1), 1, 3),
        )


def _mean_energy(tables: ResponseTables) -> Array:
    """Mean of ⟨Z_0, Z_0⟩ over all places, (pitches,)."""
    ends = [*tables.first[1:], len(tables.down)]
    means = [
        np.mean(np.abs(tables.down[first:end, 0]) ** 2)
        * np.mean(np.abs(tables.right[first:end, 0]) ** 2)
        for first, end in zip(tables.first, ends, strict=True)
    ]
    return 2 * np.array(means)


@compiled
def _fill_atoms(atoms, places, down, right, first, pitch_px, gain):  # type: ignore[no-untyped-def]
    """(4 · pitches, places · ranges + 1): what unit light of each adds to the harmonics."""
    n_places, n_ranges = len(places), down.shape[1]
    for k in range(len(pitch_px)):
        for p in range(n_places):
            bin_y, part_y = bin_of(places[p, 0], 2 * pitch_px[k])
            bin_x, part_x = bin_of(places[p, 1], 2 * pitch_px[k])
            for r in range(n_ranges):
                y = between(down, first[k] + bin_y, part_y, r)
                x = between(right, first[k] + bin_x, part_x, r)
                plus, minus = 0.5 * y * x * gain[k, 0], 0.5 * y * np.conj(x) * gain[k, 1]
                a = p * n_ranges + r
                atoms[4 * k, a], atoms[4 * k + 1, a] = plus.real, plus.imag
                atoms[4 * k + 2, a], atoms[4 * k + 3, a] = minus.real, minus.imag


@compiled
def _normal_equations(atoms, seen, weight, white, gram, moment):  # type: ignore[no-untyped-def]
    """AᵀWA and AᵀWb, with the total held to white."""
    held = held_weight(white)
    gram[:] = held
    moment[:] = held * white
    for row in range(len(atoms)):
        add_row(gram, moment, atoms[row], seen[row], weight[row])


@compiled
def _take_off(seen, atoms, amounts, first, end, left):  # type: ignore[no-untyped-def]
    """What the light of some atoms leaves."""
    for row in range(len(seen)):
        left[row] = seen[row]
        for a in range(first, end):
            left[row] -= amounts[a] * atoms[row, a]


@compiled
def _fit_all(  # type: ignore[no-untyped-def]
    harmonics, places, down, right, first, pitch_px, gain, white, variance, noise_gains, energy,
    model,
):  # fmt: skip
    n_places, (n_pixels, n_pitches, _), n_ranges = len(places), harmonics.shape, down.shape[1]
    n_atoms = n_places * n_ranges + 1
    direct, error, chi2 = np.zeros(n_pixels), np.zeros(n_pixels), np.zeros(n_pixels)
    left = np.zeros((n_places, n_pixels, n_pitches, 2), np.complex64)
    atoms, weight = np.zeros((4 * n_pitches, n_atoms)), np.zeros(4 * n_pitches)
    seen, rest = np.zeros(4 * n_pitches), np.zeros(4 * n_pitches)
    gram, moment = np.zeros((n_atoms, n_atoms)), np.zeros(n_atoms)
    factor, members = np.zeros((n_atoms, n_atoms)), np.zeros(n_atoms, np.int64)
    passive, amounts, moved = np.zeros(n_atoms, np.bool_), np.zeros(n_atoms), np.zeros(n_atoms)
    # The direct light of all places together.
    chosen = np.zeros(n_atoms)
    chosen[: n_atoms - 1 : n_ranges] = 1
    for i in range(n_pixels):
        _fill_atoms(atoms, places[:, :, i], down, right, first, pitch_px, gain[i])
        for k in range(n_pitches):
            for sign in range(2):
                seen[4 * k + 2 * sign] = harmonics[i, k, sign].real
                seen[4 * k + 2 * sign + 1] = harmonics[i, k, sign].imag
            spread = noise_gains[k] * variance[i] + energy[k] * (model[k] * white[i]) ** 2
            weight[4 * k : 4 * k + 4] = 4 / (spread + 1e-30)
        _normal_equations(atoms, seen, weight, white[i], gram, moment)
        count = solve_spectrum(gram, moment, passive, amounts, factor, members, moved)
        _take_off(seen, atoms, amounts, 0, n_atoms, rest)
        for row in range(len(rest)):
            chi2[i] += weight[row] * rest[row] ** 2
        solve_passive(factor, members, count, chosen, moved)
        total, spread = 0.0, 0.0
        for p in range(n_places):
            total += amounts[p * n_ranges]
            spread += moved[p * n_ranges]
            _take_off(seen, atoms, amounts, p * n_ranges, (p + 1) * n_ranges, rest)
            for k in range(n_pitches):
                for sign in range(2):
                    at = 4 * k + 2 * sign
                    left[p, i, k, sign] = complex(rest[at], rest[at + 1])
        direct[i] = min(total, white[i])
        error[i] = np.sqrt(max(spread, 0.0) * max(chi2[i] / (4 * n_pitches), 1.0))
    return direct, error, chi2, left
