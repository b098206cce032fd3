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
from processing.ranges.regions import translucent_map
from processing.ranges.result import (
    Capture,
    Fits,
    RangeDecomposition,
    assemble,
    blocks_with,
    lattice,
)
from processing.ranges.row_fit import RowErrors, fit_rows
from processing.ranges.scattering import RivalFits
from processing.ranges.slopes import model_errors
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
# Of the pixels that are sharper than most, those within one standard deviation, in percent.
_UP_TO_ONE_DEVIATION = 32.0
# By what part of the blur's variance they differ from it where pixels are not equally sharp, and
# how far, relative, the blur of a pixel is then trusted, or else.
_UNEVEN = 0.15
_UNEVEN_ERROR, _EVEN_ERROR = 0.6, 0.05
# What noise adds to direct light, by how much it raises the sum of the extreme values, and how
# uncertain that is.
_ADDED, _ADDED_ERROR = 3.0, 2.0
_UNEVENLY_SHARP = Remark(
    what="The pixels are not equally sharp, as with a lens out of focus, or surfaces seen at "
    "a slant.",
    meaning="From direct images alone this looks like light that travelled by less than the "
    "finest pitches: they count for little, and such light passes for direct.",
    remedy="Focus the camera, or capture and keep all frames.",
)


def decompose_extrema(
    rows: Rows,
    pitch_px: Sequence[float],
    families: Sequence[Family],
    white: Image,
    mask: NDArray[np.bool_],
    raised: Array | None = None,
) -> RangeDecomposition:
    """Take direct images apart by range of light.

    What noise adds to extreme values is taken off as far as they tell it, see `raised_by_noise`,
    and two thirds of that are stated as an error that all pixels share.

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
    raised
        (m, colours), of `raised_by_noise`; None where there is no noise, or nobody knows.
    """
    pitches = np.asarray(pitch_px, np.float64)
    _check(rows, pitches, families, white, mask)
    spaced = lattice(mask.shape)
    usable = mask[spaced]
    raised = np.zeros((len(rows), white.shape[2])) if raised is None else raised
    lit = white[spaced][usable]
    sample = [_freed(row[spaced][usable], lit, one) for row, one in zip(rows, raised, strict=True)]
    blur, warnings = _blur_of(sample, pitches, families, lit)
    noise = np.array([noise_deviation(np.asarray(row), mask) for row in rows])
    model = _Model.of(pitches, families, blur, noise, raised)
    fits = RivalFits(white.shape)
    for lines in blocks_with(mask):
        chosen = mask[lines]
        light = white[lines][chosen]
        block = [
            _freed(row[lines][chosen], light, one) for row, one in zip(rows, raised, strict=True)
        ]
        fits.add(lines, chosen, light, model.fitted(block, light))
    found = translucent_map(fits.gain, mask, _CREASE_PX)
    colours = white.shape[2]
    capture = Capture(
        white=white,
        mask=mask,
        pitch_px=pitches,
        accounts=model.accounts,
        responses=(model.responses,) * colours,
        blur=(Blur(blur.variance_px2),) * colours,
        noise=np.full(colours, float(np.median(noise))),
    )
    return assemble(capture, fits, found, model.fitted(sample, lit), warnings)


def raised_by_noise(largest: Image, smallest: Image, white: Image) -> Array:
    """By how much extreme values add up to more than white, in roots of light.

    Noise raises the largest of many values and lowers the smallest. Brighter light has more of
    it, so that both add up to more than white, by k(σ₊ − σ₋), while direct light found with the
    complement is too large by k(σ₊ + σ₋) and more: 2.4 to 3.5 times as much with a full well of
    20 000 electrons and read noise of 5, up to 8 times as much with read noise of 60. Shot noise
    goes with the root of light.

    Parameters
    ----------
    largest, smallest, white
        float32, (n, colours), of some pixels of a pitch, black subtracted.

    Returns
    -------
    (colours,): median of (L₊ + L₋ − W)/√W; ≥ 0, for noise lowers nothing.
    """
    lit = white > _BRIGHT_FRACTION * np.percentile(white, 99.5)
    excess = (largest + smallest - white) / np.sqrt(np.maximum(white, 1e-9))
    every = [
        np.median(one[bright]) if bright.any() else 0.0
        for one, bright in zip(excess.T, lit.T, strict=True)
    ]
    return np.maximum(np.array(every, np.float64), 0)


def _freed(row: Image, white: Image, raised: Array) -> Image:
    """Direct light of some pixels, (n, colours), without what noise added."""
    return np.asarray(row - _ADDED * raised.astype(np.float32) * np.sqrt(white), np.float32)


@dataclass(frozen=True, slots=True)
class _Model:
    """How direct images respond: (pitches,) each, and (pitches, spreads) of responses.

    `gains` is what the blur leaves of direct light, `errors` those of rows corrected for it.
    """

    pitch_px: Array
    responses: Array
    gains: Array
    errors: RowErrors
    accounts: tuple[Account, Account]

    @classmethod
    def of(
        cls,
        pitch_px: Array,
        families: Sequence[Family],
        blur: _CommonBlur,
        noise: Array,
        raised: Array,
    ) -> _Model:
        """Responses through a blur, for rows whose noise has the given standard deviations."""
        sigma_px = np.sqrt([0.0, blur.variance_px2, blur.variance_px2 + blur.deviation_px2])
        blurred = _responses(families, pitch_px, sigma_px, 0.0)
        gains = np.maximum(blurred[:, 1], _LEAST_GAIN)
        responses = _responses(families, pitch_px, spread_grid(pitch_px), float(sigma_px[1]))
        errors = RowErrors(
            variance=(noise / gains) ** 2,
            bias=_ADDED_ERROR * raised / gains[:, np.newaxis],
            model=np.hypot(model_errors(pitch_px), (blurred[:, 1] - blurred[:, 2]) / gains),
        )
        accounts = opaque(pitch_px), translucent(pitch_px)
        return cls(pitch_px, responses, gains, errors, accounts)

    def fitted(self, values: Sequence[Image], light: Image) -> Fits:
        """Both accounts of n pixels, for each colour; `values` and `light` are (n, colours)."""
        fits = []
        for colour in range(light.shape[1]):
            slopes = np.stack([row[:, colour] for row in values], axis=1) / self.gains
            white = light[:, colour].astype(np.float64)
            one, other = (
                fit_rows(slopes, self.responses, account, white, self.errors, colour)
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


@dataclass(frozen=True, slots=True)
class _CommonBlur:
    """Variance a side of the blur of most pixels, and by how much others may differ from it."""

    variance_px2: float = 0.0
    deviation_px2: float = 0.0


def _blur_of(
    sample: Sequence[Image], pitch_px: Array, families: Sequence[Family], white: Image
) -> tuple[_CommonBlur, tuple[Remark, ...]]:
    """Blur at which the two finest pitches differ as they do in most pixels.

    How much it differs between pixels those tell that are sharper than most: what scatters is only
    less sharp. A lens out of focus mixes the light of neighbours, whose places may be far apart,
    and so bends direct images as much as light of short range does.
    """
    if len(sample) < 2 or pitch_px[1] <= pitch_px[0]:
        return _CommonBlur(), (BLUR_UNSURE,)
    bright = white > _BRIGHT_FRACTION * np.percentile(white, 99.5)
    ratios = (sample[0][bright] / np.maximum(sample[1][bright], 1e-9)).astype(np.float64)
    ratio = shorth(ratios)
    tried = _BLURS * pitch_px[0]
    expected = _peak(families[0], pitch_px[0], tried) / _peak(families[1], pitch_px[1], tried)
    if ratio > _SHARP_RATIO:
        return _CommonBlur(), ()
    variance_px2 = float(np.interp(-ratio, -expected, tried)) ** 2
    sharper = np.interp(-ratios[ratios > ratio], -expected, tried) ** 2
    sharpest = np.percentile(sharper, _UP_TO_ONE_DEVIATION) if sharper.size else variance_px2
    if sharpest > (1 - _UNEVEN) * variance_px2:
        return _CommonBlur(variance_px2, _EVEN_ERROR * variance_px2), ()
    return _CommonBlur(variance_px2, _UNEVEN_ERROR * variance_px2), (_UNEVENLY_SHARP,)
