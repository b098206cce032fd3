"""Commands that lead to a session: plan, capture, import."""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from acquire.cli.bench import PortOption, capture_page, setting_of
from acquire.cli.interruption import stop_on_signals
from acquire.cli.progress import ProgressDisplay, tell
from acquire.errors import PlanError
from acquire.plan import Plan
from acquire.plan_file import check_fits, example_text
from acquire.rig import Bench, find_bench
from acquire.session import Session
from acquire.session.verification import clock_jumps
from acquire.storage import check_room, free_bytes

if TYPE_CHECKING:
    from acquire.sequencer import Outcome

BenchOption = Annotated[
    str,
    typer.Option("--bench", help="sim, lab, replay:SESSION or the path of a bench file (TOML)."),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, only the outcome.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="A line for every frame: what it was, its time.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
STOPPED_STATUS = 130


class TransferChoice(StrEnum):
    """How the numbers of imported pictures relate to light."""

    AUTO = "auto"
    SRGB = "srgb"
    LINEAR = "linear"


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("plan")(plan_command)
    app.command("capture")(capture_command)
    app.command("import")(import_command)


def plan_command(
    plan_path: Annotated[Path | None, typer.Argument(metavar="PLAN", show_default=False)] = None,
    example: Annotated[bool, typer.Option("--example", help="Print a commented plan.")] = False,
    bench_name: BenchOption = "sim",
    out: Annotated[Path, typer.Option(help="Where the session would be written.")] = Path(),
    as_json: AsJson = False,
) -> None:
    """Check a plan and print its frames, time and disk; nothing is shown or captured."""
    if example:
        typer.echo(example_text(), nl=False)
        return
    if plan_path is None:
        raise PlanError("Name a plan, or `lumisplit plan --example` to print one.")
    from acquire.profile_use import plan_with_profiles

    plan, _ = plan_with_profiles(plan_path)
    bench = find_bench(bench_name)
    check_fits(plan, bench.resolution, bench.name)
    cost = _cost(plan, bench, out)
    if as_json:
        typer.echo(json.dumps(cost, indent=1))
    else:
        _print_cost(cost)
    check_room(out, len(plan) * bench.frame_bytes)


def capture_command(
    plan_path: Annotated[Path, typer.Argument(metavar="PLAN")],
    out: Annotated[Path, typer.Option(help="Session folder; an interrupted one is gone on with.")],
    bench_name: BenchOption = "sim",
    keep_unproven: Annotated[
        bool,
        typer.Option(
            "--keep-unproven",
            help="Go on, and note it, where a frame does not show its pattern after 3 retakes.",
        ),
    ] = False,
    mend: Annotated[
        bool,
        typer.Option(
            "--mend", help="Take the last frames again whose files were lost or damaged since."
        ),
    ] = False,
    page: Annotated[bool, typer.Option("--page", help="Show it on a page in the browser.")] = False,
    port: PortOption = 0,
    as_json: AsJson = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Capture a plan; give the same command again to go on where it stopped."""
    from acquire.profile_use import check_profiles, plan_with_profiles
    from acquire.recording import described

    (plan, profiles), bench = plan_with_profiles(plan_path), find_bench(bench_name)
    check_profiles(profiles, described(bench), plan.camera)
    where = port if page else None
    progress = ProgressDisplay(quiet=quiet, verbose=verbose)
    run_capture(
        plan,
        bench,
        out,
        progress,
        keep_unproven=keep_unproven,
        mend=mend,
        port=where,
        profiles=profiles,
        as_json=as_json,
    )


def import_command(
    table: Annotated[Path, typer.Argument(metavar="TABLE.csv")],
    out: Annotated[Path, typer.Option(help="Session folder to write.")],
    transfer: Annotated[
        TransferChoice, typer.Option(help="auto: 8-bit pictures are sRGB, all others linear.")
    ] = TransferChoice.AUTO,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Turn a stack that somebody else captured into a session."""
    from acquire.table import import_table

    with ProgressDisplay(quiet=quiet, verbose=verbose) as progress:
        session = import_table(table, out, transfer=transfer.value, progress=progress)
    typer.echo(f"{len(session.frames)} frames imported into {out}")
    for note in session.record.source.notes if session.record.source else ():
        tell(note, "note")
    typer.echo(f"next: lumisplit process {out} --out RESULT")


def run_capture(
    plan: Plan,
    bench: Bench,
    out: Path,
    progress: ProgressDisplay,
    *,
    keep_unproven: bool = False,
    mend: bool = False,
    port: int | None = None,
    profiles: Mapping[str, Path] | None = None,
    as_json: bool = False,
) -> Session:
    """Capture with progress, and with a page on `port` unless None; says how it went.

    The `profiles` that the plan names, their files by kind, are kept in the session.

    Exits with status 130 when it was asked to stop.
    """
    from acquire.proof import camera_clock_jumps
    from acquire.recording import record
    from acquire.sequencer import Outcome

    done = len(Session.open(out).frames) if Session.exists(out) else 0
    capture = partial(
        record, plan, bench, out, keep_unproven=keep_unproven, mend=mend, profiles=profiles
    )
    with stop_on_signals() as stop, progress:
        progress.stage("capturing", len(plan), done)
        if port is None:
            session, outcome = capture(progress, stop)
        else:
            setting = setting_of(bench, plan, profiles or {}, can_aim=False)
            counts = done, len(plan)
            with capture_page(setting, out, port, progress, stop, counts, aside=as_json) as page:
                session, outcome = capture(page, stop, page.pause)
    again = len(session.lines) - len(session.frames)
    for jump in (*clock_jumps(session), *camera_clock_jumps(session)):
        typer.echo(f"note: {jump}", err=True)
    if as_json:
        typer.echo(json.dumps(_outcome(session, outcome, again), indent=1))
    if outcome is Outcome.STOPPED:
        typer.echo(
            f"stopped: {len(session.frames)} of {len(plan)} frames are in {out}; "
            "the same command goes on from there",
            err=True,
        )
        raise typer.Exit(STOPPED_STATUS)
    taken = f", {again} taken again because they did not show their pattern" if again else ""
    if not as_json:
        typer.echo(f"{len(session.frames)} frames in {out}{taken}")
    return session


def _outcome(session: Session, outcome: Outcome, again: int) -> dict[str, Any]:
    return {
        "session": str(session.folder),
        "outcome": outcome.value,
        "frames": len(session.frames),
        "total": len(session.plan),
        "taken_again": again,
        "plan_sha256": session.record.plan_sha256,
    }


def _cost(plan: Plan, bench: Bench, out: Path) -> dict[str, Any]:
    pitches = sorted({p.pitch_px for p in plan.patterns if p.family.is_separable})
    each_s = plan.projector.settle_s + plan.exposed_s / len(plan) + bench.frame_s
    return {
        "bench": bench.name,
        "projector_px": list(bench.resolution),
        "pitches_px": pitches,
        "frames": len(plan),
        "frame_s": each_s,
        "time_s": len(plan) * each_s,
        "disk_bytes": len(plan) * bench.frame_bytes,
        "free_bytes": free_bytes(out),
        "plan_sha256": plan.sha256,
    }


def _print_cost(cost: dict[str, Any]) -> None:
    height, width = cost["projector_px"]
    pitches = cost["pitches_px"]
    minutes, seconds = divmod(round(cost["time_s"]), 60)
    typer.echo(f"bench    {cost['bench']}, projector {width} × {height} px")
    typer.echo(f"pitches  {len(pitches)}: {', '.join(map(str, pitches))} px")
    typer.echo(f"frames   {cost['frames']}")
    typer.echo(f"time     about {minutes} min {seconds} s, {cost['frame_s']:.2f} s a frame")
    typer.echo(
        f"disk     {cost['disk_bytes'] / 1e6:.1f} MB, {cost['free_bytes'] / 1e9:.1f} GB free"
    )
