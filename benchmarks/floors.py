"""What keeps `ranges` from its targets: noise, its model, or what it has to estimate first.

The tracer of the rendered scenes knows what no camera does: what each kind of light alone adds to
the harmonics, and how far it travelled. The same frames are decomposed again with more and more of
it given:

- blur: the variances of pixel, lens and projector, instead of their estimate;
- places: what unit direct light of each pixel and colour adds to each pitch, which holds place,
  footprint (several surfaces, too), texture and blur; where nothing lights a pixel, that;
- regions: beside that, where there is subsurface scattering.

What error is left then is the model's and the noise's. The model's alone is what a non-negative
spectrum that adds up makes of noise-free rows computed from the true ranges, each as if light came
from all sides (a ring of radius r has the response J₀(√2 π r/P) along the diagonals). The noise's
is the bound of Cramér and Rao for an unbiased estimator that sees the harmonics and knows for
every pixel the curve of each kind of light, so that three amounts are all it has to find.

Run from the root of the repository: ``python -m benchmarks.floors --cache DIR``.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import j0

from benchmarks.decomposition import Captured
from benchmarks.light_paths import RANGE_EDGES_PX
from benchmarks.rendered_captures import (
    CONDITIONS,
    captures,
    projector_px_per_camera_px,
    rendered_parts,
)
from benchmarks.rendered_scenes import BASELINES, HELD_OUT, TUNED_ON, UNTOUCHED, scenery
from benchmarks.rendering import RenderedParts
from processing.frames.noise_lines import noise_lines
from processing.metrics import errors_of, oracle, relative_error
from processing.ranges.accounts import opaque, spread_grid, translucent
from processing.ranges.blur import Blur
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.footprints import footprints
from processing.ranges.optics import BOX_MARGIN, tables_for
from processing.ranges.pixels import PlaceFit
from processing.ranges.response import ResponseTables
from processing.ranges.scattering import RivalFits
from processing.ranges.shares import unsharpness
from processing.ranges.slopes import slope_noise_gain

Array = NDArray[np.float64]
Image = NDArray[np.float32]

# A pixel scatters below the surface where that is this part of its light.
_SCATTERS = 0.01


@dataclass(frozen=True, slots=True)
class Errors:
    """Relative errors; subsurface light that is not there as a part of white."""

    direct: float
    rest: float
    interreflection: float
    subsurface: float

    @classmethod
    def of(cls, components: Image, run: Captured) -> Errors:
        """Of direct, subsurface and inter-reflected light, (3, height, width, colours)."""
        direct, scattered, far = components
        truth = run.truth
        rest = truth["subsurface"] + truth["interreflection"]
        below = float(scattered[run.mask].sum() / run.white[run.mask].sum())
        if truth["subsurface"][run.mask].any():
            below = relative_error(scattered, truth["subsurface"], run.mask)
        return cls(
            relative_error(direct, truth["direct"], run.mask),
            relative_error(scattered + far, rest, run.mask),
            relative_error(far, truth["interreflection"], run.mask),
            below,
        )

    def cells(self) -> list[str]:
        """For a table."""
        return [f"{self.direct:.4f}", f"{self.rest:.3f}", f"{self.interreflection:.3f}",
                f"{self.subsurface:.3f}"]  # fmt: skip


def true_blur(parts: RenderedParts, mask: NDArray[np.bool_], condition: str, name: str) -> Blur:
    """Of pixel, lens and projector, which are the same for all colours."""
    _, projected_px, lens_px = CONDITIONS[condition]
    projected_px *= projector_px_per_camera_px(scenery(name))
    sizes = footprints(parts.seen_px, mask & np.isfinite(parts.seen_px).all(axis=0))[:2, mask]
    footprint_px2 = float(np.median(sizes))
    camera_px2 = 1 / 12 + lens_px**2
    side_px2 = camera_px2 * footprint_px2 + projected_px**2
    box_px = BOX_MARGIN * float(np.sqrt(footprint_px2))
    return Blur(side_px2, 0.0, box_px, camera_px2, footprint_px2)


def with_places(
    run: Captured, parts: RenderedParts, blur: Blur, harmonics: NDArray[np.complexfloating]
) -> RivalFits:
    """Both accounts where the response of direct light is known.

    Parameters
    ----------
    run, parts
        A capture, and its light apart.
    blur
        What the ranges are seen through.
    harmonics
        (pitches, 2, n, colours): measured, or by the truth.
    """
    mask, stack = run.mask, run.stack
    white = stack.white()
    light = white[mask].astype(np.float64)
    response = parts.unit_response(0, mask)
    energy = np.sum(np.abs(response) ** 2, axis=1)
    slopes = np.sum((harmonics * response.conj()).real, axis=1) / np.maximum(energy, 1e-12)
    seen = np.where(np.isfinite(parts.lit_px), parts.lit_px, parts.seen_px)[:, mask]
    seen = np.nan_to_num(seen, nan=0.5)
    noise = noise_lines(stack.noise_variance(), white, mask)
    noise_gains = np.array([slope_noise_gain(design) for design in stack.designs])
    pitch_px = np.array([float(one.pitch_px) for one in stack.designs])
    accounts = opaque(pitch_px), translucent(pitch_px)
    (table,) = tables_for(stack, [blur], spread_grid(pitch_px))
    expected = _harmonics_at(table, seen)
    fit = PlaceFit.of(table, accounts, noise_gains)
    fits = []
    for colour in range(light.shape[1]):
        constant, rise = noise[colour]
        variance = constant + rise * np.maximum(light[:, colour], 0)
        fits.append(
            fit.fitted(
                (expected * slopes[:, np.newaxis, :, colour] / 2).astype(np.complex64),
                seen,
                np.ones((len(light), len(pitch_px), 2)),
                light[:, colour],
                np.stack([variance, stack.white_gain * variance + 4 * constant], axis=-1),
                np.zeros((len(light), 2)),
            )
        )
    rivals = RivalFits(white.shape)
    rivals.add(slice(0, len(mask)), mask, light, fits)
    return rivals


def _harmonics_at(table: ResponseTables, places_px: Array) -> NDArray[np.complex128]:
    """What direct light at (2, n) places adds, (pitches, 2, n)."""
    rows = []
    ends = np.append(table.first[1:], len(table.down))
    for first, end, pitch_px in zip(table.first, ends, table.pitch_px, strict=True):
        bins = np.arange(end - first) * (2 * pitch_px / (end - first - 1))
        down, right = (
            np.interp(places_px[axis] % (2 * pitch_px), bins, one[first:end, 0])
            for axis, one in enumerate((table.down, table.right))
        )
        rows.append([down * right, down * right.conj()])
    return np.array(rows)


def slopes_of_ranges(parts: RenderedParts, mask: NDArray[np.bool_], pitch_px: Array) -> Array:
    """D that light of the true ranges has, were it isotropic, (pitches, n, colours)."""
    edges = np.array(RANGE_EDGES_PX)
    at = np.concatenate([[edges[0] / 2], np.sqrt(edges[1:] * edges[:-1])])
    rings = j0(np.sqrt(2) * np.pi * np.outer(1 / pitch_px, at))
    travelled = parts.ranges.sum(axis=0)[mask][..., : len(at)].astype(np.float64)
    direct = parts.truth[0][mask].astype(np.float64)
    slopes: Array = direct + np.einsum("pr,ncr->pnc", rings, travelled)
    return slopes


def chosen(
    rivals: RivalFits, run: Captured, found: NDArray[np.bool_], lit: NDArray[np.bool_], blur: Blur
) -> Image:
    """Components where regions are given and pixels without direct light are known."""
    white = np.where(run.mask[..., np.newaxis], np.maximum(run.stack.white(), 0), 0)
    unsharp = unsharpness(blur)
    colours = [rivals.colour(found, run.mask, white, k, unsharp) for k in range(white.shape[2])]
    parts = np.stack([one.components for one in colours], axis=-1)
    parts[2, ~lit] += parts[0, ~lit]
    parts[0, ~lit] = 0
    return parts


def noise_bound(run: Captured, parts: RenderedParts) -> tuple[float, float, float]:
    """Least relative error of direct, subsurface and inter-reflected light.

    Cramér and Rao's, with the curve of each kind known: harmonics of n frames have the variance
    n/2 of a frame's in each real part.
    """
    mask, stack = run.mask, run.stack
    noise = noise_lines(stack.noise_variance(), stack.white(), mask)
    truth = parts.truth[:, mask].astype(np.float64)
    frames = np.array([len(design.patterns) for design in stack.designs])
    spread = np.zeros(3)
    for colour in range(truth.shape[-1]):
        white = truth[..., colour].sum(axis=0)
        constant, rise = noise[colour]
        variance = np.maximum(constant + rise * white, 1e-30)
        curves = []
        for kind in range(3):
            response = parts.unit_response(kind, mask)
            one = response[..., colour] / np.sqrt(frames / 2)[:, np.newaxis, np.newaxis]
            curves.append(np.concatenate([one.real, one.imag]).reshape(-1, len(white)))
        design = np.stack(curves)
        information = np.einsum("kin,lin->nkl", design, design) / variance[:, None, None]
        information += 1 / (stack.white_gain * variance + 4 * constant)[:, None, None]
        for kind in range(3):
            # What is not there is known not to be.
            absent = truth[kind, :, colour] <= 1e-4 * white
            information[absent, kind, :] = 0
            information[absent, :, kind] = 0
            information[absent, kind, kind] = 1e15
        spread += np.einsum("nkk->k", np.linalg.inv(information))
    power = np.sum(truth**2, axis=(1, 2))
    direct, below, far = (
        float(np.sqrt(one / total)) if total > 0 else 0.0
        for one, total in zip(spread, power, strict=True)
    )
    return direct, below, far


def report(name: str, baseline: str, condition: str, cache: Path) -> None:
    run = captures(name, baseline, cache, [condition])[condition]
    _, projected_px, lens_px = CONDITIONS[condition]
    print(f"\n## {name}, {baseline} baseline, {condition}\n")
    print("| given | direct | not direct | inter-reflection | subsurface |\n|---|---|---|---|---|")
    best = oracle(errors_of(run.rows, run.truth["direct"], run.mask))
    rest = run.truth["subsurface"] + run.truth["interreflection"]
    others = relative_error(run.white - run.rows[best.index], rest, run.mask)
    print(f"| (oracle's single pitch) | {best.error:.4f} | {others:.3f} | – | – |")
    parts = rendered_parts(name, baseline, cache, projected_px, lens_px)
    blur = true_blur(parts, run.mask, condition, name)
    measured = decompose_ranges(run.stack, run.mask)
    line("nothing", Errors.of(_named(measured.names, measured.components), run))
    given = decompose_ranges(run.stack, run.mask, blur=[blur] * run.white.shape[2])
    line("blur", Errors.of(_named(given.names, given.components), run))
    lit = parts.truth[0].sum(axis=-1) > 0
    scatters = parts.truth[1].sum(axis=-1) > _SCATTERS * parts.truth.sum(axis=(0, -1))
    harmonics = run.stack.harmonics(run.stack.white(), slice(None))[:, :, run.mask]
    rivals = with_places(run, parts, blur, harmonics)
    line("places", Errors.of(chosen(rivals, run, measured.translucent, lit, blur), run))
    line("places, regions", Errors.of(chosen(rivals, run, scatters, lit, blur), run))
    pitch_px = np.array([float(one.pitch_px) for one in run.stack.designs])
    response = parts.unit_response(0, run.mask)
    rows = slopes_of_ranges(parts, run.mask, pitch_px)
    rivals = with_places(run, parts, blur, response * rows[:, np.newaxis])
    line("true ranges, no noise", Errors.of(chosen(rivals, run, scatters, lit, blur), run))
    if CONDITIONS[condition][0]:
        direct, below, far = noise_bound(run, parts)
        print(f"| bound by noise | {direct:.4f} | – | {far:.3f} | {below:.3f} |")


def line(label: str, errors: Errors) -> None:
    print(f"| {label} | {' | '.join(errors.cells())} |", flush=True)


def _named(names: tuple[str, ...], components: Image) -> Image:
    """Direct, subsurface and inter-reflected light, none where it was not named."""
    found = dict(zip(names, components, strict=True))
    none = np.zeros_like(components[0])
    return np.stack([found.get(n, none) for n in ("direct", "subsurface", "interreflection")])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=[*TUNED_ON, *HELD_OUT, *UNTOUCHED])
    parser.add_argument("--baselines", nargs="+", default=list(BASELINES), choices=BASELINES)
    parser.add_argument("--conditions", nargs="+", default=["noise-free", "noisy", "blurred"])
    parser.add_argument("--cache", type=Path, required=True, help="keeps what was rendered")
    options = parser.parse_args()
    for scene in options.scenes:
        for baseline in options.baselines:
            for condition in options.conditions:
                report(scene, baseline, condition, options.cache)


if __name__ == "__main__":
    main()
