"""Benches on which something goes wrong at a known exposure."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from acquire.rig import Bench
from acquire.rig.bench import Resumption, closed_with
from drivers.errors import ProjectorError
from drivers.protocols import Camera, CameraSettings, Clock, Devices, Projector, Raster, RawFrame
from drivers.sim.clock import EPOCH_S
from drivers.sim.devices import SimulatedCamera


@dataclass
class Faults:
    """What befalls the devices, by the number of the exposure in the session, from 0.

    The times are in all, when so many exposures were made: by how much the wall clock was set, how
    long the computer was suspended, and by how much the camera's clock was set.
    """

    dark: Callable[[int], bool] = lambda _: False
    shown: Callable[[int, Raster], Raster] = lambda _number, raster: raster
    frozen: Callable[[int], bool] = lambda _: False
    unplugged: Callable[[int], bool] = lambda _: False
    failing: Callable[[int], BaseException | None] = lambda _: None
    lost: Callable[[int], BaseException | None] = lambda _: None
    clock_off_s: Callable[[int], float] = lambda _: 0.0
    slept_s: Callable[[int], float] = lambda _: 0.0
    camera_off_s: Callable[[int], float] = lambda _: 0.0


@dataclass
class FaultyClock:
    """A clock that is set and a computer that is suspended, as exposures go on."""

    clock: Clock
    faults: Faults
    number: int

    def now(self) -> float:
        return self.monotonic() + EPOCH_S + self.faults.clock_off_s(self.number)

    def monotonic(self) -> float:
        return self.clock.monotonic() + self.faults.slept_s(self.number)

    def awake(self) -> float:
        return self.clock.monotonic()

    def sleep(self, duration_s: float) -> None:
        self.clock.sleep(duration_s)


@dataclass
class FaultyBench:
    """Projector, camera and clock with faults; hands everything else on."""

    projector_: Projector
    camera_: Camera
    clock: FaultyClock
    faults: Faults
    number: int
    last: RawFrame | None = None

    @property
    def resolution(self) -> tuple[int, int]:
        return self.projector_.resolution

    def show(self, raster: Raster) -> None:
        dark = self.faults.dark(self.number)
        shown = self.faults.shown(self.number, raster)
        self.projector_.show(np.zeros_like(raster) if dark else shown)

    def check(self) -> None:
        if self.faults.unplugged(self.number - 1):
            raise ProjectorError("the projector was unplugged")

    def capture(self, settings: CameraSettings) -> RawFrame:
        error = self.faults.failing(self.number)
        if error is not None:
            raise error
        started_s = self.clock.now()
        if isinstance(self.camera_, SimulatedCamera):
            self.camera_.ahead_s = self.faults.camera_off_s(self.number)
        frame = self.camera_.capture(settings)
        error = self.faults.lost(self.number)
        if error is not None:
            raise error
        if self.last is not None and self.faults.frozen(self.number):
            frame = replace(frame, data=self.last.data)
        self.number = self.clock.number = self.number + 1
        self.last = replace(frame, started_s=started_s, finished_s=self.clock.now())
        return self.last

    def close(self) -> None:
        self.projector_.close()
        self.camera_.close()


def with_faults(bench: Bench, faults: Faults) -> Bench:
    """The bench as it is, but for these faults."""

    def connect(resumption: Resumption, closing: ExitStack) -> Devices:
        devices = bench._connect(resumption, closing)
        number = len(resumption.taken)
        clock = FaultyClock(devices.clock, faults, number)
        both = FaultyBench(devices.projector, devices.camera, clock, faults, number)
        return closed_with(Devices(both, both, clock), closing)

    return replace(bench, _connect=connect)
