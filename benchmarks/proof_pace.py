"""What the proof costs a frame of 16 million photosites, in parts of the time that a frame takes.

    python -m benchmarks.proof_pace

Samples an uncompressed and a losslessly compressed raw file, in turn with LibRaw's unpacking of the
same file, judges a pitch of 36 samples of that size, and compares one with what its raster predicts
by a geometry profile. A frame's time is that of a plan without anything to spare: 0.1 s to settle,
0.1 s of exposure, 1 s to transfer the file.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from acquire.plan_file import parse_plan
from acquire.proof.file_notes import file_notes
from acquire.proof.kinds import Codes
from acquire.proof.placement import Placement
from acquire.proof.samples import GRID_SIDE, WINDOW_SIDE, FrameSamples, sample_frame
from acquire.proof.units import units_of
from acquire.proof.white_black import WhiteBlack
from acquire.session import Transfer
from benchmarks.raw_decoding import compressed, photograph, unpack
from drivers.protocols import CameraSettings
from drivers.sim.dng import MEDIA_TYPE, encode_dng
from processing.proof.kind import Kind
from processing.proof.parts import Parts
from processing.proof.sample_noise import SampleNoise
from processing.proof.showing import judge

ROUNDS = 9
FRAME_S = 1.2


def seconds(action: object) -> float:
    """Processor time of a call: other work on the machine adds little to it."""
    started_s = time.process_time()
    action()  # type: ignore[operator]
    return time.process_time() - started_s


def pitch() -> Kind:
    """36 frames of a checker, seen one to one on a grid of the largest size, noisy."""
    plan = parse_plan("[pattern]\npitch_px = [16]\n", "the benchmark's plan")
    unit = units_of(plan)[-1]
    codes = Codes(plan, (GRID_SIDE, GRID_SIDE))
    patterns = [plan.patterns[step] for step in unit.steps]
    chance = np.random.default_rng(1)
    signs = np.stack([pattern.code((GRID_SIDE, GRID_SIDE)).ravel() for pattern in patterns])
    frames = (0.2 + 0.6 * signs + chance.normal(0, 0.01, signs.shape)).astype(np.float32)
    places = np.divmod(np.arange(GRID_SIDE**2), GRID_SIDE)
    grids = ((1, 1), (4, 4), (16, 1))
    return Kind(
        frames=frames,
        before=np.concatenate([np.full_like(frames[:1], np.nan), frames[:-1]]),
        before_index=np.arange(-1, len(frames) - 1),
        covariance=codes.covariance(unit),
        phases=codes.phases(unit),
        change=np.ones(len(frames)),
        partitions=tuple(Parts.grid(places, (GRID_SIDE, GRID_SIDE), one) for one in grids),
        white=np.ones(GRID_SIDE**2),
        noise=SampleNoise(1e-4),
        slopes=np.zeros((4, GRID_SIDE**2)),
        replaced=np.full_like(frames, np.nan),
        void=np.zeros(len(frames), bool),
        is_fine=True,
        repeated=np.zeros(len(frames), bool),
    )


def comparison() -> Callable[[], object]:
    """A frame of a checker against its raster, by places one to one with the camera's pixels."""
    plan = parse_plan("[pattern]\npitch_px = [16]\n", "the benchmark's plan")
    chance = np.random.default_rng(1)
    side = GRID_SIDE, GRID_SIDE
    row, column = np.indices(side).astype(np.float32)
    step = plan.step(len(plan) - 1)

    def samples(code: NDArray[np.float64]) -> FrameSamples:
        light = (0.05 + 0.6 * code + chance.normal(0, 0.01, side)).astype(np.float32)
        noise = chance.normal(0.3, 0.01, (WINDOW_SIDE, WINDOW_SIDE)).astype(np.float32)
        notes = file_notes(b"")
        return FrameSamples(light, light > 1, np.zeros((4, *side), np.float32), noise, 0.0, notes)

    known = WhiteBlack.of(samples(np.ones(side)), samples(np.zeros(side)))
    placement, frame = Placement(plan, column, row, side), samples(step.pattern.code(side))
    return lambda: placement.sighting(step.pattern, frame, known, None)


def main() -> None:
    plain = encode_dng(photograph(), CameraSettings(0.1, 8.0, 200))
    kind = pitch()
    judge(kind)
    judged = [seconds(lambda: judge(kind)) / len(kind.frames) for _ in range(ROUNDS)]
    compare = comparison()
    compare()
    compared_s = float(np.median([seconds(compare) for _ in range(ROUNDS)]))
    print(f"comparing with a geometry profile: {1e3 * compared_s:.1f} ms a frame")
    for name, data in (("uncompressed", plain), ("lossless JPEG", compressed(plain))):
        sample_frame(data, MEDIA_TYPE, Transfer.RAW)
        pairs = [
            (
                seconds(lambda data=data: unpack(data)),
                seconds(lambda data=data: sample_frame(data, MEDIA_TYPE, Transfer.RAW)),
            )
            for _ in range(ROUNDS)
        ]
        ratio = float(np.median([sampled / unpacked for unpacked, sampled in pairs]))
        sampled = float(np.median([sampled for _, sampled in pairs]))
        cost = sampled + float(np.median(judged))
        print(
            f"{name}: sampling {1e3 * sampled:.0f} ms, {ratio:.2f} times LibRaw's unpacking; "
            f"judging {1e3 * float(np.median(judged)):.1f} ms a frame; together "
            f"{cost / FRAME_S:.1%} of a frame's {FRAME_S} s"
        )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak {peak:.0f} MB, the files and what makes them included")


if __name__ == "__main__":
    main()
