"""The default decomposition beside the single pitch and blind IVA, on scenes of known light.

Relative errors ‖estimate − truth‖/‖truth‖ over lit, unsaturated pixels and all colours, and after
the best single gain a colour in parentheses. The single pitch is max and min with the complement,
at the pitch that only the truth can choose (oracle) and at the finest; its global light stands
under the component that the scene has beside direct light, or under both; the same with correlation
instead of extrema. Blind components are
matched to the truth by best assignment. Near and far range from differences of pitches are the
finest pitch, what a coarser one adds to it, and the rest; FastICA and NMF are scikit-learn's, and
only their errors after the best gains mean anything.

Run from the root of the repository:
``python -m benchmarks.decomposition --scenes corner groove board --camera 96 96``.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.decomposition import NMF, FastICA
from sklearn.exceptions import ConvergenceWarning

from acquire.plan_file import example_text, parse_plan
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.defects import Defects
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from processing.frames.gathering import HarmonicsStack
from processing.frames.separation import ExtremaSeparation
from processing.independence.decomposition import decompose_iva
from processing.independence.gradients import gradient_samples
from processing.metrics import (
    best_assignment,
    errors_of,
    oracle,
    relative_error,
    relative_error_with_gains,
)
from processing.patterns import Family
from processing.ranges.correspondence import decode
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.optics import Sample, measured_blur, tables_for
from processing.ranges.response import BINS_PER_PX, ResponseTables
from processing.ranges.result import RangeDecomposition
from processing.ranges.slopes import slopes

Image = NDArray[np.float32]

NAMES = ("direct", "subsurface", "interreflection")
SETTINGS = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
NOISE = {"full_well_e": 20_000.0, "read_noise_e": 5.0}
CONDITIONS = {
    "noise-free": Defects(),
    "noisy": Defects(**NOISE),
    "blurred": Defects(blur_px=1.0, **NOISE),
}


@dataclass(frozen=True, slots=True)
class Captured:
    """Everything that the methods need of one run."""

    stack: HarmonicsStack
    rows: list[Image]
    white: Image
    mask: NDArray[np.bool_]
    truth: dict[str, Image]
    gathering_s: float


def capture(bench: SimulatedBench) -> Captured:
    """Run the paper's plan; frames are decoded, used by both gatherers, and dropped."""
    patterns = parse_plan(example_text(), "paper").patterns
    projector_px = bench.projector.resolution
    shown = list(dict.fromkeys(patterns))
    frames = {}
    for family in (Family.BLACK, Family.WHITE):
        one = next(pattern for pattern in shown if pattern.family is family)
        frames[family], saturated = exposed(bench, one.raster(projector_px))
    black = frames[Family.BLACK]
    white = frames[Family.WHITE] - black
    stack = HarmonicsStack(shown, white.shape, projector_px)
    extrema = {design.pitch_px: ExtremaSeparation(white.shape) for design in stack.designs}
    gathering_s = 0.0
    for pattern in shown:
        if pattern.family.is_reference:
            continue
        frame, bright = exposed(bench, pattern.raster(projector_px))
        saturated |= bright
        frame -= black
        started = time.perf_counter()
        stack.add(frame, pattern)
        gathering_s += time.perf_counter() - started
        extrema[pattern.pitch_px].add(frame)
    rows = [extrema[design.pitch_px].separate(white).direct_light for design in stack.designs]
    brightness = white.max(axis=-1)
    mask = (brightness > 0.01 * np.percentile(brightness, 99.5)) & ~saturated
    truth = {name: part.astype(np.float32) for name, part in bench.truth().items()}
    return Captured(stack, rows, white, mask, truth, gathering_s)


def exposed(bench: SimulatedBench, raster: NDArray[np.uint8]) -> tuple[Image, NDArray[np.bool_]]:
    bench.projector.show(raster)
    image = decode_raw(bench.camera.capture(SETTINGS).data)
    return image.values.astype(np.float32), image.saturated.copy()


def cells(estimates: dict[str, Image], run: Captured, white: Image) -> list[str]:
    """One cell a component; for components that the scene lacks, their share of white."""
    row = []
    for name in NAMES:
        truth = run.truth[name]
        estimate = estimates.get(name)
        if estimate is None:
            row.append("–")
        elif not truth[run.mask].any():
            row.append(f"{estimate[run.mask].sum() / white[run.mask].sum():.2%} of white")
        else:
            plain = relative_error(estimate, truth, run.mask)
            fitted = relative_error_with_gains(estimate, truth, run.mask)
            row.append(f"{plain:.3f} ({fitted:.3f})")
    rest = run.truth["subsurface"] + run.truth["interreflection"]
    if "direct" in estimates and rest[run.mask].any():
        row.append(f"{relative_error(white - estimates['direct'], rest, run.mask):.3f}")
    else:
        row.append("–")
    return row


def single_pitch(run: Captured) -> Iterator[tuple[str, list[str]]]:
    chosen = oracle(errors_of(run.rows, run.truth["direct"], run.mask)).index
    for label, index in (("single pitch, oracle's", chosen), ("single pitch, finest", 0)):
        direct = run.rows[index]
        pitch_px = run.stack.designs[index].pitch_px
        shared = dict.fromkeys(NAMES[1:], run.white - direct)
        yield f"{label} ({pitch_px} px)", cells({"direct": direct} | shared, run, run.white)


def correlated(run: Captured) -> Iterator[tuple[str, list[str]]]:
    """Slopes of the frames with the pattern that each pixel is found to see, pitch by pitch."""
    harmonics = run.stack.harmonics(run.white, slice(None))[:, :, run.mask]
    sample = Sample(harmonics, run.white[run.mask], run.mask, 1)
    blur, _ = measured_blur(run.stack, sample)
    tables = tables_for(run.stack, blur, np.zeros(1))
    places = decode(harmonics, run.stack.designs, tables, run.stack.projector_px)
    shapes = sample.footprints(places.place_px.mean(axis=-1))
    images = np.zeros((len(run.rows), *run.white.shape), np.float32)
    for colour, (one, table) in enumerate(zip(blur, tables, strict=True)):
        gains = one.gains(table.pitch_px, table.varies, shapes)
        seen = places.place_px[..., colour]
        both = slopes(harmonics[..., colour], seen, table, gains)
        weights = energies(seen, table, gains)
        images[:, run.mask, colour] = (np.sum(both * weights, -1) / np.sum(weights, -1)).T
    chosen = oracle(errors_of(images, run.truth["direct"], run.mask)).index
    for label, index in (("oracle's", chosen), ("finest", 0)):
        pitch_px = run.stack.designs[index].pitch_px
        shared = dict.fromkeys(NAMES[1:], run.white - images[index])
        estimates = {"direct": images[index]} | shared
        yield (
            f"single pitch by correlation, {label} ({pitch_px} px)",
            cells(estimates, run, run.white),
        )


def energies(
    places: NDArray[np.float64], table: ResponseTables, gains: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Weight of both diagonals, (n, pitches, 2), to the nearest entry of the tables."""
    found = np.empty(gains.shape)
    for k, pitch_px in enumerate(table.pitch_px):
        down, right = (
            along[table.first[k] + ((place % (2 * pitch_px)) * BINS_PER_PX).astype(int), 0]
            for along, place in zip((table.down, table.right), places, strict=True)
        )
        found[:, k] = np.abs(down * right)[:, np.newaxis] ** 2 * gains[:, k] ** 2
    return np.maximum(found, 1e-12)


def blind(run: Captured) -> tuple[str, list[str]]:
    pitches = [float(design.pitch_px) for design in run.stack.designs]
    found = decompose_iva([*run.rows, run.white], [*pitches, np.inf], run.mask)
    present = [name for name in NAMES if run.truth[name][run.mask].any()]
    matched = best_assignment(
        found.components, np.stack([run.truth[name] for name in present]), run.mask
    )
    named = {name: found.components[k] for name, k in zip(present, matched.components, strict=True)}
    return "iva, best assignment", cells(named, run, run.white)


def differences(run: Captured) -> tuple[str, list[str]]:
    """Near and far range from the finest and one coarser pitch, chosen by who knows the truth."""
    near = run.truth["subsurface"]
    part = "subsurface" if near[run.mask].any() else "interreflection"
    finest, *coarser = run.rows
    estimates = (row - finest if part == "subsurface" else run.white - row for row in coarser)
    row = coarser[oracle(errors_of(estimates, run.truth[part], run.mask)).index]
    named = {"direct": finest, "subsurface": row - finest, "interreflection": run.white - row}
    return "near and far by differences", cells(named, run, run.white)


def matched(components: Image, run: Captured) -> list[str]:
    """Blind components, each on its own scale: after the best gain and sign in each colour."""
    present = [name for name in NAMES if run.truth[name][run.mask].any()]
    truths = np.stack([run.truth[name] for name in present])
    found = best_assignment(components, truths, run.mask)
    errors = dict(zip(present, found.errors, strict=True))
    return [f"({errors[name]:.3f})" if name in errors else "–" for name in NAMES] + ["–"]


def factorised(run: Captured) -> Iterator[tuple[str, list[str]]]:
    """FastICA of the gradients of each colour, and non-negative factors of all rows."""
    rows = np.stack([*run.rows, run.white])
    count = sum(bool(part[run.mask].any()) for part in run.truth.values())
    shape = (count, *run.mask.shape, rows.shape[-1])
    independent = np.zeros(shape, np.float32)
    for colour in range(rows.shape[-1]):
        plane = rows[..., colour]
        gradients = gradient_samples(plane[..., np.newaxis], run.mask)[0]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            ica = FastICA(count, whiten="unit-variance", random_state=0, max_iter=500)
            ica.fit(gradients.T)
        independent[..., colour] = np.tensordot(ica.components_, plane, 1)
    yield "FastICA, each colour alone, best assignment", matched(independent, run)
    samples = np.maximum(rows[:, run.mask].reshape(len(rows), -1), 0).T
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        factors = NMF(count, init="nndsvda", max_iter=400).fit_transform(samples)
    positive = np.zeros(shape, np.float32)
    positive[:, run.mask] = factors.T.reshape(count, -1, rows.shape[-1])
    yield "NMF, best assignment", matched(positive, run)


def ranged(run: Captured) -> tuple[RangeDecomposition, float, list[str]]:
    started = time.perf_counter()
    found = decompose_ranges(run.stack, run.mask)
    elapsed_s = time.perf_counter() - started
    named = dict(zip(found.names, found.components, strict=True))
    named.setdefault("subsurface", np.zeros_like(run.white))
    return found, elapsed_s, cells(named, run, found.white)


def coverage(found: RangeDecomposition, run: Captured) -> str:
    """Share of values whose truth lies within the stated standard error."""
    shares = []
    for name, component, deviation in zip(
        found.names, found.components, found.deviations, strict=True
    ):
        off = np.abs(component - run.truth[name])[run.mask]
        shares.append(f"{name} {np.mean(off <= deviation[run.mask]):.2f}")
    return ", ".join(shares)


def report(scene: str, condition: str, run: Captured) -> None:
    found, elapsed_s, row = ranged(run)
    print(f"\n## {scene}, {condition}, {run.mask.shape[0]} × {run.mask.shape[1]}")
    print("| method | direct | subsurface | inter-reflection | not direct |\n|---|---|---|---|---|")
    others = [*single_pitch(run), *correlated(run), differences(run), blind(run), *factorised(run)]
    for label, one in [*others, ("ranges (default)", row)]:
        print(f"| {label} | " + " | ".join(one) + " |")
    blur = ", ".join(f"{np.sqrt(one.side_px2):.2f}" for one in found.blur)
    print(
        f"blur {blur} projector px; noise {np.round(found.noise, 5)}; within one standard error: "
        f"{coverage(found, run)}; gathering {run.gathering_s:.2f} s, decomposition "
        f"{elapsed_s:.2f} s"
    )
    for remark in found.warnings:
        print(f"warning: {remark.what}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=["corner", "groove", "board"])
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), choices=CONDITIONS)
    parser.add_argument("--camera", nargs=2, type=int, default=(96, 96))
    parser.add_argument("--projector", nargs=2, type=int, default=(288, 384))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for scene in options.scenes:
        for condition in options.conditions:
            config = SimulationConfig(
                scene,
                options.seed,
                tuple(options.camera),
                tuple(options.projector),
                CONDITIONS[condition],
            )
            report(scene, condition, capture(build(config)))


if __name__ == "__main__":
    main()
