"""Ranges of light from stripes in two positions one pitch apart, as a binary code is shown.

Two positions tell no phase, but their signed differences are linear in the light all the same
(`processing.ranges.two_positions.fit`), and all pitches together tell where every pixel looks
(`processing.ranges.two_positions.binary_code`). From the differences, and from no frame again:

1. the blur is measured on some parts of the picture;
2. bands of lines are decoded and fitted, as opaque and as translucent surfaces;
3. pixels that two places explain get the direct light of both
   (`processing.ranges.two_positions.edges`);
4. the evidence between the accounts decides where there is subsurface scattering, as it does for
   all shifts (`processing.ranges.decomposition`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.frames.gathering import HarmonicsStack
from processing.frames.noise_lines import noise_lines
from processing.numerics.linear_algebra import product
from processing.numerics.threads import in_threads
from processing.ranges.account_fit import AccountFit
from processing.ranges.accounts import opaque, spread_grid, translucent
from processing.ranges.blur import Blur
from processing.ranges.footprints import footprints
from processing.ranges.optics import NOISE_UNKNOWN, projector_px_per_px
from processing.ranges.regions import translucent_map
from processing.ranges.response import ResponseTables
from processing.ranges.result import (
    Capture,
    Fits,
    RangeDecomposition,
    assemble,
    blocks_with,
    lattice,
)
from processing.ranges.scattering import RivalFits
from processing.ranges.two_positions.binary_code import HALO as CODE_HALO
from processing.ranges.two_positions.binary_code import BinaryCode, relative_to
from processing.ranges.two_positions.code_waves import CodeWaves
from processing.ranges.two_positions.edges import (
    RANGES,
    SUSPECT,
    EdgePixels,
    candidate_pairs,
    fit_edges,
)
from processing.ranges.two_positions.fit import HALO as FIT_HALO
from processing.ranges.two_positions.fit import PairFit, PairsFitted
from processing.ranges.two_positions.optics import decoded_places, measured_code
from processing.remarks import Remark

Image = NDArray[np.float32]
Array = NDArray[np.float64]
Progress = Callable[[float], object]
_BothFits = tuple[AccountFit, AccountFit]

# Shorter ranges than a quarter of this cannot be told from errors of places, in projector pixels
# and in standard deviations of the blur.
_SHORTEST_PX, _SHORTEST_BLURS = 8.0, 4.0
# Creases look translucent within some pitches' width, measured on the projector.
_CREASE_PITCHES = 3.0
# Pixels of a band; more of them leave less to be decoded twice.
_BAND_PIXELS = 1 << 19
# The model's errors are this many times those that all shifts leave, on path-traced scenes.
_ERRORS_OF_A_CODE = np.float32(2.0)
_FIT_SHARE = 0.9
# Standard error of direct light of two places, in parts of white.
_TWO_PLACES_ERROR = 0.1
_HALO = CODE_HALO + FIT_HALO


@dataclass(frozen=True, slots=True)
class _Optics:
    """What holds for the whole picture; tuples have one for each colour."""

    codes: tuple[BinaryCode | None, BinaryCode | None]
    chosen: NDArray[np.int64]
    blur: tuple[Blur, ...]
    waves: tuple[CodeWaves, ...]
    fits: tuple[PairFit, ...]
    edge_waves: tuple[CodeWaves, ...]
    noise: Array
    white_gain: float

    def variance(self, light: Image) -> Image:
        """Of the noise of a difference over white, (..., colours)."""
        constant, rise = np.nan_to_num(self.noise).T
        lit = np.maximum(light, 1e-9)
        found: Image = (2 * (constant + rise * lit) / lit**2).astype(np.float32)
        return found

    def white_variance(self, light: Image) -> Image:
        """Of white over itself, its own frames' and that of a black one."""
        constant, rise = np.nan_to_num(self.noise).T
        lit = np.maximum(light, 1e-9)
        frame = constant + rise * lit
        found: Image = ((self.white_gain * frame + 4 * constant) / lit**2).astype(np.float32)
        return found

    def gains(self, shapes: Array) -> Image:
        """(pitches, ..., colours) for (3, ...) footprints."""
        flat = shapes.reshape(3, -1)
        each = []
        for blur, waves in zip(self.blur, self.waves, strict=True):
            varies = np.stack([waves.axis == 0, waves.axis == 1], axis=1).astype(np.float64)
            gains = blur.gains(waves.pitch_px, varies, flat)[..., 0].T
            each.append(gains.reshape(len(waves.pitch_px), *shapes.shape[1:]).astype(np.float32))
        return np.stack(each, axis=-1)


def decompose_pairs(
    stack: HarmonicsStack,
    mask: NDArray[np.bool_],
    *,
    blur: Sequence[Blur] | None = None,
    noise: Array | None = None,
    progress: Progress = lambda _: None,
) -> RangeDecomposition:
    """Take the light of a scene apart by its range.

    Parameters
    ----------
    stack
        All frames, gathered; every pitch is a pair.
    mask, blur, noise, progress
        As for `processing.ranges.decomposition.decompose_ranges`.
    """
    white = stack.white()
    if mask.shape != white.shape[:2] or not mask.any():
        raise ValueError(f"a mask of shape {mask.shape} leaves no pixel of frames {white.shape}")
    if noise is None:
        noise = noise_lines(stack.noise_variance(), white, mask)
    warnings: tuple[Remark, ...] = (NOISE_UNKNOWN,) if np.isnan(noise).any() else ()
    measured = measured_code(stack, white, mask, noise, blur)
    warnings += measured.warnings
    pitch_px = np.array([float(stack.designs[k].pitch_px) for k in measured.chosen])
    side_px = float(np.sqrt(np.mean([one.side_px2 for one in measured.blur])))
    told_px = _told_apart(pitch_px, side_px)
    accounts = opaque(told_px), translucent(told_px)
    grid = spread_grid(told_px)
    designs = [stack.designs[k] for k in measured.chosen]
    waves = tuple(
        CodeWaves.of(designs, grid, one.side_px2, one.box_px, half_on=measured.half_on)
        for one in measured.blur
    )
    few = [0, *(int(np.argmin(np.abs(grid - one * told_px.min()))) for one in RANGES)]
    optics = _Optics(
        measured.codes,
        measured.chosen,
        measured.blur,
        waves,
        tuple(PairFit.of(one, accounts) for one in waves),
        tuple(replace(one, wave=np.ascontiguousarray(one.wave[:, few])) for one in waves),
        noise,
        stack.white_gain,
    )
    work = _Work(stack, white, mask, optics)
    work.fit(lambda part: progress(_FIT_SHARE * part))
    scale_px = projector_px_per_px(work.places_px.mean(axis=-1), mask)
    work.settle(scale_px, lambda part: progress(_FIT_SHARE + (1 - _FIT_SHARE) * part))
    least_px = _CREASE_PITCHES * told_px.min() / scale_px
    found = translucent_map(work.fits.gain, mask, least_px, ~work.settled)
    half_lit = np.array([1.0, 0.5 * float(np.percentile(white[mask], 99.5))])
    tables = (
        ResponseTables.of(stack.designs, grid, one.side_px2, one.box_px) for one in measured.blur
    )
    capture = Capture(
        white=white,
        mask=mask,
        pitch_px=np.array([float(one.pitch_px) for one in stack.designs]),
        accounts=accounts,
        responses=tuple(table.mean_response() for table in tables),
        blur=measured.blur,
        noise=np.sqrt(product(noise, half_lit)),
    )
    warnings += _cautions(work.hopeless[mask])
    result = assemble(capture, work.fits, found, work.sample(), warnings)
    # No light is off by more than all there is.
    lit = np.maximum(white, 0)
    return replace(
        result,
        noise_errors=np.fmin(result.noise_errors, lit),
        model_errors=np.fmin(_ERRORS_OF_A_CODE * result.model_errors, lit),
    )


def _told_apart(pitch_px: Array, blur_px: float) -> Array:
    """The pitches that ranges are counted in."""
    least = max(_SHORTEST_PX, _SHORTEST_BLURS * blur_px)
    told = pitch_px[pitch_px >= least]
    return told if told.size else pitch_px[pitch_px == pitch_px.max()]


class _Work:
    """Fits of all pixels, as far as they are done."""

    def __init__(
        self, stack: HarmonicsStack, white: Image, mask: NDArray[np.bool_], optics: _Optics
    ) -> None:
        self._stack, self._white, self._mask, self._optics = stack, white, mask, optics
        self.fits = RivalFits(white.shape)
        self.places_px = np.full((2, *white.shape), np.nan, np.float32)
        self._misfit = np.zeros(mask.shape, np.float32)
        self.settled, self.hopeless = np.zeros(mask.shape, bool), np.zeros(mask.shape, bool)
        self._sampled: list[list[_BothFits]] = []

    def fit(self, progress: Progress) -> None:
        """Decode and fit, band by band; no pixel is written by two of them."""
        height, width = self._mask.shape
        lines = max(_BAND_PIXELS // width, 1)
        bands = [slice(y, min(y + lines, height)) for y in range(0, height, lines)]
        bands = [band for band in bands if self._mask[band].any()]
        self._sampled = in_threads(self._fit_band, bands, progress)

    def sample(self) -> Fits:
        """Fits of the pixels of `lattice`."""
        colours = range(self._white.shape[2])
        return [_joined([band[colour] for band in self._sampled]) for colour in colours]

    def _fit_band(self, band: slice) -> list[_BothFits]:
        around = slice(max(band.start - _HALO, 0), min(band.stop + _HALO, len(self._mask)))
        mask, white = self._mask[around], self._white[around]
        differences = self._stack.differences(around)[self._optics.chosen]
        places = self._decoded(differences, white, mask)
        inner = slice(band.start - around.start, band.stop - around.start)
        self.places_px[:, band][:, mask[inner]] = places[:, inner][:, mask[inner]]
        gains = self._optics.gains(footprints(places.mean(axis=-1), mask))
        sampled: list[list[_BothFits]] = [[] for _ in self._optics.fits]
        for lines in blocks_with(mask):
            part = slice(max(lines.start, inner.start), min(lines.stop, inner.stop))
            if part.start < part.stop and mask[part].any():
                pairs = self._fit_lines(differences, white, mask, places, gains, part)
                at = slice(around.start + part.start, around.start + part.stop)
                self._take(at, pairs, white[part], sampled)
        return [_joined(fits) for fits in sampled]

    def _take(
        self,
        lines: slice,
        pairs: list[PairsFitted],
        white: Image,
        sampled: list[list[_BothFits]],
    ) -> None:
        chosen = self._mask[lines]
        # Noise may leave less than none.
        light = np.maximum(white[chosen], 0).astype(np.float64)
        fits = []
        for colour, pair in enumerate(pairs):
            one, other = (_scaled(fit, light[:, colour]) for fit in pair.accounts)
            fits.append((one, other))
        self.fits.add(lines, chosen, light, fits)
        self._misfit[lines][chosen] = np.sum([pair.own_chi2 for pair in pairs], axis=0)
        wanted = np.zeros(self._mask.shape, bool)
        wanted[lattice(self._mask.shape)] = True
        kept = wanted[lines][chosen]
        for colour, (one, other) in enumerate(fits):
            sampled[colour].append((_only(one, kept), _only(other, kept)))

    def _decoded(self, differences: Image, white: Image, mask: NDArray[np.bool_]) -> Image:
        """Places of each colour, (2, lines, columns, colours)."""
        return decoded_places(self._optics.codes, self._optics.chosen, differences, white, mask,
                              self._optics.noise)  # fmt: skip

    def _fit_lines(
        self,
        differences: Image,
        white: Image,
        mask: NDArray[np.bool_],
        places: Image,
        gains: Image,
        lines: slice,
    ) -> list[PairsFitted]:
        """Both accounts of each colour."""
        around = slice(max(lines.start - FIT_HALO, 0), min(lines.stop + FIT_HALO, len(mask)))
        inner = slice(lines.start - around.start, lines.stop - around.start)
        light = white[around]
        variance = np.stack([self._optics.variance(light), self._optics.white_variance(light)])
        found = []
        for colour, fit in enumerate(self._optics.fits):
            relative = relative_to(light[..., colour], differences[:, around, :, colour])
            found.append(
                fit.fitted(
                    relative,
                    np.ascontiguousarray(places[:, around, :, colour]),
                    np.ascontiguousarray(gains[:, around, :, colour]),
                    mask[around],
                    np.ascontiguousarray(variance[..., colour]),
                    inner,
                )
            )
        return found

    def settle(self, scale_px: float, progress: Progress) -> None:
        """Give pixels that see two places the direct light of both."""
        n_values = len(self._optics.chosen) * self._white.shape[2]
        suspects = self._mask & (self._misfit > SUSPECT * n_values)
        joint = self.places_px.mean(axis=-1)

        def settle(lines: slice) -> None:
            self._settle_lines(lines, suspects[lines], joint, scale_px)

        in_threads(settle, blocks_with(suspects), progress)

    def _settle_lines(
        self, lines: slice, chosen: NDArray[np.bool_], joint: Image, scale_px: float
    ) -> None:
        pixels = np.stack(np.nonzero(chosen))
        pixels[0] += lines.start
        light = np.maximum(self._white[lines][chosen], 0)
        differences = self._stack.differences(lines)[self._optics.chosen][:, chosen]
        shapes = footprints(joint[:, lines], self._mask[lines])[:, chosen]
        relative = relative_to(light, differences)
        seen = EdgePixels(
            relative,
            self._optics.gains(shapes),
            self._optics.variance(light),
            candidate_pairs(joint, pixels, scale_px),
        )
        two = fit_edges(self._optics.edge_waves[light.shape[1] // 2], seen)
        kept = two.believed
        self.fits.correct(
            pixels[:, kept],
            light[kept],
            (two.direct[kept] * light[kept]).astype(np.float32),
            (_TWO_PLACES_ERROR * light[kept]).astype(np.float32),
        )
        self.settled[lines][chosen] = kept
        self.hopeless[lines][chosen] = two.hopeless


def _scaled(fit: AccountFit, light: Array) -> AccountFit:
    """From parts of white to the unit of the frames."""
    each = light[:, np.newaxis]
    return AccountFit(
        fit.amounts * each,
        fit.direct_light * light,
        fit.subsurface * light,
        fit.noise_errors * each,
        fit.misfits * each,
        fit.chi2,
    )


def _only(fit: AccountFit, kept: NDArray[np.bool_]) -> AccountFit:
    """Some of the pixels."""
    return AccountFit(
        fit.amounts[kept],
        fit.direct_light[kept],
        fit.subsurface[kept],
        fit.noise_errors[kept],
        fit.misfits[kept],
        fit.chi2[kept],
    )


def _joined(fits: Sequence[_BothFits]) -> _BothFits:
    """Both accounts of some pixels and others after them."""
    one, other = (
        AccountFit(
            np.concatenate([fit.amounts for fit in each]),
            np.concatenate([fit.direct_light for fit in each]),
            np.concatenate([fit.subsurface for fit in each]),
            np.concatenate([fit.noise_errors for fit in each]),
            np.concatenate([fit.misfits for fit in each]),
            np.concatenate([fit.chi2 for fit in each]),
        )
        for each in zip(*fits, strict=True)
    )
    return one, other


def _cautions(hopeless: NDArray[np.bool_]) -> tuple[Remark, ...]:
    lost = float(np.mean(hopeless))
    if lost < 0.01:
        return ()
    return (
        Remark(
            what=f"{lost:.0%} of the pixels see no place on the projector, nor two, that explain "
            "them: depth edges, gloss, little light, or motion.",
            meaning="Their division into components is a guess.",
            remedy="Look at the map of uncertainty before using single pixels.",
        ),
    )
