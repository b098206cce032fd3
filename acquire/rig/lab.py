"""The bench of real devices: a monitor that is a projector, a camera, a lamp, a trigger box."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial

import numpy as np

from acquire.bench_file import FolderSection, LabBench, LampSection
from acquire.errors import BenchError
from acquire.plan import Plan
from acquire.rig.bench import Bench, Connect, Resumption, closed_with
from drivers.clock import SystemClock
from drivers.errors import ProjectorError
from drivers.folder_camera import FolderCamera
from drivers.lamp import LampControl, LampTiming
from drivers.monitors import choose_monitor
from drivers.protocols import Camera, Clock, Devices
from drivers.ptp.camera import PtpCamera
from drivers.ptp.discovery import list_cameras, open_camera
from drivers.trigger import TriggerBox
from drivers.window import WindowProjector
from drivers.xserver import list_monitors

BYTES_PER_MB = 1_000_000


def lab_bench(lab: LabBench) -> Bench:
    """The bench that a file describes; asks for the monitor, opens nothing."""
    monitor = choose_monitor(list_monitors(), lab.projector.monitor)
    return Bench(
        name=f"the projector on {monitor.connector}",
        description={
            "kind": "lab",
            "lab": lab.model_dump(mode="json", exclude={"kind"}),
            "monitor": monitor.name,
            "camera": _camera_identity(lab),
        },
        resolution=monitor.size_px,
        frame_bytes=round(lab.camera.frame_mb * BYTES_PER_MB),
        frame_s=lab.camera.transfer_s,
        _connect=partial(_connect, lab, monitor.connector, _always),
        _connect_to_aim=partial(_connect, lab, monitor.connector, _never),
        _hold=partial(_hold, lab, monitor.connector),
        closes_when_complete=lab.lamp is not None and lab.lamp.off_afterwards,
    )


def _hold(lab: LabBench, connector: str, plan: Plan, closing: ExitStack) -> tuple[Connect, Connect]:
    """Open the devices once; how they are had for capturing and for aiming."""
    held = _Held(lab, connector, plan, closing)
    return held.for_capture, held.to_aim


class _Held:
    """Devices that stay open from one use to the next, the projector black between."""

    def __init__(self, lab: LabBench, connector: str, plan: Plan, closing: ExitStack) -> None:
        self._has_captured = False
        self._devices = _connect(
            lab, connector, lambda: self._has_captured, Resumption(plan), closing
        )

    def for_capture(self, resumption: Resumption, ending: ExitStack) -> Devices:
        """With what a person should change before the frames that are missing."""
        self._has_captured = True
        devices = self.to_aim(resumption, ending)
        if isinstance(devices.camera, PtpCamera):
            devices = replace(devices, warnings=_warnings(devices.camera, resumption))
        return devices

    def to_aim(self, resumption: Resumption, ending: ExitStack) -> Devices:  # noqa: ARG002
        """The devices as they are."""
        ending.callback(self._darken)
        return self._devices

    def _darken(self) -> None:
        projector = self._devices.projector
        with suppress(ProjectorError):  # it went dark by itself, and its next user is told
            projector.show(np.zeros(projector.resolution, np.uint8))


def _camera_identity(lab: LabBench) -> str:
    """What tells this camera from another: where it is, or the number it was given by its maker."""
    if lab.folder is not None:
        return "folder"
    if lab.camera.address is not None:
        return lab.camera.address
    found = list_cameras()
    serials = [camera.serial_number for camera in found if camera.serial_number]
    return serials[0] if len(found) == 1 and serials else ""


def _always() -> bool:
    return True


def _never() -> bool:
    return False


def _connect(
    lab: LabBench,
    connector: str,
    may_go_off: Callable[[], bool],
    resumption: Resumption,
    closing: ExitStack,
) -> Devices:
    """Lamp first, as it takes minutes; then the camera; the window last, as it lights the scene.

    Afterwards the lamp goes off if its section says so and it may.
    """
    clock = SystemClock()
    if lab.lamp is not None:
        _light(lab.lamp, clock, may_go_off, closing)
    plan = resumption.plan
    camera: Camera
    warnings: tuple[str, ...] = ()
    body = ""
    if lab.folder is None:
        camera = ptp = open_camera(lab.camera.address, clock)
        closing.callback(camera.close)
        warnings, body = _warnings(ptp, resumption), ptp.body
    else:
        camera = _folder_camera(lab.folder, plan, clock, closing)
        closing.callback(camera.close)
    projector = WindowProjector(connector, plan.projector.settle_s, clock)
    return closed_with(Devices(projector, camera, clock, warnings, body), closing)


def _warnings(camera: PtpCamera, resumption: Resumption) -> tuple[str, ...]:
    state = camera.state()
    missing = len(resumption.plan) - len(resumption.taken)
    return (*state.warnings, *state.shortage(missing))


def _light(
    section: LampSection, clock: Clock, may_go_off: Callable[[], bool], closing: ExitStack
) -> None:
    timing = LampTiming(warm_up_s=section.warm_up_s, on_limit_s=section.on_limit_s)
    lamp = LampControl(section.port, section.commands, timing, clock, section.baud)
    closing.callback(lamp.close)
    lamp.power_on()
    if section.off_afterwards:
        closing.callback(lambda: lamp.power_off() if may_go_off() else None)
    if section.input is not None:
        lamp.select_input(section.input)
    lamp.unfreeze()


def _folder_camera(
    section: FolderSection, plan: Plan, clock: Clock, closing: ExitStack
) -> FolderCamera:
    try:
        box = TriggerBox(section.trigger_port, section.pulse_s)
    except ValueError as error:
        raise BenchError(f"[folder]: {error}.") from error
    closing.callback(box.close)
    return FolderCamera(
        box.fire,
        section.path,
        plan.camera.settings,
        section.arrival_limit_s,
        section.quiet_s,
        clock,
    )
