"""The devices that the contracts hold for; a new driver adds its line to the tables."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial

import numpy as np

from drivers.protocols import Camera, CameraSettings, Clock, Projector, Raster
from drivers.raster import raster_digest
from drivers.sim.clock import SimulatedClock
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from drivers.sim.replay import ReplayCamera, ReplayProjector
from tests.contracts.ptp_cameras import ptp_over_ip, ptp_over_usb

SETTINGS = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
CONFIG = SimulationConfig("board", camera_px=(12, 14), projector_px=(24, 30))
FRAMES = 3


@dataclass(frozen=True, slots=True)
class ProjectorCase:
    """A projector under its contract.

    Parameters
    ----------
    projector, clock
        The device and the time that it lives in.
    settle_s
        How long `show` must at least take.
    """

    projector: Projector
    clock: Clock
    settle_s: float


@dataclass(frozen=True, slots=True)
class CameraCase:
    """A camera under its contract; it can deliver at least 3 frames.

    Parameters
    ----------
    camera, clock
        The device and the time that it lives in.
    settings
        Settings that it takes.
    refused
        Settings that it cannot take.
    image_px
        (height, width) of its decoded frames.
    """

    camera: Camera
    clock: Clock
    settings: CameraSettings
    refused: CameraSettings
    image_px: tuple[int, int]


def white() -> Raster:
    return np.full(CONFIG.projector_px, 255, np.uint8)


def lit_bench() -> SimulatedBench:
    bench = build(CONFIG, frames_in_run=FRAMES, settle_s=0.2)
    bench.projector.show(white())
    return bench


def simulated_projector() -> ProjectorCase:
    bench = build(CONFIG, settle_s=0.2)
    return ProjectorCase(bench.projector, bench.clock, settle_s=0.2)


def replay_projector() -> ProjectorCase:
    return ProjectorCase(ReplayProjector(CONFIG.projector_px), SimulatedClock(), settle_s=0.0)


def simulated_camera() -> CameraCase:
    bench = lit_bench()
    refused = CameraSettings(exposure_s=0.0)
    return CameraCase(bench.camera, bench.clock, SETTINGS, refused, CONFIG.camera_px)


def replay_camera() -> CameraCase:
    bench = lit_bench()
    frames = [bench.camera.capture(SETTINGS) for _ in range(FRAMES)]
    projector = ReplayProjector(CONFIG.projector_px)
    projector.show(white())
    digest = raster_digest(white())
    camera = ReplayCamera(projector, [(digest, partial(copy, frame)) for frame in frames])
    refused = CameraSettings(exposure_s=0.2, aperture=8.0, iso=200)
    return CameraCase(camera, bench.clock, SETTINGS, refused, CONFIG.camera_px)


PROJECTORS: dict[str, Callable[[], ProjectorCase]] = {
    "sim": simulated_projector,
    "replay": replay_projector,
}
CAMERAS: dict[str, Callable[[], CameraCase]] = {
    "sim": simulated_camera,
    "replay": replay_camera,
    "PTP over USB": lambda: CameraCase(*ptp_over_usb()),
    "PTP over IP": lambda: CameraCase(*ptp_over_ip()),
}
