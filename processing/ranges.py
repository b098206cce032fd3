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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.accounts import Account, opaque, spread_grid, translucent
from processing.blur import Blur
from processing.correspondence import Correspondence, decode
from processing.depth_edges import Setting, fit_two_places, near_jumps, seen_beside
from processing.gathering import HarmonicsStack
from processing.optics import (
    NOISE_UNKNOWN,
    Sample,
    measured_blur,
    noise_lines,
    projector_px_per_px,
    tables_for,
)
from processing.range_decomposition import (
    Capture,
    Fits,
    RangeDecomposition,
    assemble,
    blocks,
    lattice,
)
from processing.range_fit import fit_places, slope_noise_gain
from processing.response import ResponseTables
from processing.scattering import RivalFits, translucent_map

Image = NDArray[np.float32]
Array = NDArray[np.float64]
_LEAST_COHERENCE = 0.8
# Creases look translucent within some finest pitches' width, measured on the projector.
_CREASE_PITCHES = 3.0


@dataclass(frozen=True, slots=True)
class _Optics:
    """What holds for the whole picture, for each colour."""

    blur: tuple[Blur, ...]
    tables: tuple[ResponseTables, ...]
    noise: Array
    noise_gains: Array
    accounts: tuple[Account, Account]

    def variance(self, light: Array) -> Array:
        """Of a frame's noise at (n, colours) of white light; 0 where it is unknown."""
        constant, rise = np.nan_to_num(self.noise).T
        variance: Array = constant + rise * np.maximum(light, 0)
        return variance


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
    spaced = lattice(mask.shape)
    sampled = mask[spaced]
    sample = Sample(
        stack.harmonics(white, spaced[0])[:, :, sampled],
        white[spaced][sampled],
        sampled,
        spaced[0].step,
    )
    noise = noise_lines(stack.noise_variance(), white, mask)
    warnings: tuple[str, ...] = (NOISE_UNKNOWN,) if np.isnan(noise).any() else ()
    if blur is None:
        blur, unsure = measured_blur(stack, sample)
        warnings += unsure
    pitch_px = np.array([float(one.pitch_px) for one in stack.designs])
    accounts = opaque(pitch_px), translucent(pitch_px)
    tables = tables_for(stack, blur, spread_grid(pitch_px))
    gains = np.array([slope_noise_gain(design) for design in stack.designs])
    optics = _Optics(tuple(blur), tables, noise, gains, accounts)
    fits, coherence, places = _fit_blocks(stack, white, mask, optics)
    scale_px = projector_px_per_px(places, mask)
    settled = _settle_edges(
        stack, white, near_jumps(places, mask, scale_px), places, scale_px, optics, fits
    )
    least_px = _CREASE_PITCHES * pitch_px.min() / scale_px
    found = translucent_map(fits.gain, mask, least_px)
    if not all(design.is_grid for design in stack.designs):
        found[:] = False
        warnings += (_NO_GRID,)
    half_lit = np.array([1.0, 0.5 * float(np.percentile(white[mask], 99.5))])
    capture = Capture(
        white=white,
        mask=mask,
        pitch_px=pitch_px,
        accounts=accounts,
        responses=tuple(table.mean_response() for table in tables),
        blur=tuple(blur),
        noise=np.sqrt(noise @ half_lit),
    )
    _, spectra = _fitted(stack, sample.harmonics, sample.white, optics)
    return assemble(capture, fits, found, spectra, warnings + _cautions(coherence[mask & ~settled]))


def _check(mask: NDArray[np.bool_], white: Image, blur: Sequence[Blur] | None) -> None:
    if mask.shape != white.shape[:2]:
        raise ValueError(f"mask has shape {mask.shape}, the frames {white.shape}")
    if not mask.any():
        raise ValueError(f"the mask of shape {mask.shape} leaves no usable pixel")
    if blur is not None and len(blur) != white.shape[2]:
        raise ValueError(f"a blur is needed for each colour: {len(blur)} for frames {white.shape}")


def _fit_blocks(
    stack: HarmonicsStack, white: Image, mask: NDArray[np.bool_], optics: _Optics
) -> tuple[RivalFits, Image, Image]:
    """Fits of all usable pixels, the coherence and the (y, x) of their places."""
    fits, coherence = RivalFits(white.shape), np.zeros(mask.shape, np.float32)
    places_px = np.full((2, *mask.shape), np.nan, np.float32)
    for lines in blocks(mask.shape):
        chosen = mask[lines]
        if chosen.any():
            harmonics = stack.harmonics(white, lines)[:, :, chosen]
            places, pairs = _fitted(stack, harmonics, white[lines][chosen], optics)
            fits.add(lines, chosen, pairs)
            coherence[lines][chosen] = places.coherence
            places_px[:, lines][:, chosen] = places.place_px.mean(axis=-1)
    return fits, coherence, places_px


def _settle_edges(
    stack: HarmonicsStack,
    white: Image,
    suspects: NDArray[np.bool_],
    places_px: Image,
    scale_px: float,
    optics: _Optics,
    fits: RivalFits,
) -> NDArray[np.bool_]:
    """Give pixels that see two places the direct light of both; True where that was done."""
    setting = Setting(
        stack.designs, stack.projector_px, optics.tables, optics.blur, optics.noise_gains
    )
    settled = np.zeros(suspects.shape, bool)
    for lines in blocks(suspects.shape):
        chosen = suspects[lines]
        if not chosen.any():
            continue
        harmonics = stack.harmonics(white, lines)[:, :, chosen]
        light = white[lines][chosen].astype(np.float64)
        places = decode(harmonics, stack.designs, optics.tables, stack.projector_px).place_px
        two = fit_two_places(setting, harmonics, places, light, optics.variance(light))
        pixels = np.stack(np.nonzero(chosen))
        pixels[0] += lines.start
        found = two.found & seen_beside(places_px, pixels, two.second_px, scale_px)
        pixels = pixels[:, found]
        fits.correct(
            pixels,
            two.direct_light[found].astype(np.float32),
            two.deviations[found].astype(np.float32),
        )
        settled[pixels[0], pixels[1]] = True
    return settled


def _fitted(
    stack: HarmonicsStack, harmonics: NDArray[np.complex64], white: Image, optics: _Optics
) -> tuple[Correspondence, Fits]:
    """Places of n pixels, and both accounts of each colour."""
    places = decode(harmonics, stack.designs, optics.tables, stack.projector_px)
    fits = []
    variance = optics.variance(white.astype(np.float64))
    for colour, (tables, blur) in enumerate(zip(optics.tables, optics.blur, strict=True)):
        light = white[:, colour].astype(np.float64)
        fits.append(
            fit_places(
                harmonics[..., colour], places.place_px[..., colour], tables, blur,
                optics.accounts, light, variance[:, colour].copy(), optics.noise_gains,
            )
        )  # fmt: skip
    return places, fits


_NO_GRID = (
    "the shifts are no full grid, so the harmonics of the pattern leak into one another by some "
    "per cent; subsurface scattering is not told from inter-reflection, capture every pair of "
    "shifts if it should be"
)


def _cautions(coherence: Image) -> tuple[str, ...]:
    lost = float(np.mean(coherence < _LEAST_COHERENCE))
    if lost < 0.01:
        return ()
    return (
        f"{lost:.0%} of the pixels see no single place on the projector (depth edges, little "
        "light, or motion): their direct light reads low",
    )
