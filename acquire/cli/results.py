"""Commands that make files for people and other programs out of a result."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from acquire.tone import Tone

ResultFolder = Annotated[Path, typer.Argument(metavar="RESULT")]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("remix")(remix_command)
    app.command("export")(export_command)


def remix_command(
    folder: ResultFolder,
    out: Annotated[
        Path, typer.Option(help="FILE.tiff: float32, linear. FILE.png: 8 bits, for a screen.")
    ],
    gain: Annotated[
        list[str] | None,
        typer.Option(metavar="COMPONENT=NUMBER", help="Repeat for each; others are 0."),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            help="as-captured, direct-only, no-interreflection or scattering-x2, "
            "where the components exist; --gain then changes it."
        ),
    ] = None,
    exposure: Annotated[
        float,
        typer.Option(min=-20, max=20, help="Of a PNG: stops beyond the report's exposure."),
    ] = 0.0,
    tone: Annotated[
        Tone, typer.Option(help="Of a PNG: srgb clips highlights, soft keeps them.")
    ] = Tone.SRGB,
) -> None:
    """Mix the components of a result with other gains, at full resolution."""
    from acquire.remix import gains_for, write_mix
    from acquire.result import Result

    result = Result.open(folder)
    names = result.record.components
    gains = gains_for(names, preset, _gains(gain or []))
    write_mix(result, gains, out, exposure, tone)
    terms = (f"{number:g} × {name}" for name, number in zip(names, gains, strict=True))
    typer.echo(f"{' + '.join(terms)}: {out}")


def export_command(
    folder: ResultFolder,
    to: Annotated[
        str, typer.Option(help="exr, mat, npz or hdf5: linear float32; png: 16 bits, for looking.")
    ],
    out: Annotated[
        Path,
        typer.Option(help="The file; the folder for png, and for exr with --pitches."),
    ],
    pitches: Annotated[
        bool,
        typer.Option(
            "--pitches",
            help="Direct and global light at every pitch, and their standard errors, in place of "
            "the components.",
        ),
    ] = False,
) -> None:
    """Write components, errors, white light and mask for other programs."""
    from acquire.export import Format, export
    from acquire.result import Result

    if to not in list(Format):
        raise typer.BadParameter(f"--to {to}: there are {', '.join(Format)}.")
    for path in export(Result.open(folder), Format(to), out, pitches=pitches):
        typer.echo(path)


def _gains(words: list[str]) -> dict[str, float]:
    gains: dict[str, float] = {}
    for word in words:
        name, equals, number = word.partition("=")
        try:
            value = float(number)
        except ValueError:
            equals = ""
            value = 0.0
        if not equals:
            raise typer.BadParameter(f"{word!r} is not COMPONENT=NUMBER, like direct=0.5.")
        if name in gains:
            raise typer.BadParameter(f"{name} has two gains; give one.")
        gains[name] = value
    return gains
