"""Ranges of light from the direct images of max and min alone, where no frames are at hand.

With the complement, the direct image of a pitch compares the brightest with the darkest place in
the pattern. Through a spread of variance σ² that is, in the middle of a check and relative to no
spread,

    A(P) = (p(σ)/p(0))ⁿ,   p(σ) = Σ_{m odd} 4/(πm) exp(−½ (πmσ/P)²) (−1)^{(m−1)/2},

with n = 2 for checkers and 1 for stripes; for sinusoids p is their one harmonic. No places are
needed, but what correlation gains over all frames is lost: the noise of the extreme frames, and
shifts that miss the middle of a check, enter in full.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.noise import noise_deviation
from processing.numerics.rows import Rows
from processing.patterns import Family
from processing.ranges.accounts import Account, opaque, spread_grid, translucent
from processing.ranges.blur import BLUR_UNSURE, Blur, shorth
from processing.ranges.pixels import fit_rows
from processing.ranges.result import (
    Capture,
    Fits,
    RangeDecomposition,
    assemble,
    blocks_with,
    lattice,
)
from processing.ranges.scattering import RivalFits, translucent_map
from processing.remarks import Remark

Array = NDArray[np.float64]
Image = NDArray[np.float32]

_ORDERS = np.arange(1, 200, 2, dtype=np.float64)
# Blurs that are tried, relative to the finest pitch.
_BLURS = np.linspace(0.0, 0.6, 121)
_BRIGHT_FRACTION = 0.05
# Pitches of which the blur leaves less than this are as good as left out.
_LEAST_GAIN = 1e-3
# Without places the width of creases in camera pixels is unknown.
_CREASE_PX = 17.0
# Finest over second finest direct image: above this, what is missing may as well be light that
# travelled, and the middle of a check does not feel the blur.
_SHARP_RATIO = 0.98


def decompose_extrema(
    rows: Rows,
    pitch_px: Sequence[float],
    families: Sequence[Family],
    white: Image,
    mask: NDArray[np.bool_],
) -> RangeDecomposition:
    """Take direct images apart by range of light.

    Parameters
    ----------
    rows
        m images, float32, (height, width, colours): direct light at each pitch, separated with
        the complement. They may be mapped from files and are read in blocks.
    pitch_px
        (m,), increasing, in projector pixels.
    families
        (m,), of patterns.
    white
        float32, (height, width, colours), the scene under full light.
    mask
        bool, (height, width), True where a pixel is usable.
    """
    pitches = np.asarray(pitch_px, np.float64)
    _check(rows, pitches, families, white, mask)
    spaced = lattice(mask.shape)
    usable = mask[spaced]
    sample = [np.asarray(row[spaced])[usable] for row in rows]
    blur_px, warnings = _blur_px(sample, pitches, families, white[spaced][usable])
    noise = np.array([noise_deviation(np.asarray(row), mask) for row in rows])
    model = _Model.of(pitches, families, blur_px, noise)
    fits = RivalFits(white.shape)
    for lines in blocks_with(mask):
        chosen = mask[lines]
        block = [np.asarray(row[lines])[chosen] for row in rows]
        lit = white[lines][chosen]
        fits.add(lines, chosen, lit, model.fitted(block, lit))
    found = translucent_map(fits.gain, mask, _CREASE_PX)
    colours = white.shape[2]
    capture = Capture(
        white=white,
        mask=mask,
        pitch_px=pitches,
        accounts=model.accounts,
        responses=(model.responses,) * colours,
        blur=(Blur(blur_px**2),) * colours,
        noise=np.full(colours, float(np.median(noise))),
    )
    return assemble(capture, fits, found, model.fitted(sample, white[spaced][usable]), warnings)


@dataclass(frozen=True, slots=True)
class _Model:
    """How direct images respond: (pitches,) each, and (pitches, spreads) of responses.

    `gains` is what the blur leaves of direct light, `variance` that of the noise once corrected.
    """

    pitch_px: Array
    responses: Array
    gains: Array
    variance: Array
    accounts: tuple[Account, Account]

    @classmethod
    def of(
        cls, pitch_px: Array, families: Sequence[Family], blur_px: float, noise: Array
    ) -> _Model:
        """Responses through a blur, for rows whose noise has the given standard deviations."""
        blurred = _responses(families, pitch_px, np.array([0.0, blur_px]), 0.0)[:, 1]
        gains = np.maximum(blurred, _LEAST_GAIN)
        responses = _responses(families, pitch_px, spread_grid(pitch_px), blur_px)
        accounts = opaque(pitch_px), translucent(pitch_px)
        return cls(pitch_px, responses, gains, (noise / gains) ** 2, accounts)

    def fitted(self, values: Sequence[Image], light: Image) -> Fits:
        """Both accounts of n pixels, for each colour; `values` and `light` are (n, colours)."""
        fits = []
        for colour in range(light.shape[1]):
            slopes = np.stack([row[:, colour] for row in values], axis=1) / self.gains
            white = light[:, colour].astype(np.float64)
            one, other = (
                fit_rows(slopes, self.pitch_px, self.responses, account, white, self.variance)
                for account in self.accounts
            )
            fits.append((one, other))
        return fits


def _check(
    rows: Rows,
    pitch_px: Array,
    families: Sequence[Family],
    white: Image,
    mask: NDArray[np.bool_],
) -> None:
    shape = rows[0].shape
    if not len(rows) == len(pitch_px) == len(families) or shape != white.shape:
        raise ValueError(
            f"{len(rows)} rows of shape {shape}, {len(pitch_px)} pitches, {len(families)} families "
            f"and white of shape {white.shape} do not belong together"
        )
    if mask.shape != white.shape[:2]:
        raise ValueError(f"mask has shape {mask.shape}, white {white.shape}")
    if not mask.any():
        raise ValueError(f"the mask of shape {mask.shape} leaves no usable pixel")


def _peak(family: Family, pitch_px: float, sigma_px: Array) -> Array:
    """Height p of the middle of a check for each spread, relative to none."""
    orders = _ORDERS if family.is_binary else _ORDERS[:1]
    signs = np.where(orders % 4 == 1, 1.0, -1.0) / orders
    reach = np.exp(-0.5 * np.outer(np.pi * sigma_px / pitch_px, orders) ** 2)
    one_way: Array = np.clip(reach @ signs / signs.sum(), 0, 1)
    both = family.varies_down and family.varies_right
    return one_way**2 if both else one_way


def _responses(
    families: Sequence[Family], pitch_px: Array, spread_px: Array, blur_px: float
) -> Array:
    """A(P) of every spread seen through a blur, (m, spreads), relative to no spread."""
    rows = []
    for family, pitch in zip(families, pitch_px, strict=True):
        peaks = _peak(family, pitch, np.hypot(spread_px, blur_px))
        rows.append(peaks / max(peaks[0], 1e-6))
    return np.array(rows)


def _blur_px(
    sample: Sequence[Image], pitch_px: Array, families: Sequence[Family], white: Image
) -> tuple[float, tuple[Remark, ...]]:
    """Blur at which the two finest pitches differ as they do in most pixels."""
    if len(sample) < 2 or pitch_px[1] <= pitch_px[0]:
        return 0.0, (BLUR_UNSURE,)
    bright = white > _BRIGHT_FRACTION * np.percentile(white, 99.5)
    ratio = shorth((sample[0][bright] / np.maximum(sample[1][bright], 1e-9)).astype(np.float64))
    tried = _BLURS * pitch_px[0]
    expected = _peak(families[0], pitch_px[0], tried) / _peak(families[1], pitch_px[1], tried)
    if ratio > _SHARP_RATIO:
        return 0.0, ()
    return float(np.interp(-ratio, -expected, tried)), ()
