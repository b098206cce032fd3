"""The correlation slope of the frames of a pitch with the pattern that a pixel sees.

With Z the harmonics of a pixel and Z_0 those that direct light from its place would have,

    D(P) = 2 Re⟨Z_0, Z⟩ / ⟨Z_0, Z_0⟩,

with ⟨·,·⟩ over Z⁺ and Z⁻. It has the variance gain·σ²/⟨Z_0, Z_0⟩ from noise of variance σ² in a
frame; to it is added that of the model, a fixed part of white.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.frames.harmonics import PitchDesign
from processing.numerics.elementary import hypot
from processing.ranges.kernels import compiled
from processing.ranges.response import ResponseTables, bin_of

Array = NDArray[np.float64]

# Standard deviation of D/white at the finest pitch that footprints and the dictionary leave: on
# a board, which has direct light alone, D is off by 0.3 to 2 %. Light from afar is less like its
# Gaussian spreads the wider the pattern: it grows as the root of the pitch.
_MODEL_ERROR = 0.01


def model_errors(pitch_px: Array, blur_error_px2: float = 0.0) -> Array:
    """Standard deviation of D/white that is laid to the model, (pitches,).

    Parameters
    ----------
    pitch_px
        (pitches,).
    blur_error_px2
        `processing.ranges.blur.Blur.error_px2`, which bends fine pitches.
    """
    shape = _MODEL_ERROR * np.sqrt(pitch_px / pitch_px.min())
    bent = blur_error_px2 * (np.pi / pitch_px) ** 2
    errors: Array = hypot(shape, bent)
    return errors


def told_of_blur(pitch_px: Array, blur_error_px2: float) -> float:
    """What a blur leaves of the χ² by which light of short range shows, in (0, 1].

    Short ranges and blur alike bend D(P)/white as (π/P)², which counts by its square over the
    variance of `model_errors`; these grow with the blur that is corrected for.

    Parameters
    ----------
    pitch_px, blur_error_px2
        As for `model_errors`.
    """
    bend = (np.pi / pitch_px) ** 2
    left, all_of_it = (
        float(np.sum((bend / model_errors(pitch_px, error)) ** 2)) for error in (blur_error_px2, 0)
    )
    return left / all_of_it


def slope_noise_gain(design: PitchDesign) -> float:
    """Variance of D, times ⟨Z_0, Z_0⟩, for frames of unit variance.

    In a grid over both directions Z⁺ and Z⁻ have independent noise, of variance n/2 for n frames
    in each real part; along one direction they hold the same noise.
    """
    both = design.family.varies_down and design.family.varies_right
    return (2.0 if both else 4.0) * len(design.patterns)


def slopes(
    harmonics: NDArray[np.complex64], places: Array, tables: ResponseTables, gains: Array
) -> Array:
    """D of both diagonals apart, (n, pitches, 2).

    Parameters
    ----------
    harmonics
        (pitches, 2, n) of one colour, constant light subtracted.
    places
        (2, n), see `processing.ranges.correspondence.Correspondence`.
    tables
        Of this colour.
    gains
        (n, pitches, 2), `processing.ranges.blur.Blur.gains`.
    """
    every = np.arange(len(tables.pitch_px))
    return np.moveaxis(relative(harmonics, places, tables, gains, every).real, -1, 0)


def relative(
    harmonics: NDArray[np.complex64],
    places: Array,
    tables: ResponseTables,
    gains: Array,
    chosen: NDArray[np.int64],
) -> NDArray[np.complex128]:
    """2⟨Z_0, Z⟩/⟨Z_0, Z_0⟩ of both diagonals apart, (m, 2, n); its real part is D.

    Parameters
    ----------
    harmonics, places, tables, gains
        As for `slopes`.
    chosen
        (m,): which pitches.
    """
    found = np.empty((len(chosen), 2, len(gains)), np.complex128)
    _relate(
        np.ascontiguousarray(harmonics), np.ascontiguousarray(places),
        np.ascontiguousarray(tables.down[:, 0]), np.ascontiguousarray(tables.right[:, 0]),
        tables.first, tables.pitch_px, np.ascontiguousarray(np.moveaxis(gains, 0, -1)), chosen,
        found,
    )  # fmt: skip
    return found


@compiled
def between(table, index, part, spread):  # type: ignore[no-untyped-def]
    """Linear between bins."""
    return table[index, spread] * (1 - part) + table[index + 1, spread] * part


@compiled
def _relate(  # type: ignore[no-untyped-def]
    harmonics, places, down, right, first, pitch_px, gain, chosen, found
):  # fmt: skip
    for m in range(len(chosen)):
        k = chosen[m]
        for i in range(found.shape[2]):
            bin_y, part_y = bin_of(places[0, i], 2 * pitch_px[k])
            bin_x, part_x = bin_of(places[1, i], 2 * pitch_px[k])
            bin_y, bin_x = first[k] + bin_y, first[k] + bin_x
            at_y = down[bin_y] * (1 - part_y) + down[bin_y + 1] * part_y
            at_x = right[bin_x] * (1 - part_x) + right[bin_x + 1] * part_x
            for sign in range(2):
                one = at_y * (at_x if sign == 0 else np.conj(at_x)) * gain[k, sign, i]
                energy = max(one.real * one.real + one.imag * one.imag, 1e-12)
                found[m, sign, i] = harmonics[k, sign, i] * np.conj(one) * (2 / energy)
