"""The command tree, and what becomes of an error.

Exit status: 0 done; 1 it could not be done, the message says why; 2 the command line is wrong;
130 stopped by Ctrl-C or a signal, everything kept.
"""

from __future__ import annotations

import sys
from importlib import metadata
from typing import Annotated

import typer

from acquire.cli import (
    bench,
    calibrating,
    capturing,
    devices,
    packing,
    processing,
    results,
    verifying,
)
from acquire.errors import LumisplitError
from drivers.errors import DriverError

INTERRUPTED = 130

app = typer.Typer(
    name="lumisplit",
    help="Takes the light in a scene apart: direct reflection, subsurface scattering, "
    "inter-reflection.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
capturing.register(app)
verifying.register(app)
bench.register(app)
processing.register(app)
packing.register(app)
results.register(app)
devices.register(app)
calibrating.register(app)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"lumisplit {metadata.version('lumisplit')}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line; a foreseeable error is one message, not a traceback."""
    try:
        app()
    except (LumisplitError, DriverError) as error:
        typer.echo(f"lumisplit: {error}", err=True)
        sys.exit(1)
    except KeyboardInterrupt:
        typer.echo("lumisplit: interrupted", err=True)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
