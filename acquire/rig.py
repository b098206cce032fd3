"""The one place that knows concrete devices: turns ``--bench`` into a projector and a camera."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from acquire.bench_file import SimBench, SimSection, read_bench
from acquire.errors import BenchError
from acquire.plan import Plan
from acquire.session import FrameRecord, Session
from drivers.protocols import Devices, RawFrame
from drivers.sim.clock import SimulatedClock
from drivers.sim.defects import Defects
from drivers.sim.devices import DELIVERY_S, RunPosition, SimulationConfig, build
from drivers.sim.replay import ReplayCamera, ReplayProjector

DNG_OVERHEAD_BYTES = 1024
Truth = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, slots=True)
class Resumption:
    """Where a capture goes on.

    Parameters
    ----------
    plan
        The plan that is captured.
    taken
        The frames that the session holds already, in order.
    last_file
        Bytes of the last of them; None at the start.
    """

    plan: Plan
    taken: Sequence[FrameRecord] = ()
    last_file: bytes | None = None


@dataclass(frozen=True, slots=True)
class Bench:
    """A bench that has been found but not opened.

    Parameters
    ----------
    name
        As it is called in messages.
    description
        What a session records of it; the same bench has the same description.
    resolution
        (height, width) of the projector in pixels.
    frame_bytes, frame_s
        Size of one frame on the disk, and its time beside settling and exposure.
    """

    name: str
    description: dict[str, JsonValue]
    resolution: tuple[int, int]
    frame_bytes: int
    frame_s: float
    _connect: Callable[[Resumption], Devices]
    _truth: Callable[[Plan], Truth] | None = None

    @contextmanager
    def open(self, resumption: Resumption) -> Iterator[Devices]:
        """Open the devices; on every way out the projector is blanked first."""
        devices = self._connect(resumption)
        with ExitStack() as closing:
            closing.callback(devices.camera.close)
            closing.callback(devices.projector.close)
            yield devices

    def truth(self, plan: Plan) -> Truth | None:
        """The parts of light of a simulated scene, exposed as the plan says."""
        return self._truth(plan) if self._truth else None


def find_bench(text: str) -> Bench:
    """The bench that ``--bench`` names: sim, lab, replay:SESSION or a TOML file."""
    kind, _, rest = text.partition(":")
    if kind == "replay" and rest:
        return _replay_bench(Path(rest))
    if text == "lab":
        raise _no_lab()
    bench = SimBench() if text == "sim" else read_bench(Path(text))
    if not isinstance(bench, SimBench):
        raise _no_lab()
    return simulated_bench(bench.sim)


def simulated_bench(sim: SimSection) -> Bench:
    """A simulated bench as described."""
    defects = {name: getattr(sim, name) for name in Defects.__dataclass_fields__}
    try:
        config = SimulationConfig(
            sim.scene, sim.seed, sim.camera_px, sim.projector_px, Defects(**defects)
        )
    except ValueError as error:
        raise BenchError(f"[sim]: {error}.") from error
    height, width = sim.camera_px
    return Bench(
        name=f"the simulated {sim.scene}",
        description={"kind": "sim", "sim": sim.model_dump(mode="json")},
        resolution=sim.projector_px,
        frame_bytes=2 * (2 * height) * (2 * width) + DNG_OVERHEAD_BYTES,
        frame_s=DELIVERY_S,
        _connect=partial(_connect_simulation, config),
        _truth=lambda plan: build(config).truth(plan.camera.settings),
    )


def _connect_simulation(config: SimulationConfig, resumption: Resumption) -> Devices:
    plan, taken = resumption.plan, resumption.taken
    position = RunPosition()
    if taken:
        raster = taken[-1].pattern.raster(config.projector_px, plan.projector.gamma)
        time_s = taken[-1].finished_s
        if time_s is None:
            raise BenchError("The session's last frame has no time; the simulation cannot go on.")
        position = RunPosition(len(taken), time_s, raster, resumption.last_file)
    bench = build(config, len(plan), plan.projector.settle_s, position)
    return Devices(bench.projector, bench.camera, bench.clock)


def _replay_bench(folder: Path) -> Bench:
    recorded = Session.open(folder)
    size = recorded.record.bench.get("projector_px")
    rasters = [frame.raster_sha256 for frame in recorded.frames]
    if not isinstance(size, list) or not rasters or None in rasters:
        raise BenchError(
            f"{folder} cannot be replayed: it does not say which rasters were projected. Sessions "
            "that lumisplit captured can be replayed, imported ones cannot."
        )
    height, width = (int(str(part)) for part in size)
    lines = b"".join(recorded.complete_lines())
    return Bench(
        name=f"the recording {folder}",
        description={
            "kind": "replay",
            "frames_sha256": hashlib.sha256(lines).hexdigest(),
            "projector_px": [height, width],
        },
        resolution=(height, width),
        frame_bytes=max(frame.size_bytes for frame in recorded.frames),
        frame_s=0.0,
        _connect=partial(_connect_replay, recorded, (height, width)),
        _truth=None,
    )


def _connect_replay(
    recorded: Session, resolution: tuple[int, int], resumption: Resumption
) -> Devices:
    taken = [frame.raster_sha256 for frame in resumption.taken]
    queue = []
    for frame in recorded.frames:
        if frame.raster_sha256 in taken:
            taken.remove(frame.raster_sha256)
        elif frame.raster_sha256 is not None:
            queue.append((frame.raster_sha256, partial(_recorded_frame, recorded, frame)))
    projector = ReplayProjector(resolution)
    return Devices(projector, ReplayCamera(projector, queue), SimulatedClock())


def _recorded_frame(recorded: Session, frame: FrameRecord) -> RawFrame:
    if frame.settings is None or frame.started_s is None or frame.finished_s is None:
        raise BenchError(f"Step {frame.step} was recorded without settings or times.")
    return RawFrame(
        recorded.read(frame), frame.media_type, frame.settings, frame.started_s, frame.finished_s
    )


def _no_lab() -> BenchError:
    return BenchError(
        "Real devices are not driven by this version: it has the simulated bench (`sim`, or a "
        'TOML file with kind = "sim"), `replay:SESSION`, and `lumisplit import` for frames '
        "captured with other programs."
    )
