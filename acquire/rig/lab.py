"""The bench of real devices: a monitor that is a projector, a camera, a lamp, a trigger box."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial

from acquire.bench_file import FolderSection, LabBench, LampSection
from acquire.errors import BenchError
from acquire.plan import Plan
from acquire.rig.bench import Bench, Resumption, closed_with
from drivers.clock import SystemClock
from drivers.folder_camera import FolderCamera
from drivers.lamp import LampControl, LampTiming
from drivers.monitors import choose_monitor
from drivers.protocols import Camera, Clock, Devices
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
        _connect=partial(_connect, lab, monitor.connector),
        _connect_to_aim=partial(_connect, _lit_afterwards(lab), monitor.connector),
    )


def _lit_afterwards(lab: LabBench) -> LabBench:
    if lab.lamp is None:
        return lab
    return lab.model_copy(update={"lamp": lab.lamp.model_copy(update={"off_afterwards": False})})


def _camera_identity(lab: LabBench) -> str:
    """What tells this camera from another: where it is, or the number it was given by its maker."""
    if lab.folder is not None:
        return "folder"
    if lab.camera.address is not None:
        return lab.camera.address
    found = list_cameras()
    serials = [camera.serial_number for camera in found if camera.serial_number]
    return serials[0] if len(found) == 1 and serials else ""


def _connect(lab: LabBench, connector: str, resumption: Resumption, closing: ExitStack) -> Devices:
    """Lamp first, as it takes minutes; then the camera; the window last, as it lights the scene."""
    clock = SystemClock()
    if lab.lamp is not None:
        _light(lab.lamp, clock, closing)
    plan = resumption.plan
    camera: Camera
    warnings: tuple[str, ...] = ()
    if lab.folder is None:
        camera = ptp = open_camera(lab.camera.address, clock)
        closing.callback(camera.close)
        state = ptp.state()
        warnings = (*state.warnings, *state.shortage(len(plan) - len(resumption.taken)))
    else:
        camera = _folder_camera(lab.folder, plan, clock, closing)
        closing.callback(camera.close)
    projector = WindowProjector(connector, plan.projector.settle_s, clock)
    return closed_with(Devices(projector, camera, clock, warnings), closing)


def _light(section: LampSection, clock: Clock, closing: ExitStack) -> None:
    timing = LampTiming(warm_up_s=section.warm_up_s, on_limit_s=section.on_limit_s)
    lamp = LampControl(section.port, section.commands, timing, clock, section.baud)
    closing.callback(lamp.close)
    lamp.power_on()
    if section.off_afterwards:
        closing.callback(lamp.power_off)
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
