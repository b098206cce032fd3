"""Single devices, for aiming, focusing and trying out, apart from any capture."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from acquire.errors import BenchError
from drivers.clock import SystemClock
from drivers.monitors import Monitor
from drivers.protocols import CameraSettings, RawFrame
from drivers.ptp.discovery import FoundCamera, list_cameras, open_camera
from drivers.window import WindowProjector
from drivers.xserver import colour_casts, list_monitors
from processing.patterns import Pattern

LOOPBACK = "127.0.0.1"
# Display profiles differ by some percent between the colours, night lights by tens.
NEUTRAL_CAST = 0.05


def monitors() -> Sequence[Monitor]:
    """Every lit monitor; raises `drivers.errors.ProjectorError` without an X server."""
    return list_monitors()


def tinted_monitors() -> dict[str, float]:
    """Monitors whose gamma ramps colour what they show, and by what fraction of full light."""
    return {name: cast for name, cast in colour_casts().items() if cast > NEUTRAL_CAST}


def show_pattern(
    pattern: Pattern, monitor: str | None, duration_s: float | None, stop: threading.Event
) -> None:
    """Show a pattern until the time is over or `stop` is set; black afterwards."""
    projector = WindowProjector(monitor, 0.0, SystemClock())
    try:
        projector.show(pattern.raster(projector.resolution))
        projector.hold(duration_s, stop)
    finally:
        projector.close()


def cameras() -> list[FoundCamera]:
    """Cameras on the USB."""
    return list_cameras()


def shoot(address: str | None, settings: CameraSettings) -> tuple[RawFrame, tuple[str, ...]]:
    """One exposure, and what a person should change on the camera."""
    with open_camera(address) as camera:
        warnings = camera.state().warnings
        return camera.capture(settings), warnings


def simulate_camera(
    endpoint: str, misbehaviours: Sequence[str], listening: Callable[[str, int], None]
) -> None:
    """Serve a simulated D4S-like camera over PTP/IP at HOST:PORT until interrupted.

    `listening` is called with host and port once hosts can connect.
    """
    from drivers.sim.ptp_responder.darkroom import Darkroom
    from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
    from drivers.sim.ptp_responder.responder import Responder
    from drivers.sim.ptp_responder.scenery import simulated_scene
    from drivers.sim.ptp_responder.server import serve_ptpip

    host, _, port = endpoint.rpartition(":")
    if not port.isdigit() or int(port) > 65535:
        raise BenchError(f"--ptpip {endpoint!r} is no address; write HOST:PORT, 127.0.0.1:15740.")
    try:
        script = [Misbehaviour.parse(text) for text in misbehaviours]
    except ValueError as error:
        raise BenchError(f"--misbehave: {error}.") from error
    camera = Responder(simulated_scene(), misbehaviours=script, developer=Darkroom())
    serve_ptpip(camera, host or LOOPBACK, int(port), listening)
