"""The scene that the camera in the virtual machine sees, rendered on this one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from acquire.plan import Plan
from drivers.protocols import CameraSettings, Raster
from drivers.raster import raster_digest
from drivers.sim.devices import SimulatedBench, SimulationConfig, build
from drivers.sim.ptp_responder.darkroom import Darkroom
from tests.guest.inside.rendered_scene import INDEX, WHITE, Exposure
from tests.guest.inside.session_checks import PROJECTOR_PX

CAMERA_PX = (24, 32)
AT_START = CameraSettings(0.1, 8.0, 200)  # as the body starts
SET = CameraSettings(1 / 80, 5.6, 400)
DRIVEN = CameraSettings(0.02, 8.0, 200)


def bench() -> SimulatedBench:
    """The simulated bench whose pictures are rendered."""
    return build(SimulationConfig(camera_px=CAMERA_PX, projector_px=PROJECTOR_PX))


def white() -> Raster:
    """What lights the scene when nothing is projected."""
    return np.full(PROJECTOR_PX, 255, np.uint8)


def render(plan: Plan, folder: Path) -> None:
    """Write every picture that the machine's camera may be asked for, and their index."""
    folder.mkdir()
    simulated, darkroom = bench(), Darkroom()
    index = []
    for number, (light, raster, settings) in enumerate(_exposures(plan)):
        simulated.projector.show(raster)
        frame = simulated.camera.capture(settings)
        raw, jpeg = f"{number}.dng", f"{number}.jpg"
        (folder / raw).write_bytes(frame.data)
        (folder / jpeg).write_bytes(darkroom.jpeg(frame.data, frame.media_type))
        assert settings.aperture is not None
        assert settings.iso is not None
        index.append(
            asdict(Exposure(light, settings.exposure_s, settings.aperture, settings.iso, raw, jpeg))
        )
    (folder / INDEX).write_text(json.dumps(index))


def _exposures(plan: Plan) -> Iterator[tuple[str, Raster, CameraSettings]]:
    for settings in (AT_START, SET, DRIVEN):
        yield WHITE, white(), settings
    for raster in {raster_digest(r): r for r in _rasters(plan)}.values():
        yield raster_digest(raster), raster, plan.camera.settings


def _rasters(plan: Plan) -> Iterator[Raster]:
    for pattern in plan.patterns:
        yield pattern.raster(PROJECTOR_PX)
