"""The bench that is a recording."""

from __future__ import annotations

import hashlib
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from acquire.errors import BenchError
from acquire.rig.bench import Bench, Resumption, closed_with
from acquire.session import FrameRecord, Session
from drivers.protocols import Devices, RawFrame
from drivers.sim.clock import SimulatedClock
from drivers.sim.replay import ReplayCamera, ReplayProjector


def replay_bench(folder: Path) -> Bench:
    """A session that was captured, played back."""
    recorded = Session.open(folder)
    resolution = recorded.projector_px
    if resolution is None or not recorded.frames or recorded.frames[0].raster_sha256 is None:
        raise BenchError(
            f"{folder} cannot be replayed: it does not say which rasters were projected. Sessions "
            "that lumisplit captured can be replayed, imported ones cannot."
        )
    lines = b"".join(recorded.complete_lines())
    return Bench(
        name=f"the recording {folder}",
        description={
            "kind": "replay",
            "frames_sha256": hashlib.sha256(lines).hexdigest(),
            "of": recorded.record.bench.get("of", recorded.record.bench),
        },
        resolution=resolution,
        frame_bytes=max(frame.size_bytes for frame in recorded.lines),
        frame_s=0.0,
        _connect=partial(_connect, recorded, resolution),
    )


def _connect(
    recorded: Session, resolution: tuple[int, int], resumption: Resumption, closing: ExitStack
) -> Devices:
    taken = [frame.raster_sha256 for frame in resumption.taken]
    queue = []
    for frame in recorded.lines:
        if frame.raster_sha256 in taken:
            taken.remove(frame.raster_sha256)
        elif frame.raster_sha256 is not None:
            queue.append((frame.raster_sha256, partial(_recorded_frame, recorded, frame)))
    projector = ReplayProjector(resolution)
    devices = Devices(projector, ReplayCamera(projector, queue), SimulatedClock())
    return closed_with(devices, closing)


def _recorded_frame(recorded: Session, frame: FrameRecord) -> RawFrame:
    if frame.settings is None or frame.started_s is None or frame.finished_s is None:
        raise BenchError(f"Step {frame.step} was recorded without settings or times.")
    return RawFrame(
        recorded.read(frame),
        frame.media_type,
        frame.settings,
        frame.started_s,
        frame.finished_s,
        frame.monotonic_s,
    )
