"""The command that calibrates."""

from __future__ import annotations

import json
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acquire.cli.capturing import STOPPED_STATUS, Quiet, Verbose
from acquire.cli.interruption import stop_on_signals
from acquire.cli.progress import ProgressDisplay
from acquire.errors import ProfileError
from acquire.plan import CameraPlan, ProjectorPlan
from acquire.plan_file import read_plan
from acquire.rig import find_bench

if TYPE_CHECKING:
    from acquire.calibrating.finding import Calibration, Setting
    from acquire.calibrating.run import Calibrated
    from acquire.session import Session
    from calibration.poses import Chessboard


class Kind(StrEnum):
    """What can be calibrated."""

    DARK = "dark"
    NOISE = "noise"
    RESPONSE = "response"
    LEAK = "leak"
    EXPOSURE = "exposure"
    LATENCY = "latency"
    BOARD = "board"
    GEOMETRY = "geometry"
    FOCUS = "focus"


Out = Annotated[
    Path | None,
    typer.Option(help="Profile to write (JSON); its page goes beside it. focus writes none."),
]
BenchName = Annotated[
    str | None, typer.Option(help="sim, lab, replay:SESSION or a bench file; default sim.")
]
Folders = Annotated[
    list[Path] | None,
    typer.Option(
        help="Where the frames go; without --bench, frames that are there (geometry: once for "
        "each pose). Default: beside the profile."
    ),
]
PlanFile = Annotated[Path | None, typer.Option(help="Plan whose [camera] and [projector] to use.")]
Exposure = Annotated[
    float | None, typer.Option(min=1e-6, max=3600, help="Seconds, instead of the plan's.")
]
Fraction = Annotated[
    float, typer.Option(min=0.05, max=0.95, help="exposure: of saturation, to aim at.")
]
Refresh = Annotated[float, typer.Option(min=1, max=1000, help="exposure: of the projector, in Hz.")]
Corners = Annotated[
    str | None,
    typer.Option(help="geometry: inner corners of the chessboard in the poses, such as 9x6."),
]
SquareMm = Annotated[
    float, typer.Option(min=0.1, max=10_000, help="geometry: side of its squares.")
]
Shots = Annotated[
    int | None, typer.Option(min=1, help="focus: looks to take; default: until Ctrl-C.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("calibrate")(calibrate_command)


def calibrate_command(
    kind: Annotated[Kind, typer.Argument(help="What to measure.")],
    out: Out = None,
    bench: BenchName = None,
    session: Folders = None,
    plan: PlanFile = None,
    exposure: Exposure = None,
    fraction: Fraction = 0.8,
    refresh: Refresh = 60.0,
    board: Corners = None,
    square_mm: SquareMm = 25.0,
    shots: Shots = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the profile; focus: a line a shot.")
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Measure the bench: captures a plan of its own, fits it, writes profile and page."""
    from acquire.calibrating import calibrate, recorded_sessions
    from acquire.calibrating.page import write_page

    if kind is Kind.FOCUS:
        _focus(plan, exposure, bench or "sim", shots, as_json=as_json)
        return
    path = _profile_path(kind, out)
    calibration = _calibration(kind, exposure, fraction, refresh, _chessboard(board, square_mm))
    folders = session or [path.with_suffix(".session")]
    if len(folders) > 1 and (kind is not Kind.GEOMETRY or bench is not None):
        raise ProfileError(
            "Several --session are the poses of `calibrate geometry`, captured before, each by a "
            "call of its own; leave --bench out."
        )
    if bench is None and session:
        sessions = [one for folder in folders for one in recorded_sessions(folder)]
    else:
        progress = ProgressDisplay(quiet=quiet, verbose=verbose)
        sessions = _captured(calibration, plan, exposure, bench or "sim", folders[0], progress)
    with ProgressDisplay(quiet=quiet, verbose=verbose) as progress:
        calibrated = calibrate(calibration, sessions, path, progress)
    page = write_page(path, calibrated, calibration.purpose)
    if as_json:
        typer.echo(calibrated.profile.model_dump_json(indent=1))
        return
    _print(calibrated)
    typer.echo(f"profile: {path}")
    typer.echo(f"page: {page}")


def _profile_path(kind: Kind, out: Path | None) -> Path:
    if out is None:
        raise ProfileError(f"calibrate {kind.value} writes a profile: give --out PROFILE.json.")
    if out.suffix != ".json":
        raise ProfileError(f"--out {out}: a profile is JSON; give a name that ends in .json.")
    return out


def _focus(
    plan_path: Path | None, exposure_s: float | None, name: str, shots: int | None, *, as_json: bool
) -> None:
    from acquire.calibrating.focusing import look

    bench = find_bench(name)
    setting = _setting(plan_path, exposure_s, bench.resolution)
    best: dict[str, float] = {}
    with stop_on_signals() as stop:
        for shot in look(bench, setting, shots, stop):
            if as_json:
                typer.echo(json.dumps(asdict(shot)))
                continue
            figures = []
            for lens, figure in (("chart", shot.chart), ("camera", shot.camera)):
                best[lens] = max(best.get(lens, 0.0), figure or 0.0)
                shown = "–" if figure is None else f"{figure:.4g}"
                figures.append(f"{lens} {shown} (best {best[lens]:.4g})")
            typer.echo(
                f"{shot.number:4}  {'  '.join(figures)}  clipped {shot.clipped:.1%}  "
                f"lit {shot.lit:.0%}"
            )


def _calibration(
    kind: Kind,
    exposure_s: float | None,
    fraction: float,
    refresh_hz: float,
    board: Chessboard | None,
) -> Calibration:
    from acquire.calibrating import calibration_named
    from acquire.calibrating.exposure import ExposureCalibration
    from acquire.calibrating.geometry import GeometryCalibration
    from acquire.calibrating.latency import LatencyCalibration

    if kind is Kind.EXPOSURE:
        return ExposureCalibration(fraction=fraction, refresh_hz=refresh_hz)
    if kind is Kind.LATENCY and exposure_s is not None:
        return LatencyCalibration(exposure_s=exposure_s)
    if kind is Kind.GEOMETRY:
        return GeometryCalibration(board=board)
    return calibration_named(kind.value)


def _chessboard(text: str | None, square_mm: float) -> Chessboard | None:
    from calibration.poses import Chessboard

    if text is None:
        return None
    columns, _, rows = text.partition("x")
    if not (columns.isdigit() and rows.isdigit() and min(int(columns), int(rows)) > 2):
        raise ProfileError(
            f"--board {text}: give the inner corners along and across, at least 3 each, such as "
            "9x6."
        )
    return Chessboard(int(columns), int(rows), square_mm / 1000)


def _captured(
    calibration: Calibration,
    plan_path: Path | None,
    exposure_s: float | None,
    bench_name: str,
    folder: Path,
    progress: ProgressDisplay,
) -> list[Session]:
    from acquire.calibrating.run import capture_all
    from acquire.sequencer import Outcome

    bench = find_bench(bench_name)
    setting = _setting(plan_path, exposure_s, bench.resolution)
    typer.echo(f"{calibration.kind}: {calibration.purpose}", err=True)
    with stop_on_signals() as stop, progress:
        sessions, outcome = capture_all(calibration, setting, bench, folder, progress, stop)
    if outcome is Outcome.STOPPED:
        typer.echo(f"stopped; the same command goes on with {folder}", err=True)
        raise typer.Exit(STOPPED_STATUS)
    return sessions


def _setting(
    plan_path: Path | None, exposure_s: float | None, resolution: tuple[int, int]
) -> Setting:
    from acquire.calibrating.finding import Setting

    camera, projector = CameraPlan(), ProjectorPlan()
    if plan_path is not None:
        given = read_plan(plan_path)
        camera, projector = given.camera, given.projector
    if exposure_s is not None:
        camera = camera.model_copy(update={"exposure_s": exposure_s})
    return Setting(camera, projector, resolution)


def _print(calibrated: Calibrated) -> None:

    for name, one in calibrated.profile.quantities.items():
        unit = f" {one.unit}" if one.unit else ""
        typer.echo(f"{name:<20} {one.in_words}{unit}")
    for warning in calibrated.profile.warnings:
        typer.echo(f"warning: {warning}", err=True)
