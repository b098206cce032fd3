"""Commands that start from a session: process, evaluate, report; and the demo."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acquire.cli.capturing import AsJson, Quiet, Verbose, run_capture
from acquire.cli.progress import ProgressDisplay, tell
from acquire.errors import ResultError
from acquire.plan_file import example_text, parse_plan
from acquire.rig import find_bench
from acquire.session import Session
from drivers.image import Demosaic

if TYPE_CHECKING:
    from acquire.cluster import Cluster
    from acquire.evaluation import Evaluation
    from acquire.pipeline import Options
    from acquire.result import Result


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("demo")(demo_command)
    app.command("process")(process_command)
    app.command("evaluate")(evaluate_command)
    app.command("report")(report_command)


def demo_command(
    out: Annotated[Path, typer.Option(help="Folder for the session and the result.")] = Path(
        "lumisplit-demo"
    ),
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """The whole job on a simulated bench: capture, separate, decompose, evaluate, report."""
    from acquire.evaluation import evaluate, read_truth
    from acquire.pipeline import Options
    from acquire.recording import TRUTH
    from acquire.report import write_report

    plan = parse_plan(example_text(), "the example plan")
    progress = ProgressDisplay(quiet=quiet, verbose=verbose)
    session = run_capture(plan, find_bench("sim"), out / "session", progress)
    progress = ProgressDisplay(quiet=quiet, verbose=verbose)
    result = _process(session, out / "result", Options(), progress)
    _print_table(evaluate(result, read_truth(out / "session" / TRUTH, result.record.shape)))
    typer.echo(f"report: {write_report(result)}")


Sessions = Annotated[list[Path], typer.Argument(metavar="SESSION...")]
Out = Annotated[
    Path,
    typer.Option(
        help="Result folder; an earlier result is replaced. Of several sessions, a folder in which "
        "each gets one of its own name."
    ),
]
Method = Annotated[
    str | None, typer.Option(help="One of: ranges, iva. Default: ranges where possible.")
]
Number = Annotated[int | None, typer.Option(min=1, help="Number of components of iva; default 3.")]
Iterations = Annotated[int, typer.Option(min=1, max=10_000, help="AuxIVA iterations.")]
Smoothing = Annotated[
    float | None,
    typer.Option(min=0, max=50, help="σ before the gradients; default: from the noise."),
]
Leak = Annotated[
    float, typer.Option(min=0, max=0.99, help="b of the projector, where no black was captured.")
]
Pixels = Annotated[
    Demosaic,
    typer.Option(
        help="Pixels of raw frames. superpixel: one of each 2 × 2 photosites, every value "
        "measured. bilinear: one of each photosite, two thirds of the values interpolated."
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Dask scheduler, tcp://HOST:PORT, whose workers decode and separate the pitches; "
        "they see sessions and results under the same paths.",
    ),
]
ProfileFiles = Annotated[
    list[Path] | None,
    typer.Option(
        help="A dark, noise, leak or board profile; may be given several times. Those that the "
        "session's plan names are used anyway."
    ),
]
DriftCorrection = Annotated[
    bool,
    typer.Option(
        "--drift-correction/--no-drift-correction",
        help="Take smooth drift of lamp and camera between the references off the frames.",
    ),
]
GainCorrection = Annotated[
    bool,
    typer.Option(
        "--gain-correction/--no-gain-correction",
        help="Divide imported frames by the gains of an automatic camera, where patterns and "
        "complements tell them.",
    ),
]
ToneCorrection = Annotated[
    bool,
    typer.Option(
        "--tone-correction/--no-tone-correction",
        help="Undo the tone curve of imported pictures, where patterns and complements tell it.",
    ),
]


def process_command(
    folders: Sessions,
    out: Out,
    method: Method = None,
    components: Number = None,
    iterations: Iterations = 10,
    smoothing_px: Smoothing = None,
    leak: Leak = 0.0,
    demosaic: Pixels = Demosaic.SUPERPIXEL,
    scheduler: Scheduler = None,
    profile: ProfileFiles = None,
    drift_correction: DriftCorrection = True,
    gain_correction: GainCorrection = True,
    tone_correction: ToneCorrection = True,
    as_json: AsJson = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Separate every pitch of a session, decompose it and write the report."""
    from acquire.cluster import connected
    from acquire.pipeline import Options
    from acquire.report import write_report

    options = Options(
        method,
        components,
        iterations,
        smoothing_px,
        leak,
        demosaic,
        drift_correction,
        gain_correction,
        tone_correction,
    )
    jobs, done = _jobs(folders, out), list[dict[str, object]]()
    with nullcontext() if scheduler is None else connected(scheduler) as cluster:
        for folder, result_folder in jobs:
            session = Session.open(folder)
            progress = ProgressDisplay(quiet=quiet, verbose=verbose)
            result = _process(session, result_folder, options, progress, cluster, profile or ())
            with ProgressDisplay(quiet=quiet, verbose=verbose) as progress:
                report = write_report(result, progress)
            done.append(_summary(folder, result, report))
            if not as_json:
                typer.echo(f"components: {', '.join(result.record.components)}")
                typer.echo(f"report: {report}")
    if as_json:
        typer.echo(json.dumps(done, indent=1))


def _summary(folder: Path, result: Result, report: Path) -> dict[str, object]:
    """A processed session, for programs."""
    return {
        "session": str(folder),
        "result": str(result.folder),
        "components": list(result.record.components),
        "warnings": list(result.record.warnings),
        "cautions": [one.model_dump() for one in result.record.cautions],
        "report": str(report),
    }


def _jobs(folders: list[Path], out: Path) -> list[tuple[Path, Path]]:
    """Session and result folders; no two results in one place."""
    if len(folders) == 1:
        return [(folders[0], out)]
    names = [folder.resolve().name for folder in folders]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ResultError(
            f"Several sessions are named {twice[0]!r}, so their results would replace one another "
            f"in {out}. Process them one by one."
        )
    return [(folder, out / name) for folder, name in zip(folders, names, strict=True)]


def evaluate_command(
    folder: Annotated[Path, typer.Argument(metavar="RESULT")],
    truth: Annotated[Path, typer.Option(help="npz with direct, subsurface, interreflection.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Compare a result with the truth, single-pitch max/min beside it."""
    from acquire.evaluation import COMPARISONS, evaluate, read_truth
    from acquire.result import Result

    result = Result.open(folder)
    parts = read_truth(truth, result.record.shape)
    with ProgressDisplay(quiet=quiet, verbose=verbose) as progress:
        progress.stage("comparing", len(COMPARISONS))
        evaluation = evaluate(result, parts, progress.advance)
    if as_json:
        typer.echo(json.dumps(_finite(evaluation), indent=1))
    else:
        _print_table(evaluation)


def report_command(
    folder: Annotated[Path, typer.Argument(metavar="RESULT")],
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Write the page of a result again."""
    from acquire.report import write_report
    from acquire.result import Result

    with ProgressDisplay(quiet=quiet, verbose=verbose) as progress:
        path = write_report(Result.open(folder), progress)
    typer.echo(f"report: {path}")


def _process(
    session: Session,
    out: Path,
    options: Options,
    progress: ProgressDisplay,
    cluster: Cluster | None = None,
    profiles: Sequence[Path] = (),
) -> Result:
    from acquire.pipeline import process
    from acquire.profile_use import profiles_for

    used = profiles_for(session, profiles)
    with progress:
        result = process(session, out, options, progress, cluster, used)
    for caution in result.record.cautions:
        tell(caution, "warning", err=True)
    return result


def _finite(evaluation: Evaluation) -> dict[str, object]:
    """JSON knows no NaN: an error that is not defined becomes null."""
    rows = [
        {key: value if value == value else None for key, value in asdict(row).items()}  # noqa: PLR0124
        for row in evaluation.rows
    ]
    return asdict(evaluation) | {"rows": rows}


def _print_table(evaluation: Evaluation) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    table = Table("truth", "estimate", "how", "error", "after gains", box=SIMPLE_HEAD)
    for row in evaluation.rows:
        table.add_row(
            row.truth,
            row.estimate,
            row.matching,
            f"{row.error:.4f}",
            f"{row.error_after_gains:.4f}",
        )
    console = Console()
    console.print(table)
    console.print(
        f"{evaluation.pixels} pixels measured, {evaluation.excluded} left out "
        "(saturated, unlit, or without truth)"
    )
