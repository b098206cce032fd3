"""Direct light, subsurface scattering and inter-reflection by the range over which light travelled.

The default decomposition. One pass over the frames leaves two complex images a pitch
(`processing.frames.gathering`). From them, and from no frame again:

1. the blur and the noise are measured (`processing.ranges.optics`);
2. the place on the projector that each pixel sees is decoded (`processing.ranges.correspondence`);
3. the light of each pixel and colour is fitted, non-negatively and adding up to white, by ranges
   of travel, once as an opaque and once as a translucent surface would have it
   (`processing.ranges.pixels`, `processing.ranges.accounts`);
4. the evidence between the two decides where there is subsurface scattering at all
   (`processing.ranges.regions`).

Direct light is the light of range 0. Unlike α of Subpa-asa et al., which all pixels share, every
pixel has its own spectrum of ranges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.gathering import HarmonicsStack, pixels_of
from processing.frames.noise_lines import noise_lines
from processing.numerics.linear_algebra import product
from processing.numerics.threads import in_threads
from processing.ranges.accounts import opaque, spread_grid, translucent
from processing.ranges.bands import Band, Located, SceneOptics
from processing.ranges.blur import Blur
from processing.ranges.correspondence import decode
from processing.ranges.depth_edges import Seen, Setting, fit_two_places
from processing.ranges.footprints import footprints
from processing.ranges.jumps import near_jumps, places_beside, seen_beside, up_to_jumps
from processing.ranges.near_light import NearLight
from processing.ranges.optics import (
    NOISE_UNKNOWN,
    Sample,
    measured_blur,
    projector_px_per_px,
    tables_for,
)
from processing.ranges.pixels import PlaceFit
from processing.ranges.place_lattice import PlaceLattice
from processing.ranges.regions import Signs, translucent_map
from processing.ranges.result import (
    Capture,
    Fits,
    RangeDecomposition,
    assemble,
    blocks_with,
    lattice,
)
from processing.ranges.scattering import RivalFits
from processing.ranges.slopes import slope_noise_gain, told_of_blur
from processing.remarks import Remark

Image = NDArray[np.float32]
Array = NDArray[np.float64]
_LEAST_COHERENCE = 0.8
# Creases look translucent within some finest pitches' width, measured on the projector.
_CREASE_PITCHES = 3.0
# Blocks that follow one another, each decoding what the last one has not.
_BAND = 4
# Part of the time that fitting takes; the rest goes to depth edges.
_FIT_SHARE = 0.9

Progress = Callable[[float], object]


def _unheard(_done: float) -> None:
    """Progress that nobody asked for."""


def decompose_ranges(
    stack: HarmonicsStack,
    mask: NDArray[np.bool_],
    *,
    blur: Sequence[Blur] | None = None,
    noise: Array | None = None,
    progress: Progress = _unheard,
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
    noise
        (colours, 2): variance of a frame at white 0 and its rise with white, where the camera's
        noise is known; measured on complementary frames where it is not given.
    progress
        Told the part of the work that is done, rising to 1.
    """
    fitted = fit_ranges(stack, mask, blur=blur, noise=noise, progress=progress)
    return assemble(fitted.capture, fitted.fits, fitted.found, fitted.sample, fitted.warnings)


@dataclass(frozen=True, slots=True)
class FittedRanges:
    """Everything that `assemble` makes components of; its parameters."""

    capture: Capture
    fits: RivalFits
    found: NDArray[np.bool_]
    sample: Fits
    warnings: tuple[Remark, ...]


def fit_ranges(
    stack: HarmonicsStack,
    mask: NDArray[np.bool_],
    *,
    blur: Sequence[Blur] | None = None,
    noise: Array | None = None,
    progress: Progress = _unheard,
) -> FittedRanges:
    """Fit both accounts at every pixel and choose between them; parameters as there."""
    white = stack.white()
    _check(mask, white, blur)
    spaced = lattice(mask.shape)
    sampled = mask[spaced]
    sample = Sample(
        pixels_of(stack.harmonics(white, spaced[0]), sampled),
        white[spaced][sampled],
        sampled,
        spaced[0].step,
    )
    if noise is None:
        noise = noise_lines(stack.noise_variance(), white, mask)
    warnings: tuple[Remark, ...] = (NOISE_UNKNOWN,) if np.isnan(noise).any() else ()
    if blur is None:
        blur, unsure = measured_blur(stack, sample)
        warnings += unsure
    pitch_px = np.array([float(one.pitch_px) for one in stack.designs])
    alike = PlaceLattice.of(stack.designs, stack.projector_px)
    accounts = opaque(pitch_px), translucent(pitch_px)
    tables = tables_for(stack, blur, spread_grid(pitch_px))
    gains = np.array([slope_noise_gain(design) for design in stack.designs])
    place_fits = tuple(PlaceFit.of(one, accounts, gains) for one in tables)
    optics = SceneOptics(tuple(blur), tables, noise, gains, stack.white_gain, place_fits, alike)
    told = told_of_blur(pitch_px, float(np.mean([one.error_px2 for one in blur])))
    near = Signs(mask.shape, told, float(pitch_px.min()))
    fits, coherence, seen = _fit_blocks(stack, white, mask, optics, near, progress)
    places: Image = seen.mean(axis=-1)
    settled, suspects = _settle_edges(stack, white, seen, places, mask, optics, fits, progress)
    scale_px = projector_px_per_px(places, mask, alike)
    least_px = _CREASE_PITCHES * pitch_px.min() / scale_px
    found = translucent_map(fits.gain, mask, least_px, ~suspects, near)
    found = up_to_jumps(found, suspects, places, scale_px, alike)
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
        noise=np.sqrt(product(noise, half_lit)),
    )
    spectra = _fitted(_sampled(stack, sample, optics), optics)
    return FittedRanges(
        capture, fits, found, spectra, warnings + _cautions(coherence[mask & ~settled])
    )


def _sampled(stack: HarmonicsStack, sample: Sample, optics: SceneOptics) -> Located:
    """The pixels of the sample."""
    places = decode(sample.harmonics, stack.designs, optics.tables, stack.projector_px)
    shapes = sample.footprints(places.place_px.mean(axis=-1), optics.alike)
    light = sample.white.astype(np.float64)
    return Located(
        sample.harmonics, light, places, optics.gains(shapes), optics.blur_deviations(shapes)
    )


def _check(mask: NDArray[np.bool_], white: Image, blur: Sequence[Blur] | None) -> None:
    if mask.shape != white.shape[:2]:
        raise ValueError(f"mask has shape {mask.shape}, the frames {white.shape}")
    if not mask.any():
        raise ValueError(f"the mask of shape {mask.shape} leaves no usable pixel")
    if blur is not None and len(blur) != white.shape[2]:
        raise ValueError(f"a blur is needed for each colour: {len(blur)} for frames {white.shape}")


def _fit_blocks(
    stack: HarmonicsStack,
    white: Image,
    mask: NDArray[np.bool_],
    optics: SceneOptics,
    near: Signs,
    progress: Progress,
) -> tuple[RivalFits, Image, Image]:
    """Fits of all usable pixels, the coherence and the (y, x) of their places in each colour."""
    fits, coherence = RivalFits(white.shape), np.zeros(mask.shape, np.float32)
    places_px = np.full((2, *white.shape), np.nan, np.float32)

    def fit(band: list[slice]) -> None:
        seen = Band(stack, white, mask, slice(band[0].start, band[-1].stop), optics)
        for lines in band:
            chosen, located = mask[lines], seen.located(lines)
            fits.add(lines, chosen, located.light, _fitted(located, optics))
            coherence[lines][chosen] = located.places.coherence
            places_px[:, lines][:, chosen] = located.places.place_px
            near.add(lines, chosen, _near_light(located, optics))

    every = blocks_with(mask)
    bands = [every[k : k + _BAND] for k in range(0, len(every), _BAND)]
    # Each pixel is written by one of them: the number of threads changes nothing.
    in_threads(fit, bands, lambda part: progress(_FIT_SHARE * part))
    return fits, coherence, places_px


def _near_light(located: Located, optics: SceneOptics) -> NearLight:
    places = located.places.place_px
    return NearLight.of(located.harmonics, places, optics.tables, located.gains, located.light)


def _settle_edges(
    stack: HarmonicsStack,
    white: Image,
    seen_px: Image,
    places_px: Image,
    mask: NDArray[np.bool_],
    optics: SceneOptics,
    fits: RivalFits,
    progress: Progress,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Give pixels that see two places the direct light of both; where that was done, and tried.

    `seen_px` has the place of each colour, `places_px` of all together.
    """
    alike = optics.alike
    scale_px = projector_px_per_px(places_px, mask, alike)
    suspects = near_jumps(places_px, mask, scale_px, alike)
    setting = Setting(stack.designs, stack.projector_px, optics.tables, optics.noise_gains)
    settled = np.zeros(suspects.shape, bool)

    def settle(lines: slice) -> None:
        chosen = suspects[lines]
        harmonics = pixels_of(stack.harmonics(white, lines), chosen)
        light = white[lines][chosen].astype(np.float64)
        places = seen_px[:, lines][:, chosen].astype(np.float64)
        shapes = footprints(places_px[:, lines], mask[lines], alike=alike)[:, chosen]
        pixels = np.stack(np.nonzero(chosen))
        pixels[0] += lines.start
        variance = optics.variance(light)
        beside = places_beside(places_px, pixels)
        two = fit_two_places(
            setting, Seen(harmonics, places, optics.gains(shapes), light, variance, beside)
        )
        pixels = pixels[:, two.pixels]
        believed = two.hopeless | seen_beside(places_px, pixels, two.second_px, scale_px, alike)
        two, pixels = two.only(believed), pixels[:, believed]
        fits.correct(
            pixels,
            light[two.pixels].astype(np.float32),
            two.direct_light.astype(np.float32),
            two.deviations.astype(np.float32),
        )
        settled[pixels[0], pixels[1]] = True

    rest = 1 - _FIT_SHARE
    in_threads(settle, blocks_with(suspects), lambda part: progress(_FIT_SHARE + rest * part))
    return settled, suspects


def _fitted(located: Located, optics: SceneOptics) -> Fits:
    """Both accounts of each colour."""
    fits = []
    variance = np.stack(
        [optics.variance(located.light), optics.white_variance(located.light)], axis=-1
    )
    for colour, fit in enumerate(optics.fits):
        fits.append(
            fit.fitted(
                located.harmonics[..., colour],
                located.places.place_px[..., colour],
                located.gains[..., colour],
                located.light[:, colour],
                variance[:, colour],
                located.blur_deviations[colour],
            )
        )
    return fits


_NO_GRID = Remark(
    what="The shifts are no full grid, so the harmonics of the pattern leak into one another by "
    "some per cent.",
    meaning="Subsurface scattering is not told from inter-reflection and counts as it.",
    remedy="Capture every pair of shifts, down and right, if the two should be told apart.",
)


def _cautions(coherence: Image) -> tuple[Remark, ...]:
    lost = float(np.mean(coherence < _LEAST_COHERENCE))
    if lost < 0.01:
        return ()
    return (
        Remark(
            what=f"{lost:.0%} of the pixels see no single place on the projector: depth edges, "
            "little light, or motion.",
            meaning="Their direct light reads too low, and what is missing there counts as light "
            "that travelled.",
            remedy="Look at the map of uncertainty before using single pixels; more light, a "
            "finer camera and a scene that stands still make them fewer.",
        ),
    )
