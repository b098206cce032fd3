"""Commands that hand a session on: pack, unpack."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from acquire import bag
from acquire.cli.capturing import Quiet
from acquire.cli.progress import ProgressDisplay
from acquire.errors import SessionError
from acquire.session import Session
from acquire.session.verification import problems


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("pack")(pack_command)
    app.command("unpack")(unpack_command)


def pack_command(
    folder: Annotated[Path, typer.Argument(metavar="SESSION")],
    out: Annotated[Path, typer.Option(help="File to write, for example session.zip.")],
    result: Annotated[Path | None, typer.Argument(metavar="RESULT", show_default=False)] = None,
    quiet: Quiet = False,
) -> None:
    """Put a session, and a result, into one file (BagIt in a ZIP) that others can verify."""
    from acquire.result import Result

    session = Session.open(folder)
    if session.is_being_written:
        raise SessionError(f"{folder} is being captured: wait for its end. Nothing was packed.")
    folders = {"session": folder}
    if result is not None:
        made = Result.open(result)
        if made.record.plan_sha256 != session.plan.sha256:
            raise SessionError(f"{result} was made of another session; nothing was packed.")
        folders["result"] = result
    with ProgressDisplay(quiet=quiet) as progress:
        progress.stage("verifying", len(session.lines))
        for problem in problems(session):
            if problem is not None:
                raise SessionError(f"{problem} Nothing was packed.")
            progress.advance()
        progress.stage("packing", len(session.lines))
        bag.pack(folders, out, progress.advance)
    typer.echo(f"{len(session.frames)} frames in {out}, {out.stat().st_size / 1e6:.1f} MB")


def unpack_command(
    packed: Annotated[Path, typer.Argument(metavar="FILE")],
    out: Annotated[Path, typer.Option(help="New folder: session/ and perhaps result/.")],
    quiet: Quiet = False,
) -> None:
    """Check a packed session and write it into a new folder."""
    with bag.opened(packed) as content, ProgressDisplay(quiet=quiet) as progress:
        progress.stage("unpacking", len(content.manifest))
        bag.unpack(content, out, progress.advance)
    typer.echo(f"{packed}: every digest is right; unpacked into {out}")
    typer.echo(f"next: lumisplit process {out / 'session'} --out RESULT")
