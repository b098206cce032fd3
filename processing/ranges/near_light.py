"""Signs of light that left near where it entered, in each pixel, before any fit.

With Z_0 what direct light from a pixel's place would add to the harmonics, q(P) = 2⟨Z_0, Z⟩/⟨Z_0,
Z_0⟩ of a pitch is complex. Its real part is the slope D(P); what of it is lost from coarse to fine
pitches is light of short range, or blur that was not corrected for. Its imaginary part is 0 where
that light comes from all sides alike, as scattering below a surface does, and not where it comes
from one side, as from the other wall of a crease.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import log
from processing.ranges.response import ResponseTables
from processing.ranges.slopes import relative

Array = NDArray[np.float64]

# Pixels of less direct light, relative to white, say nothing about sharpness.
_LEAST_DIRECT = 0.2
# In finest pitches: where the imaginary part is taken, and up to where light counts as near.
_LEAN_FROM, _LEAN_TO, _NEAR = 1.5, 5.0, 6.0
_SECOND = 2.0


@dataclass(frozen=True, slots=True)
class NearLight:
    """Of n pixels; NaN where too few pitches tell.

    Parameters
    ----------
    excess_px2
        (n,): variance a side of the blur beyond the one corrected for, in projector pixels
        squared, that would explain the ratio of the two finest pitches.
    lost
        (2, n): what D loses from six finest pitches to one, and to two, relative to white. An
        error of the blur bends the latter a quarter as much.
    lean
        (2, n): mean imaginary part of q along both diagonals, relative to white.
    """

    excess_px2: Array
    lost: Array
    lean: Array

    @classmethod
    def of(
        cls,
        harmonics: NDArray[np.complex64],
        places: Array,
        tables: tuple[ResponseTables, ...],
        gains: Array,
        white: Array,
    ) -> NearLight:
        """Measure it, all colours together.

        Parameters
        ----------
        harmonics
            (pitches, 2, n, colours), constant light subtracted.
        places
            (2, n, colours).
        tables
            One for each colour.
        gains
            (n, pitches, 2, colours), `processing.ranges.blur.Blur.gains`.
        white
            (n, colours).
        """
        pitch_px, varies = tables[0].pitch_px, tables[0].varies
        finest = pitch_px.min()
        near = np.flatnonzero(pitch_px <= _NEAR * finest)
        seen = np.zeros((len(near), 2, white.shape[0]), np.complex128)
        for k, table in enumerate(tables):
            seen += relative(harmonics[..., k], places[..., k], table, gains[..., k], near)
        share = seen / np.maximum(white.sum(axis=1), 1e-12)
        pitches = np.unique(pitch_px[near])
        rows = [share[pitch_px[near] == one].real.mean(axis=(0, 1)) for one in pitches]
        unknown = np.full(white.shape[0], np.nan)
        excess = unknown if len(pitches) < 2 else _excess(rows[0], rows[1], pitches[:2])
        middle = (pitch_px[near] >= _LEAN_FROM * finest) & (pitch_px[near] <= _LEAN_TO * finest)
        if middle.sum() < 2 or not varies.all():
            return cls(excess, np.stack([unknown] * 2), np.stack([unknown] * 2))
        second = rows[int(np.argmax(pitches >= _SECOND * finest))]
        lost = rows[-1] - np.stack([rows[0], second])
        return cls(excess, lost, share[middle].imag.mean(axis=0))


def _excess(finest: Array, next_finest: Array, pitch_px: Array) -> Array:
    """A blur of variance s² a side lowers D(P) by exp(−π² s²/P²)."""
    rates = (np.pi / pitch_px) ** 2
    bright = (finest > _LEAST_DIRECT) & (next_finest > _LEAST_DIRECT)
    ratio = np.where(bright, finest, 1.0) / np.where(bright, next_finest, 1.0)
    return np.where(bright, -log(ratio) / (rates[0] - rates[1]), np.nan)
