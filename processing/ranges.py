"""Direct light, subsurface scattering and inter-reflection by the range over which light travelled.

The default decomposition. One pass over the frames leaves two complex images a pitch
(`processing.gathering`). From them, and from no frame again:

1. the blur and the noise are measured (`processing.optics`);
2. the place on the projector that each pixel sees is decoded (`processing.correspondence`);
3. the light of each pixel and colour is fitted, non-negatively and adding up to white, by ranges
   of travel, once as an opaque and once as a translucent surface would have it
   (`processing.range_fit`, `processing.accounts`);
4. the evidence between the two decides where there is subsurface scattering at all
   (`processing.scattering`).

Direct light is the light of range 0. Unlike α of Subpa-asa et al., which all pixels share, every
pixel has its own spectrum of ranges.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.accounts import Account, opaque, spread_grid, translucent
from processing.blur import Blur
from processing.correspondence import Correspondence, decode
from processing.gathering import HarmonicsStack
from processing.optics import NOISE_UNKNOWN, Sample, measured_blur, noise_lines, tables_for
from processing.range_fit import AccountFit, fit_places, slope_noise_gain
from processing.response import ResponseTables
from processing.scattering import RivalFits, translucent_map

Image = NDArray[np.float32]
Array = NDArray[np.float64]
Fits = list[tuple[AccountFit, AccountFit]]

NAMES = ("direct", "subsurface", "interreflection")
_SAMPLED_PIXELS = 1 << 15
_BLOCK_PIXELS = 1 << 15
_LEAST_COHERENCE = 0.8


@dataclass(frozen=True, slots=True)
class RangeDecomposition:
    """Components of light, their errors, and how they were found.

    Parameters
    ----------
    components
        float32, (n, height, width, colours), linear, in the unit of the frames, ≥ 0. They add
        up to `white`; 0 outside the mask.
    deviations
        float32, the same shape: standard error of each component, from the noise of the frames
        and a model error of 1 % of white, scaled up where the fit is worse. What the ranges
        cannot express and yet fit is not in it.
    names
        ``direct`` and ``interreflection``, with ``subsurface`` between them where there is any.
    pitch_px
        (m,), the last, white, infinite.
    mixing
        float64, (colours, m, n): mean response of each component against pitch, freed from
        blur; the last row, white, is 1.
    white
        float32, (height, width, colours): the scene under full light.
    translucent
        bool, (height, width): where there is evidence of subsurface scattering.
    blur
        Of each colour.
    noise
        (colours,), standard deviation of a frame under half of the brightest white; NaN where
        it is unknown.
    warnings
        What a reader must know, in words.
    """

    components: Image
    deviations: Image
    names: tuple[str, ...]
    pitch_px: Array
    mixing: Array
    white: Image
    translucent: NDArray[np.bool_]
    blur: tuple[Blur, ...]
    noise: Array
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Optics:
    """What holds for the whole picture, for each colour."""

    blur: tuple[Blur, ...]
    tables: tuple[ResponseTables, ...]
    noise: Array
    noise_gains: Array
    accounts: tuple[Account, Account]


def decompose_ranges(
    stack: HarmonicsStack, mask: NDArray[np.bool_], *, blur: Sequence[Blur] | None = None
) -> RangeDecomposition:
    """Take the light of a scene apart by its range.

    Parameters
    ----------
    stack
        All frames, gathered. Its harmonics are read three times, in blocks of lines.
    mask
        bool, (height, width), True where a pixel is usable.
    blur
        Of each colour, where it is known (from a board); measured where it is not given.
    """
    white = stack.white()
    _check(mask, white, blur)
    stride = int(np.ceil(np.sqrt(mask.size / _SAMPLED_PIXELS)))
    lattice = slice(None, None, stride)
    sampled = mask[lattice, lattice]
    sample = Sample(
        stack.harmonics(white, lattice)[:, :, sampled], white[lattice, lattice][sampled]
    )
    noise = noise_lines(stack.noise_variance(), white, mask)
    warnings: tuple[str, ...] = (NOISE_UNKNOWN,) if np.isnan(noise).any() else ()
    if blur is None:
        blur, unsure = measured_blur(stack, sample)
        warnings += unsure
    gains = np.array([slope_noise_gain(design) for design in stack.designs])
    pitch_px = np.array([float(one.pitch_px) for one in stack.designs])
    tables = tables_for(stack, blur, spread_grid(pitch_px))
    accounts = opaque(pitch_px), translucent(pitch_px)
    optics = _Optics(tuple(blur), tables, noise, gains, accounts)
    fits, coherence = _fit_blocks(stack, white, mask, optics)
    found = translucent_map(fits.gain, mask)
    lit = np.where(mask[..., np.newaxis], np.maximum(white, 0), 0)
    components, deviations = fits.components(found, lit)
    kept = [0, 1, 2] if found.any() else [0, 2]
    _, spectra = _fitted(stack, sample.harmonics, sample.white, optics)
    mixing = mean_mixing(spectra, found[lattice, lattice][sampled], optics.accounts,
                         [table.mean_response() for table in tables])  # fmt: skip
    half = 0.5 * float(np.percentile(white[mask], 99.5))
    return RangeDecomposition(
        components=components[kept],
        deviations=deviations[kept],
        names=tuple(NAMES[k] for k in kept),
        pitch_px=np.append(pitch_px, np.inf),
        mixing=mixing[..., kept],
        white=white,
        translucent=found,
        blur=tuple(blur),
        noise=np.sqrt(noise @ [1.0, half]),
        warnings=warnings + _cautions(coherence[mask]),
    )


def _check(mask: NDArray[np.bool_], white: Image, blur: Sequence[Blur] | None) -> None:
    if mask.shape != white.shape[:2]:
        raise ValueError(f"mask has shape {mask.shape}, the frames {white.shape}")
    if not mask.any():
        raise ValueError(f"the mask of shape {mask.shape} leaves no usable pixel")
    if blur is not None and len(blur) != white.shape[2]:
        raise ValueError(f"a blur is needed for each colour: {len(blur)} for frames {white.shape}")


def _fit_blocks(
    stack: HarmonicsStack, white: Image, mask: NDArray[np.bool_], optics: _Optics
) -> tuple[RivalFits, Image]:
    """Fits of all usable pixels, and the coherence of their places."""
    fits, coherence = RivalFits(white.shape), np.zeros(mask.shape, np.float32)
    for lines in blocks(mask.shape):
        chosen = mask[lines]
        if chosen.any():
            harmonics = stack.harmonics(white, lines)[:, :, chosen]
            places, pairs = _fitted(stack, harmonics, white[lines][chosen], optics)
            fits.add(lines, chosen, pairs)
            coherence[lines][chosen] = places.coherence
    return fits, coherence


def blocks(shape: tuple[int, int]) -> Iterator[slice]:
    """Lines of a picture, some 32 000 pixels at a time."""
    lines = max(_BLOCK_PIXELS // shape[1], 1)
    return (slice(first, first + lines) for first in range(0, shape[0], lines))


def _fitted(
    stack: HarmonicsStack, harmonics: NDArray[np.complex64], white: Image, optics: _Optics
) -> tuple[Correspondence, Fits]:
    """Places of n pixels, and both accounts of each colour."""
    places = decode(harmonics, stack.designs, optics.tables, stack.projector_px)
    fits = []
    for colour, (tables, blur) in enumerate(zip(optics.tables, optics.blur, strict=True)):
        light = white[:, colour].astype(np.float64)
        constant, rise = np.nan_to_num(optics.noise[colour])
        variance = constant + rise * np.maximum(light, 0)
        fits.append(
            fit_places(
                harmonics[..., colour], places.place_px[..., colour], tables, blur,
                optics.accounts, light, variance, optics.noise_gains,
            )
        )  # fmt: skip
    return places, fits


def mean_mixing(
    fits: Fits,
    found: NDArray[np.bool_],
    accounts: tuple[Account, Account],
    responses: Sequence[Array],
) -> Array:
    """Mean response of direct, near and far light, (colours, m, 3), the last row 1.

    Parameters
    ----------
    fits
        Both accounts of n sample pixels, for each colour.
    found
        bool, (n,): where the translucent one holds.
    accounts
        Opaque and translucent.
    responses
        (pitches, spreads) for each colour.
    """
    mixing = np.ones((len(fits), len(responses[0]) + 1, 3))
    for colour, (pair, response) in enumerate(zip(fits, responses, strict=True)):
        spectra = np.zeros((2, response.shape[1]))
        totals = np.zeros(2)
        for account, fit, chosen in zip(accounts, pair, (~found, found), strict=True):
            total = fit.amounts[chosen].sum(axis=0)
            first, end = account.subsurface
            spectra[0] += account.mixtures[:, first:end] @ total[first:end]
            spectra[1] += account.mixtures[:, end:] @ total[end:-1]
            totals += total[first:end].sum(), total[end:].sum()
        for k in np.flatnonzero(totals > 0):
            mixing[colour, :-1, 1 + k] = response @ spectra[k] / totals[k]
    return mixing


def _cautions(coherence: Image) -> tuple[str, ...]:
    lost = float(np.mean(coherence < _LEAST_COHERENCE))
    if lost < 0.01:
        return ()
    return (
        f"{lost:.0%} of the pixels see no single place on the projector (depth edges, little "
        "light, or motion): their direct light reads low",
    )
