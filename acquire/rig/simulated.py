"""The bench that is computed."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial

from acquire.bench_file import SimSection
from acquire.errors import BenchError
from acquire.rig.bench import Bench, Resumption, closed_with
from drivers.protocols import Devices
from drivers.sim.defects import Defects
from drivers.sim.devices import DELIVERY_S, RunPosition, SimulationConfig, build

DNG_OVERHEAD_BYTES = 1024


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
        description={"kind": "sim", "sim": sim.model_dump(mode="json", exclude={"real_time"})},
        resolution=sim.projector_px,
        frame_bytes=2 * (2 * height) * (2 * width) + DNG_OVERHEAD_BYTES,
        frame_s=DELIVERY_S,
        _connect=partial(_connect, config, sim.real_time),
        _truth=lambda plan: build(config).truth(plan.camera.settings),
    )


def _connect(
    config: SimulationConfig, real_time: bool, resumption: Resumption, closing: ExitStack
) -> Devices:
    plan, taken = resumption.plan, resumption.taken
    position = RunPosition()
    if taken:
        raster = plan.projector.raster(taken[-1].pattern, config.projector_px)
        time_s = taken[-1].finished_s
        if time_s is None:
            raise BenchError("The session's last frame has no time; the simulation cannot go on.")
        position = RunPosition(len(taken), time_s, raster, resumption.last_file)
    bench = build(config, len(plan), plan.projector.settle_s, position, real_time=real_time)
    return closed_with(Devices(bench.projector, bench.camera, bench.clock), closing)
