"""Captures of the rendered scenes: the paper's plan, with noise and blur, gathered for a method.

A render takes about a minute; what was gathered is kept in a folder and read back from there.
"""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from acquire.plan_file import example_text, parse_plan
from benchmarks.decomposition import Captured
from benchmarks.rendered_scenes import scenery
from benchmarks.rendering import Rendered, RenderedParts, render, render_parts
from benchmarks.solids import Scenery
from processing.frames.gathering import HarmonicsStack
from processing.frames.separation import ExtremaSeparation
from processing.patterns import Pattern

Image = NDArray[np.float32]

# Noise, blur of the projector and of the camera, each in camera pixels.
CONDITIONS = {
    "noise-free": (False, 0.0, 0.0),
    "noisy": (True, 0.0, 0.0),
    "blurred": (True, 1.0, 0.0),
    "defocused": (True, 0.0, 1.0),
}
FULL_WELL_E, READ_NOISE_E, BITS = 20_000.0, 5.0, 14
# Brightest white, apart from highlights, as a fraction of full scale.
EXPOSURE = 0.8
PATHS = 1024


def papers_patterns() -> tuple[Pattern, ...]:
    """The paper's 23 pitches × 36 shifts."""
    shown = dict.fromkeys(parse_plan(example_text(), "paper").patterns)
    return tuple(pattern for pattern in shown if not pattern.family.is_reference)


def captures(name: str, baseline: str, cache: Path, conditions: list[str]) -> dict[str, Captured]:
    """One scene under some conditions, rendered where the cache lacks it."""
    found = {}
    rendered: dict[float, Rendered] = {}
    for condition in conditions:
        kept = kept_in(cache, name, baseline, condition)
        if not kept.exists():
            _, projected_px, _ = CONDITIONS[condition]
            if projected_px not in rendered:
                rendered[projected_px] = rendered_scene(name, baseline, projected_px)
            cache.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(pickle.dumps(captured(rendered[projected_px], condition)))
        found[condition] = pickle.loads(kept.read_bytes())  # noqa: S301 (its own cache)
    return found


def kept_in(cache: Path, name: str, baseline: str, condition: str) -> Path:
    """The file of a capture."""
    return cache / f"{name}-{baseline}-{condition}.pickle"


def rendered_scene(name: str, baseline: str, projected_px: float = 0.0) -> Rendered:
    """Scene for the paper's plan, the projector's blur in camera pixels."""
    scene = scenery(name, baseline)
    return render(scene, papers_patterns(), PATHS, projected_px * projector_px_per_camera_px(scene))


def rendered_parts(
    name: str, baseline: str, cache: Path, projected_px: float, lens_px: float = 0.0
) -> RenderedParts:
    """Kinds of light apart, in the unit of the captures; rendered where the cache lacks it."""
    kept = cache / f"{name}-{baseline}-parts-{projected_px:g}.pickle"
    if not kept.exists():
        scene = scenery(name, baseline)
        stack = HarmonicsStack(papers_patterns(), (1, 1, 1), scene.projector.pixels)
        found = render_parts(
            scene, stack.designs, PATHS, projected_px * projector_px_per_camera_px(scene)
        )
        cache.mkdir(parents=True, exist_ok=True)
        kept.write_bytes(pickle.dumps(found.scaled(_gain(found.truth.sum(axis=0)))))
    parts: RenderedParts = pickle.loads(kept.read_bytes())  # noqa: S301 (its own cache)
    if not lens_px:
        return parts
    blurred = parts.defocused(lens_px)
    return blurred.scaled(_gain(blurred.truth.sum(axis=0)))


def projector_px_per_camera_px(scene: Scenery) -> float:
    """Projector pixels a camera pixel, as far away."""
    camera, projector = scene.camera, scene.projector
    return projector.pixels[1] / projector.half_width * camera.half_width / camera.pixels[1]


def _gain(white: Image) -> float:
    return EXPOSURE / float(np.percentile(white.max(axis=-1), 99.5))


def captured(rendered: Rendered, condition: str, seed: int = 0) -> Captured:
    """What a camera delivers, gathered."""
    noisy, _, lens_px = CONDITIONS[condition]
    rng = np.random.default_rng([seed, 7]) if noisy else None
    truth = {name: _defocused(part, lens_px) for name, part in rendered.truth.items()}
    white = np.sum(list(truth.values()), axis=0)
    gain = _gain(white)
    shape = white.shape
    black = exposed(np.zeros(shape, np.float32), rng)
    seen_white = exposed(white * gain, rng)
    saturated = (seen_white >= 1).any(axis=-1)
    seen_white = seen_white - black
    stack = HarmonicsStack(rendered.patterns, shape, scenery_projector_px())
    extrema = {design.pitch_px: ExtremaSeparation(shape) for design in stack.designs}
    for index, pattern in enumerate(rendered.patterns):
        frame = exposed(_defocused(rendered.frame(index), lens_px) * gain, rng) - black
        stack.add(frame, pattern)
        extrema[pattern.pitch_px].add(frame)
    rows = [extrema[d.pitch_px].separate(seen_white).direct_light for d in stack.designs]
    brightness = seen_white.max(axis=-1)
    mask = (brightness > 0.01 * np.percentile(brightness, 99.5)) & ~saturated
    scaled = {name: part * np.float32(gain) for name, part in truth.items()}
    return Captured(stack, rows, seen_white, mask, scaled, 0.0)


def scenery_projector_px() -> tuple[int, int]:
    """Of all rendered scenes."""
    return scenery("ball").projector.pixels


def _defocused(image: Image, lens_px: float) -> Image:
    if not lens_px:
        return image
    blurred: Image = ndimage.gaussian_filter(image, (lens_px, lens_px, 0), mode="nearest")
    return blurred


def exposed(light: Image, rng: np.random.Generator | None) -> Image:
    """One exposure, fractions of full scale: shot and read noise, 14 bits, clipped at 1."""
    if rng is None:
        return np.minimum(light, 1).astype(np.float32)
    electrons = rng.poisson(np.maximum(light, 0) * FULL_WELL_E) + rng.normal(
        0, READ_NOISE_E, light.shape
    )
    steps = 2**BITS - 1
    # Read noise may lead below black: raw files hold that above their black level.
    counted: Image = (np.rint(electrons / FULL_WELL_E * steps) / steps).astype(np.float32)
    return np.minimum(counted, np.float32(1))
