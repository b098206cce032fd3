"""Commands with a page: bench, and the page of a capture."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acquire.cli.interruption import stop_on_signals
from acquire.cli.progress import ProgressDisplay
from acquire.plan import Plan
from acquire.plan_file import check_fits
from acquire.rig import Bench, find_bench

if TYPE_CHECKING:
    from acquire.page.capturing import CapturePage
    from acquire.page.desk import Desk
    from acquire.page.state import Setting

PortOption = Annotated[
    int, typer.Option(min=0, max=65535, help="Port of the page on this computer; 0: any.")
]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("bench")(bench_command)


def bench_command(
    plan_path: Annotated[
        Path | None,
        typer.Argument(metavar="[PLAN]", show_default=False, help="Whose patterns are shown."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Session folder; with it the plan can be started.")
    ] = None,
    bench_name: Annotated[
        str,
        typer.Option("--bench", help="sim, lab, replay:SESSION or a bench file (TOML)."),
    ] = "sim",
    monitor: Annotated[
        str | None, typer.Option(help="Where a real bench projects; see `projector list`.")
    ] = None,
    port: PortOption = 0,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress.")] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="A line for every frame.")
    ] = False,
) -> None:
    """Aim, focus and capture from a page in the browser, until Ctrl-C."""
    from acquire.page.bench import Job, PagedBench
    from acquire.profile_use import check_profiles, plan_with_profiles
    from acquire.recording import described

    bench = find_bench(bench_name, monitor)
    plan, profiles = (None, {}) if plan_path is None else plan_with_profiles(plan_path)
    if plan is not None:
        check_fits(plan, bench.resolution, bench.name)
        check_profiles(profiles, described(bench), plan.camera)
    setting = setting_of(bench, plan, profiles, can_start=plan is not None and out is not None)
    with (
        stop_on_signals() as stop,
        ProgressDisplay(quiet=quiet, verbose=verbose) as progress,
        paged(setting, out, port, progress) as desk,
    ):
        paged_bench = PagedBench(bench, Job(plan, out, profiles), desk, progress, stop)
        desk.listen(paged_bench.obey)
        paged_bench.run()


def setting_of(
    bench: Bench,
    plan: Plan | None,
    profiles: Mapping[str, Path],
    *,
    can_aim: bool = True,
    can_start: bool = False,
) -> Setting:
    """What the page is told once; `profiles` are the files of those that the plan names."""
    from acquire.page.state import Setting

    return Setting(
        bench=bench.name,
        projector_px=bench.resolution,
        frame_bytes=bench.frame_bytes,
        plan=plan,
        can_aim=can_aim,
        can_start=can_start,
        version=metadata.version("lumisplit"),
        geometry=str(profiles["geometry"].absolute()) if "geometry" in profiles else None,
    )


@contextmanager
def paged(
    setting: Setting,
    out: Path | None,
    port: int,
    progress: ProgressDisplay,
    *,
    aside: bool = False,
) -> Iterator[Desk]:
    """Serve a page and print its address, `aside` on standard error."""
    from acquire.page.desk import Desk
    from acquire.page.link import open_page

    with open_page(setting, port, progress.warning) as link:
        typer.echo(f"page: {link.address}", err=aside)
        yield Desk(link, progress.say, out)


@contextmanager
def capture_page(
    setting: Setting,
    out: Path,
    port: int,
    progress: ProgressDisplay,
    stop: threading.Event,
    counts: tuple[int, int],
    *,
    aside: bool = False,
) -> Iterator[CapturePage]:
    """The page of a capture that begins now; `counts` are frames on the disk and in the plan."""
    from acquire.page.capturing import CapturePage

    with paged(setting, out, port, progress, aside=aside) as desk:
        page = CapturePage(desk, progress, stop, *counts)
        desk.listen(page.obey)
        yield page
