"""What gathering and decomposing cost against pixels, pitches and shifts: a line each.

    python -m benchmarks.scaling

Frames of a wall with texture (`benchmarks.session.Scenery`) go through the harmonics and extrema of
their pitch, then both methods take the light apart. One of pixels, pitches and shifts grows at a
time. Times are of the processor, the smallest of some rounds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.session import FULL_WELL_E, PROJECTOR_PX, Scenery
from processing.frames.gathering import HarmonicsStack
from processing.frames.separation import ExtremaSeparation
from processing.independence.decomposition import decompose_iva
from processing.patterns import Family, Pattern, shift_grid
from processing.ranges.decomposition import decompose_ranges

Image = NDArray[np.float32]
PITCHES_PX = tuple(range(8, 97, 4))
# Photosites of a 16-megapixel camera: the wall is seen as there, and cut.
PHOTOSITES = 3264, 4928


def frames_of(lines: int, pitches_px: Sequence[int], side: int) -> dict[Pattern, Image]:
    """Frames under checkers of `side` × `side` shifts, `lines` lines of half a thousand pixels."""
    wall = Scenery.of(PHOTOSITES)
    cut = np.s_[900 : 900 + lines, 1400:1900]
    rng = np.random.default_rng(0)
    frames = {}
    patterns = [
        Pattern(Family.CHECKER, px, *shift)
        for px in pitches_px
        for shift in shift_grid(px, (side, side))
    ]
    for pattern in patterns:
        raster = pattern.raster(PROJECTOR_PX).astype(np.float32) / 255
        lit = cv2.remap(raster, wall.right_px[cut], wall.down_px[cut], cv2.INTER_LINEAR)
        light = wall.direct[cut] * lit + wall.spread[cut] * np.float32(raster.mean())
        noise = rng.standard_normal((*light.shape, 3), np.float32)
        frames[pattern] = light[..., np.newaxis] + noise * np.sqrt(light / FULL_WELL_E)[..., None]
    return frames


def processor_s(work: Callable[[], object], rounds: int) -> float:
    """Least of some rounds."""
    least = np.inf
    for _ in range(rounds):
        started_s = time.process_time()
        work()
        least = min(least, time.process_time() - started_s)
    return least


def costs(lines: int, pitches: int, side: int, rounds: int) -> tuple[float, float, float]:
    """Seconds of gathering, `ranges` and `iva`."""
    pitches_px = PITCHES_PX[:pitches]
    frames = frames_of(lines, pitches_px, side)
    shape = next(iter(frames.values())).shape
    assert len(shape) == 3

    def gathered() -> tuple[HarmonicsStack, list[ExtremaSeparation]]:
        stack = HarmonicsStack(frames, shape, PROJECTOR_PX)
        extrema = {px: ExtremaSeparation(shape) for px in pitches_px}
        for pattern, frame in frames.items():
            stack.add(frame, pattern)
            extrema[pattern.pitch_px].add(frame)
        return stack, list(extrema.values())

    stack, extrema = gathered()
    mask = np.ones(shape[:2], bool)
    white = stack.white()
    rows = np.stack([*(one.separate().direct_light for one in extrema), white])
    row_px = [*(float(px) for px in pitches_px), np.inf]
    return (
        processor_s(gathered, rounds),
        processor_s(lambda: decompose_ranges(stack, mask), rounds),
        processor_s(lambda: decompose_iva(rows, row_px, mask), rounds),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=2)
    options = parser.parse_args()
    costs(64, 4, 4, 1)
    grown = {
        "lines of 500 pixels": [(lines, 6, 6) for lines in (200, 400, 800)],
        "pitches": [(200, pitches, 6) for pitches in (6, 12, 23)],
        "shifts": [(200, 6, side) for side in (4, 6, 8)],
    }
    for name, cases in grown.items():
        print(f"\n| {name} | gathering | ranges | iva |\n|---|---|---|---|")
        for index, (lines, pitches, side) in enumerate(cases):
            seconds = costs(lines, pitches, side, options.rounds)
            value = {"lines of 500 pixels": lines, "pitches": pitches, "shifts": side**2}[name]
            if index == 0:
                first, first_seconds = value, seconds
            said = " | ".join(
                f"{one:.2f} s ({one / least:.2f})"
                for one, least in zip(seconds, first_seconds, strict=True)
            )
            print(f"| {value} ({value / first:.2f}) | {said} |", flush=True)


if __name__ == "__main__":
    main()
