"""How little of something else in a frame the proof finds, against the noise.

    python -m benchmarks.proof_limits [--trials 40]

One frame of a pitch of 36 checkers on the simulated corner shows, beside its own pattern, a share
of the picture before, or that picture in a strip at the lower end, or a white square in the middle.
For each noise and size it is drawn anew, at another step, and judged among the right ones. The
limit is the smallest size from which on at least 95 % are found, and no other frame with them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import cache

import numpy as np

from acquire.plan import Plan
from acquire.plan_file import parse_plan
from acquire.proof import Examination, FrameSamples, sample_frame
from acquire.session import FrameRecord, Transfer
from drivers.protocols import Raster
from drivers.sim.defects import Defects
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from drivers.sim.dng import MEDIA_TYPE, encode_dng
from drivers.sim.sensor import expose

PROJECTOR_PX, CAMERA_PX = (192, 256), (96, 96)
PLAN = "[pattern]\npitch_px = [16]\n"
FIRST = 2  # step 0 is white, step 1 black
NOISES = 0.005, 0.01, 0.02
SIZES = 0.005, 0.01, 0.015, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1, 0.12, 0.15, 0.2
PROVEN = 0.95
Spoil = Callable[[Raster, Raster, float], Raster]


def mixed(own: Raster, before: Raster, share: float) -> Raster:
    """A share of the picture before."""
    return np.rint((1 - share) * own + share * before.astype(np.float64)).astype(np.uint8)


def torn(own: Raster, before: Raster, height: float) -> Raster:
    """The picture before in a strip, in parts of the height; half a row at least is seen."""
    rows = max(round(height * len(own)), 1)
    return np.concatenate([own[:-rows], before[-rows:]])


def overlaid(own: Raster, _before: Raster, side: float) -> Raster:
    """A white square, its side in parts of the height."""
    height, width = own.shape
    half = max(round(side * height / 2), 1)
    made = own.copy()
    made[height // 2 - half : height // 2 + half, width // 2 - half : width // 2 + half] = 255
    return made


KINDS: dict[str, Spoil] = {"mixture": mixed, "torn": torn, "overlay": overlaid}


class Trials:
    """A pitch at one noise, and frames that are put into it."""

    def __init__(self, noise: float) -> None:
        self.plan: Plan = parse_plan(PLAN, "the benchmark's plan")
        config = SimulationConfig("corner", 0, CAMERA_PX, PROJECTOR_PX, Defects())
        self.bench: SimulatedBench = build(config)
        self.full_well_e = 1 / noise**2
        self.chance = np.random.default_rng(round(1e4 * noise))
        self.right = [self.sampled(self.raster(step)) for step in range(len(self.plan))]

    def raster(self, step: int) -> Raster:
        """What a step should show."""
        return self.plan.projector.raster(self.plan.patterns[step], PROJECTOR_PX)

    def sampled(self, raster: Raster) -> FrameSamples:
        """Samples of a noisy frame of a raster."""
        settings = self.plan.camera.settings
        stage = self.bench.stage
        light = 0.8 * stage.transport.photosites(stage.emitted(raster))
        counts = expose(light, settings.iso, self.full_well_e, 0.0, self.chance)
        return sample_frame(encode_dng(counts, settings), MEDIA_TYPE, Transfer.RAW)

    def found(self, step: int, samples: FrameSamples | None) -> set[int]:
        """Steps that are accused where one of them is replaced."""
        examination = Examination(self.plan, PROJECTOR_PX)
        for number, right in enumerate(self.right):
            own = samples if samples is not None and number == step else right
            examination.add(number, self.record(number), own)
        wrong = set()
        for unit in examination.units:
            wrong |= {proof.step for proof in examination.judge(unit) if proof.is_wrong}
            examination.settle(unit)
        return wrong

    def record(self, step: int) -> FrameRecord:
        """A line of the session that there is not."""
        return FrameRecord(
            step=step,
            pattern=self.plan.patterns[step],
            settings=self.plan.camera.settings,
            raster_sha256=f"{step:064x}",
            file=f"frames/{step:06d}.dng",
            sha256=f"{step:064x}",
            size_bytes=1,
            media_type=MEDIA_TYPE,
            started_s=None,
            finished_s=None,
        )


@cache
def trials_at(noise: float) -> Trials:
    """One draw of the right frames for all sizes."""
    return Trials(noise)


def part_found(noise: float, spoil: Spoil, size: float, trials: int) -> float:
    """Part of the wrong frames that are found, alone."""
    those = trials_at(noise)
    count = 0
    for k in range(trials):
        step = FIRST + 1 + (7 * k) % (len(those.plan) - FIRST - 1)
        raster = spoil(those.raster(step), those.raster(step - 1), size)
        count += those.found(step, those.sampled(raster)) == {step}
    return count / trials


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=40)
    options = parser.parse_args()
    for noise in NOISES:
        accused = trials_at(noise).found(-1, None)
        print(f"noise {noise:.1%} of full scale; accused without any cause: {len(accused)}")
        for name, spoil in KINDS.items():
            limit = None
            for size in reversed(SIZES):
                part = part_found(noise, spoil, size, options.trials)
                print(f"  {name:8} {size:6.1%}  found {part:.0%}", flush=True)
                if part < PROVEN:
                    break
                limit = size
            print(f"  {name:8} limit {'beyond all' if limit is None else f'{limit:.1%}'}")


if __name__ == "__main__":
    main()
