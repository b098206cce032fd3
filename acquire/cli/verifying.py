"""The command that checks a session: its files, its digests, what its frames show."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acquire import bag
from acquire.cli.capturing import Quiet, Verbose
from acquire.cli.progress import ProgressDisplay
from acquire.errors import SessionError
from acquire.session import Session
from acquire.session.recovery import remedy
from acquire.session.verification import happenings, problems

if TYPE_CHECKING:
    from acquire.proof import FrameProof


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("verify")(verify_command)


def verify_command(
    folder: Annotated[Path, typer.Argument(metavar="SESSION|FILE")],
    images: Annotated[
        bool, typer.Option("--images", help="Judge again whether every frame shows its pattern.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Check every file and every digest of a session, and what its frames show."""
    if folder.is_file():
        _verify_packed(folder, images=images, as_json=as_json, quiet=quiet)
        return
    session = Session.open(folder)
    with ProgressDisplay(quiet=quiet, verbose=verbose) as progress:
        checked = _checked(session, progress, images=images)
    if as_json:
        typer.echo(_as_json(checked))
    else:
        _tell(checked)
    if checked.problems or checked.wrong:
        raise typer.Exit(1)


@dataclass(frozen=True, slots=True)
class _Checked:
    """What was found; `verdict` is None where nobody asked what the frames show."""

    session: Session
    problems: list[str]
    remedy: str | None
    befell: list[str]
    proofs: list[FrameProof]
    verdict: list[str] | None

    @property
    def wrong(self) -> list[FrameProof]:
        return [proof for proof in self.proofs if proof.is_wrong]


def _checked(session: Session, progress: ProgressDisplay, *, images: bool) -> _Checked:
    from acquire.proof import Recorded, camera_clock_jumps, verdict

    found: list[str] = []
    damaged: list[int] = []
    progress.stage("verifying", len(session.lines))
    for number, problem in enumerate(problems(session)):
        if problem is not None:
            found.append(problem)
            damaged += [number] if number < len(session.lines) else []
        progress.advance()
    proofs: list[FrameProof] = []
    said = list(verdict(session, proofs)) if images else None
    if images and not found:
        progress.stage("judging", len(session.frames))
        recorded = Recorded(session)
        proofs = list(recorded.proofs(progress.advance))
        said = [*verdict(session, proofs), *recorded.disagreements()]
    return _Checked(
        session=session,
        problems=found,
        remedy=remedy(session, damaged[0]) if damaged else None,
        befell=[*happenings(session), *camera_clock_jumps(session)],
        proofs=proofs,
        verdict=said,
    )


def _as_json(checked: _Checked) -> str:
    session = checked.session
    content = {
        "session": str(session.folder),
        "complete": session.complete,
        "frames": len(session.frames),
        "problems": checked.problems,
        "remedy": checked.remedy,
        "runs": checked.befell,
        "wrong_frames": [proof.model_dump(mode="json") for proof in checked.wrong],
        "figures": [proof.model_dump(mode="json") for proof in checked.proofs],
        "verdict": checked.verdict,
    }
    return json.dumps(content, indent=1)


def _tell(checked: _Checked) -> None:
    session, wrong = checked.session, checked.wrong
    state = (
        "complete" if session.complete else f"{len(session.frames)} of {len(session.plan)} frames"
    )
    said = [] if checked.problems else checked.verdict or []
    frames = (_in_words(session, proof) for proof in wrong)
    for line in [*checked.befell, *checked.problems, *frames, *said]:
        typer.echo(line)
    if checked.remedy:
        typer.echo(checked.remedy)
    count = len(checked.problems) + len(wrong)
    sound = "every digest is right"
    sound += "" if checked.verdict is None else ", no frame shows anything wrong"
    typer.echo(f"{session.folder}: {state}, " + (f"{count} problem(s)" if count else sound))


def _in_words(session: Session, proof: FrameProof) -> str:
    frame = session.frames[proof.step]
    return f"{session.folder / frame.file} (step {proof.step}, {frame.pattern}): {proof.in_words}"


def _verify_packed(path: Path, *, images: bool, as_json: bool, quiet: bool) -> None:
    if images:
        raise SessionError(f"{path} is packed: `lumisplit unpack` it to judge its frames.")
    with bag.opened(path) as content, ProgressDisplay(quiet=quiet) as progress:
        progress.stage("verifying", len(content.manifest))
        found = []
        for problem in bag.problems(content):
            found += [problem] if problem else []
            progress.advance()
    if as_json:
        files = len(content.manifest)
        typer.echo(json.dumps({"bag": str(path), "files": files, "problems": found}, indent=1))
    else:
        for line in found:
            typer.echo(line)
        count = f"{len(found)} problem(s)" if found else "every digest is right"
        typer.echo(f"{path}: {len(content.manifest)} files, {count}")
    if found:
        raise typer.Exit(1)
