"""How often the stated standard errors of single pitches hold, on simulated scenes.

    python -m benchmarks.single_pitch_coverage

Each scene is captured twice, with and without noise. Covered are the pixels at which what the
noise-free frames read (max less min) lies within one standard error of the estimate; it should be
0.68 of them. The error over its standard error should have mean 0 and standard deviation 1.
Neither noise, nor places, nor the footprint are given to the estimator.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.defects import Defects
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from processing.frames.frame_noise import FrameNoise, FrameSample, lattice, noise_of
from processing.frames.noise_bias import extrema_correction, measured_kinds
from processing.frames.separation import ExtremaSeparation
from processing.frames.single_pitch import Estimate, extrema_estimate
from processing.patterns import Family, Pattern, shift_grid

Image = NDArray[np.float32]
SETTINGS = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
CAMERAS = {"20 000 e": (20_000.0, 5.0), "2 000 e": (2_000.0, 5.0), "200 000 e": (200_000.0, 20.0)}


@dataclass(frozen=True, slots=True)
class Gathered:
    """One capture of one pitch."""

    direct_light: Image
    white: Image
    sample: FrameSample
    usable: NDArray[np.bool_]


def exposed(bench: SimulatedBench, pattern: Pattern) -> tuple[Image, NDArray[np.bool_]]:
    bench.projector.show(pattern.raster(bench.projector.resolution))
    image = decode_raw(bench.camera.capture(SETTINGS).data)
    return image.values.astype(np.float32), image.saturated.copy()


def gathered(config: SimulationConfig, patterns: list[Pattern]) -> Gathered:
    bench = build(config)
    black, _ = exposed(bench, Pattern(Family.BLACK))
    white, saturated = exposed(bench, Pattern(Family.WHITE))
    white = white - black
    extrema, sample = ExtremaSeparation(white.shape), FrameSample(patterns)
    for pattern in patterns:
        frame, bright = exposed(bench, pattern)
        saturated |= bright
        extrema.add(frame - black)
        sample.add(frame - black, pattern)
    brightness = white.max(axis=-1)
    usable = (brightness > 0.01 * np.percentile(brightness, 99.5)) & ~saturated
    return Gathered(extrema.separate().direct_light, white, sample, usable)


def estimated(seen: Gathered, noise: FrameNoise) -> Estimate:
    """As `acquire.corrections` does it."""
    correction = extrema_correction(len(seen.sample.patterns))
    at = lattice(seen.usable.shape)
    kinds = measured_kinds(seen.sample, noise, seen.usable[at], correction)
    return extrema_estimate(seen.direct_light, seen.white, noise, correction, kinds=kinds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", default=["groove", "board", "corner"])
    parser.add_argument("--cameras", nargs="+", default=list(CAMERAS), choices=CAMERAS)
    parser.add_argument("--blurs-px", nargs="+", type=float, default=[0.0, 1.0])
    parser.add_argument("--pitches-px", nargs="+", type=int, default=[10, 20, 44, 72])
    parser.add_argument("--shifts", nargs=2, type=int, default=(6, 6))
    parser.add_argument("--camera-px", nargs=2, type=int, default=(96, 96))
    parser.add_argument("--seed", type=int, default=11)
    options = parser.parse_args()
    for scene in options.scenes:
        for blur_px in options.blurs_px:
            for camera in options.cameras:
                report(scene, blur_px, camera, options)


def report(scene: str, blur_px: float, camera: str, options: argparse.Namespace) -> None:
    cells = []
    for pitch_px in options.pitches_px:
        patterns = checkers(pitch_px, tuple(options.shifts))
        config = SimulationConfig(scene, options.seed, tuple(options.camera_px), (288, 384))
        error = errors(config, blur_px, camera, patterns)
        held = float(np.mean(np.abs(error) <= 1))
        cells.append(f"{held:.3f} ({error.mean():+.2f}, {error.std():.2f})")
    print(f"| {scene}, blur {blur_px:g} px, {camera} | " + " | ".join(cells) + " |", flush=True)


def checkers(pitch_px: int, shifts: tuple[int, int]) -> list[Pattern]:
    grid = shift_grid(pitch_px, shifts)
    return [Pattern(Family.CHECKER, pitch_px, *shift) for shift in grid]


def errors(
    config: SimulationConfig, blur_px: float, camera: str, patterns: list[Pattern]
) -> NDArray[np.float32]:
    """Error of every usable value over its standard error."""
    well_e, read_e = CAMERAS[camera]
    noisy, clean = (
        gathered(replace(config, defects=defects), patterns)
        for defects in (
            Defects(blur_px=blur_px, full_well_e=well_e, read_noise_e=read_e),
            Defects(blur_px=blur_px),
        )
    )
    variance = noisy.sample.noise_variance
    assert variance is not None
    found = estimated(noisy, noise_of([variance], noisy.white, noisy.usable))
    usable = noisy.usable & clean.usable
    off = found.direct_light - clean.direct_light
    error: NDArray[np.float32] = off[usable] / found.deviation[usable]
    return error


if __name__ == "__main__":
    main()
