"""`ranges` on stripes in two positions a pitch, on path-traced scenes, beside the single pitch.

Stripes both ways in octaves, each as a pattern and its complement (a binary code). The oracle's
single pitch is the larger of what both directions tell at the pitch that only the truth can
choose, which is better than either direction alone. A camera of 192 pixels a side sees about one
projector pixel in each of its own, one of 96 pixels 2.8. Renders are kept in a folder.

Run from the root of the repository: ``python -m benchmarks.two_positions --cache DIR``.
"""

from __future__ import annotations

import argparse
import pickle
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.rendered_captures import EXPOSURE, exposed, projector_px_per_camera_px
from benchmarks.rendered_scenes import HELD_OUT, TUNED_ON, UNTOUCHED, scenery
from benchmarks.rendering import Rendered, render
from processing.frames.gathering import HarmonicsStack
from processing.metrics import relative_error
from processing.patterns import Family, Pattern
from processing.ranges.two_positions.decomposition import decompose_pairs

Image = NDArray[np.float32]

# Pixels of the camera and of the projector a side, paths a pixel.
CAMERAS = {"fine": (192, 256, 256), "coarse": (96, 340, 576)}
# Noise, and blur of the projector in camera pixels.
CONDITIONS = {"noise-free": (False, 0.0), "noisy": (True, 0.0), "blurred": (True, 1.0)}


def first_positions(projector_px: int) -> list[Pattern]:
    """Stripes of all octaves from 2 px, both ways."""
    pitches = [2**k for k in range(1, 12) if 2**k < projector_px]
    both = (Family.STRIPES_COLUMNS, Family.STRIPES_ROWS)
    return [Pattern(family, pitch_px) for pitch_px in pitches for family in both]


def complement(pattern: Pattern) -> Pattern:
    """The same one pitch on."""
    down = pattern.family.varies_down
    shift = (pattern.pitch_px, 0) if down else (0, pattern.pitch_px)
    return Pattern(pattern.family, pattern.pitch_px, *shift)


def rendered(name: str, camera: str, projected_px: float, cache: Path) -> Rendered:
    kept = cache / f"{name}-{camera}-{projected_px:g}.pickle"
    if not kept.exists():
        camera_px, projector_px, paths = CAMERAS[camera]
        scene = scenery(name, "small", camera_px, projector_px)
        blur_px = projected_px * projector_px_per_camera_px(scene)
        cache.mkdir(parents=True, exist_ok=True)
        found = render(scene, first_positions(projector_px), paths, blur_px)
        kept.write_bytes(pickle.dumps(found))
    return pickle.loads(kept.read_bytes())  # type: ignore[no-any-return] # noqa: S301 (its own cache)


def judge(name: str, camera: str, condition: str, cache: Path) -> str:
    noisy, projected_px = CONDITIONS[condition]
    scene = rendered(name, camera, projected_px, cache)
    rng = np.random.default_rng([0, 7]) if noisy else None
    gain = EXPOSURE / float(np.percentile(scene.white.max(axis=-1), 99.5))
    black = exposed(np.zeros_like(scene.white), rng)
    seen_white = exposed(scene.white * gain, rng)
    side = CAMERAS[camera][1]
    patterns = [one for pattern in scene.patterns for one in (pattern, complement(pattern))]
    stack = HarmonicsStack(patterns, scene.white.shape, (side, side))
    singles: dict[int, Image] = {}
    for index, pattern in enumerate(scene.patterns):
        part = scene.contrast[..., index]
        frames = [exposed(0.5 * (scene.white + s * part) * gain, rng) - black for s in (1, -1)]
        for frame, shown in zip(frames, (pattern, complement(pattern)), strict=True):
            stack.add(frame, shown)
        single = np.abs(frames[0] - frames[1])
        pitch_px = pattern.pitch_px
        singles[pitch_px] = np.maximum(singles.get(pitch_px, single), single)
    brightness = (seen_white - black).max(axis=-1)
    lit = brightness > 0.01 * np.percentile(brightness, 99.5)
    mask = lit & ~(seen_white >= 1).any(axis=-1)
    truth = {kind: light * np.float32(gain) for kind, light in scene.truth.items()}
    best = min(relative_error(one, truth["direct"], mask) for one in singles.values())
    found = decompose_pairs(stack, mask)
    cells = [f"{name}, {camera}", condition]
    named = dict(zip(found.names, found.components, strict=True))
    errors = dict(zip(found.names, found.deviations, strict=True))
    for kind, light in truth.items():
        estimate = named.get(kind, np.zeros_like(found.white))
        if not light[mask].any():
            cells.append(f"{estimate[mask].sum() / found.white[mask].sum():.2%} of white")
            continue
        cells.append(f"{relative_error(estimate, light, mask):.3f}")
        if kind == "direct":
            cells[-1] += f" ({best:.3f})"
        if kind in errors:
            off = np.abs(estimate - light)[mask] / np.maximum(errors[kind][mask], 1e-12)
            cells[-1] += f" [{np.mean(off <= 1):.2f}, {np.mean(off <= 2):.2f}]"
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--scenes", nargs="+", default=[*TUNED_ON, *HELD_OUT, *UNTOUCHED])
    parser.add_argument("--cameras", nargs="+", default=list(CAMERAS), choices=CAMERAS)
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS), choices=CONDITIONS)
    options = parser.parse_args()
    print("| scene, camera | | direct (oracle) [covered by 1, 2 errors] | subsurface |"
          " inter-reflection |\n|---|---|---|---|---|")  # fmt: skip
    for name in options.scenes:
        for camera in options.cameras:
            for condition in options.conditions:
                print(judge(name, camera, condition, options.cache), flush=True)


if __name__ == "__main__":
    main()
