"""Exposures of a simulated scene, for the simulated camera to deliver."""

from __future__ import annotations

import numpy as np

from drivers.protocols import CameraSettings
from drivers.sim.devices import SimulationConfig, build
from drivers.sim.ptp_responder.source import ImageSource


def simulated_scene(config: SimulationConfig | None = None) -> ImageSource:
    """Exposures of a simulated scene under a white projector, as DNG files."""
    bench = build(SimulationConfig() if config is None else config)
    bench.projector.show(np.full(bench.projector.resolution, 255, np.uint8))

    def source(settings: CameraSettings) -> tuple[bytes, str]:
        frame = bench.camera.capture(settings)
        return frame.data, frame.media_type

    return source
