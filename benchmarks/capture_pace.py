"""By how much the proof slows a capture of 16-megapixel raws down, by the clock on the wall.

    python -m benchmarks.capture_pace [--rounds 3]

Captures a pitch of 36 losslessly compressed raws through the sequencer, on devices that take the
time of real ones and nothing else: 0.1 s to settle, 0.1 s of exposure, 1 s to transfer the file. In
turn with the same capture of files of the same sizes that no reader knows: those are hashed and
written, but cannot be judged.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from acquire.plan import Plan
from acquire.recording import record
from acquire.rig.bench import Bench, Resumption, closed_with
from acquire.session import Session
from benchmarks.raw_decoding import HEIGHT, WIDTH
from benchmarks.session import PROJECTOR_PX, write_session
from drivers.clock import SystemClock
from drivers.protocols import CameraSettings, Devices, Raster, RawFrame
from drivers.raster import raster_digest
from drivers.sim.dng import MEDIA_TYPE
from tests.acquire.captures import Notes

SETTLE_S, EXPOSURE_S, TRANSFER_S = 0.1, 0.1, 1.0
UNKNOWN = "image/x-canon-crw"


class Projector:
    """Settles."""

    resolution = PROJECTOR_PX

    def __init__(self) -> None:
        self.shown = ""

    def show(self, raster: Raster) -> None:
        """Remember what, and take the time."""
        self.shown = raster_digest(raster)
        time.sleep(SETTLE_S)

    def check(self) -> None:
        """It shows what it was given."""

    def close(self) -> None:
        """Nothing is held."""


@dataclass(frozen=True, slots=True)
class Camera:
    """Delivers the file of what is shown."""

    projector: Projector
    files: Mapping[str, bytes]
    media_type: str

    def capture(self, settings: CameraSettings) -> RawFrame:
        """The file that was recorded of it."""
        started_s = time.time()
        time.sleep(EXPOSURE_S)
        finished_s = time.time()
        time.sleep(TRANSFER_S)
        data = self.files[self.projector.shown]
        return RawFrame(data, self.media_type, settings, started_s, finished_s)

    def close(self) -> None:
        """Nothing is held."""


def seconds_a_frame(folder: Path, plan: Plan, files: Mapping[str, bytes], kind: str) -> float:
    """Of a whole capture; raises RuntimeError where frames were taken again."""

    def connect(_: Resumption, closing: ExitStack) -> Devices:
        projector = Projector()
        return closed_with(
            Devices(projector, Camera(projector, files, kind), SystemClock()), closing
        )

    size = max(map(len, files.values()))
    bench = Bench("timed devices", {"kind": "benchmark"}, PROJECTOR_PX, size, 1.0, connect)
    started_s = time.monotonic()
    session, _ = record(plan, bench, folder, Notes(), threading.Event())
    elapsed_s = time.monotonic() - started_s
    if len(session.lines) != len(plan):
        raise RuntimeError(f"{len(session.lines)} exposures for {len(plan)} frames")
    return elapsed_s / len(plan)


def main() -> None:
    """Capture in turns and print the ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recorded: Session = write_session(folder / "recorded", 1, (HEIGHT, WIDTH))
        plan = recorded.plan
        digests = [
            raster_digest(plan.projector.raster(frame.pattern, PROJECTOR_PX))
            for frame in recorded.frames
        ]
        files = {
            digest: recorded.read(frame)
            for digest, frame in zip(digests, recorded.frames, strict=True)
        }
        opaque = {digest: os.urandom(len(data)) for digest, data in files.items()}
        pairs = []
        for number in range(rounds):
            unjudged = seconds_a_frame(folder / f"{number}-0", plan, opaque, UNKNOWN)
            judged = seconds_a_frame(folder / f"{number}-1", plan, files, MEDIA_TYPE)
            pairs.append(judged / unjudged)
            print(f"a frame {unjudged:.3f} s, judged {judged:.3f} s: {pairs[-1]:.3f}", flush=True)
    print(f"median {statistics.median(pairs):.3f} of {rounds} rounds of {len(plan)} frames")


if __name__ == "__main__":
    main()
