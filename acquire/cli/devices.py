"""Commands for single devices: projector, camera, doctor."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from acquire.cli.capturing import AsJson
from acquire.cli.interruption import stop_on_signals
from acquire.errors import BenchError, StorageError
from acquire.rig import doctor, hardware
from acquire.session.folder import write_durably
from drivers.protocols import CameraSettings
from processing.patterns import Pattern

camera_app = typer.Typer(help="Find, try and simulate cameras.", no_args_is_help=True)
projector_app = typer.Typer(help="Find and aim projectors.", no_args_is_help=True)


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("doctor")(doctor_command)
    app.add_typer(camera_app, name="camera")
    app.add_typer(projector_app, name="projector")


def doctor_command(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    write_bench: Annotated[
        Path | None, typer.Option(help="Write a bench file of what is plugged in.")
    ] = None,
) -> None:
    """Say what is plugged in, what is missing and what to do; status 1 when something is bad."""
    findings = doctor.examine()
    if as_json:
        typer.echo(json.dumps([asdict(finding) for finding in findings], indent=1))
    else:
        for finding in findings:
            typer.echo(f"{finding.verdict:<5} {finding.subject:<12} {finding.text}")
    if write_bench is not None:
        if write_bench.exists():
            raise StorageError(f"{write_bench} exists; nothing was written. Name another file.")
        write_durably(write_bench, doctor.bench_text(findings).encode())
        typer.echo(f"bench: {write_bench}", err=as_json)
    if any(finding.verdict is doctor.Verdict.BAD for finding in findings):
        raise typer.Exit(1)


@projector_app.command("list")
def projector_list(as_json: AsJson = False) -> None:
    """List monitors: connector, name, size, position, rate."""
    if as_json:
        typer.echo(json.dumps([asdict(monitor) for monitor in hardware.monitors()], indent=1))
        return
    for monitor in hardware.monitors():
        typer.echo(str(monitor))


@projector_app.command("show")
def projector_show(
    pattern: Annotated[str, typer.Argument(metavar="PATTERN", help="white, checker:16, …")],
    monitor: Annotated[str | None, typer.Option(help="Connector or name; see list.")] = None,
    seconds: Annotated[float | None, typer.Option(min=0, help="Default: until Ctrl-C.")] = None,
) -> None:
    """Show a pattern for aiming and focusing; black afterwards."""
    try:
        wanted = Pattern.parse(pattern)
    except ValueError as error:
        raise BenchError(f"{error}.") from error
    with stop_on_signals() as stop:
        hardware.show_pattern(wanted, monitor, seconds, stop)


@camera_app.command("list")
def camera_list(as_json: AsJson = False) -> None:
    """List the cameras on the USB."""
    found = hardware.cameras()
    if as_json:
        rows = [asdict(camera) | {"address": camera.address} for camera in found]
        typer.echo(json.dumps(rows, indent=1))
        return
    for camera in found:
        ids = f"{camera.vendor:04x}:{camera.product:04x}"
        typer.echo(f"{camera.address}  {ids}  {camera.name or '?'}  {camera.serial_number or '?'}")
    if not found:
        typer.echo("no camera on the USB; `lumisplit doctor` says what to check", err=True)


@camera_app.command("shoot")
def camera_shoot(
    out: Annotated[Path, typer.Option(help="File to write.")],
    camera: Annotated[
        str | None, typer.Option(help="Serial number, usb:BUS,DEVICE or ptpip:HOST[:PORT].")
    ] = None,
    exposure: Annotated[str, typer.Option(help="Seconds, 1/10 or 0.1.")] = "1/10",
    aperture: Annotated[float | None, typer.Option(min=0.5, max=128, help="f-number.")] = None,
    iso: Annotated[int | None, typer.Option(min=1, max=10_000_000)] = None,
) -> None:
    """Take one frame; the file is kept as the camera delivers it."""
    if out.exists():
        raise StorageError(f"{out} exists; nothing was captured. Name another file.")
    settings = CameraSettings(_seconds(exposure), aperture, iso)
    frame, warnings = hardware.shoot(camera, settings)
    for warning in warnings:
        typer.echo(f"warning: {warning}", err=True)
    write_durably(out, frame.data)
    typer.echo(f"{out}: {len(frame.data)} bytes, {frame.media_type}, {_in_words(frame.settings)}")


@camera_app.command("simulate")
def camera_simulate(
    ptpip: Annotated[str, typer.Option(help="HOST:PORT to listen at.")] = "127.0.0.1:15740",
    misbehave: Annotated[
        list[str] | None, typer.Option(help="What it does wrong; may be given several times.")
    ] = None,
) -> None:
    """Be a Nikon D4S-like camera on the network, until Ctrl-C."""

    def say(host: str, port: int) -> None:
        typer.echo(f"a simulated camera listens at {host}:{port}; Ctrl-C ends it", err=True)

    hardware.simulate_camera(ptpip, misbehave or [], say)


def _seconds(text: str) -> float:
    numerator, _, denominator = text.partition("/")
    try:
        seconds = float(numerator) / float(denominator or 1)
    except (ValueError, ZeroDivisionError):
        seconds = 0.0
    if not 0 < seconds <= 3600:
        raise BenchError(f"--exposure {text!r} is no time; write seconds as 1/10 or 0.1.")
    return seconds


def _in_words(settings: CameraSettings) -> str:
    aperture = "" if settings.aperture is None else f", f/{settings.aperture:g}"
    iso = "" if settings.iso is None else f", ISO {settings.iso}"
    return f"{settings.exposure_s:g} s{aperture}{iso}"
