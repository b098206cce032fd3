"""Every setting and version that is needed to do it again, as rows of text."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from pydantic import JsonValue

from acquire.result import ResultRecord, SessionSummary
from acquire.session.records import RunRecord, Transfer

NOT_SET = "–"
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
FLAGS = {
    "method": "--method",
    "n_components": "--components",
    "n_iterations": "--iterations",
    "smoothing_px": "--smoothing-px",
    "leak": "--leak",
    "demosaic": "--demosaic",
}


@dataclass(frozen=True, slots=True)
class Command:
    """A line for the shell and what it does."""

    line: str
    purpose: str


@dataclass(frozen=True, slots=True)
class PatternRow:
    """The pitches of one family that have the same number of shifts."""

    family: str
    pitches_px: str
    shifts: int


@dataclass(frozen=True, slots=True)
class RunRow:
    """One start of the capture in words."""

    started: str
    duration: str
    first_step: int
    outcome: str
    reason: str


@dataclass(frozen=True, slots=True)
class VersionRow:
    """A piece of software when the frames were captured and when they were processed."""

    name: str
    captured: str
    processed: str


Rows = tuple[tuple[str, str], ...]


def commands(record: ResultRecord) -> tuple[Command, ...]:
    """The command lines that lead to this result again."""
    return (
        _first_command(record.session),
        Command("lumisplit verify SESSION", "every file against its digest"),
        Command(
            f"lumisplit process SESSION --out RESULT {_flags(record)}",
            "from the frames to the components",
        ),
        Command("lumisplit report RESULT", "this page"),
    )


def _first_command(session: SessionSummary) -> Command:
    source = session.source
    if source is not None:
        transfer = "auto" if source.transfer is Transfer.RAW else source.transfer.value
        line = f"lumisplit import {shlex.quote(source.table)} --transfer {transfer} --out SESSION"
        return Command(line, "the table of frames")
    replayed = session.bench.get("kind") == "replay"
    bench = "replay:RECORDING" if replayed else "BENCH.toml"
    return Command(
        f"lumisplit capture PLAN.toml --out SESSION --bench {bench}",
        "plan and bench as below; SESSION/plan.json lists every exposure",
    )


def _flags(record: ResultRecord) -> str:
    values: dict[str, JsonValue] = {
        "method": record.method,
        "n_components": len(record.components),
        **record.options,
    }
    given = ((flag, values.get(option)) for option, flag in FLAGS.items())
    words = [f"{flag} {shlex.quote(_text(value))}" for flag, value in given if value is not None]
    if values.get("drift_correction") is False:
        words.append("--no-drift-correction")
    if record.session.source is not None:
        words += [
            f"--no-{what}-correction"
            for what in ("gain", "tone")
            if values.get(f"{what}_correction") is False
        ]
    return " ".join(words)


def bench_toml(bench: Mapping[str, JsonValue]) -> str:
    """The bench as a TOML file; what is not set is left out."""
    leaves = _leaves(bench, ())
    return "".join(
        f"{'.'.join(map(_key, path))} = {json.dumps(value, ensure_ascii=False)}\n"
        for path, value in leaves
        if value is not None
    )


def _key(name: str) -> str:
    return name if BARE_KEY.fullmatch(name) else json.dumps(name, ensure_ascii=False)


def _leaves(
    tree: Mapping[str, JsonValue], above: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], JsonValue]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*above, key))
        else:
            yield (*above, key), value


def _text(value: JsonValue) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _option_rows(options: Mapping[str, JsonValue]) -> Iterator[tuple[str, str]]:
    own = {name: value for name, value in options.items() if name != "profiles"}
    for path, value in _leaves(own, ()):
        yield f"option {'.'.join(path)}", NOT_SET if value is None else _text(value)


def processing_rows(record: ResultRecord, record_sha256: str) -> Rows:
    """The method, its options, what it was applied to and the digest of result.json."""
    height, width = record.shape
    return (
        ("method", record.method),
        *_option_rows(record.options),
        ("components", ", ".join(record.components)),
        ("image", f"{width} × {height} px"),
        ("noise", NOT_SET if record.noise is None else f"{record.noise:.3g}"),
        ("digest of result.json", record_sha256),
        ("digest of plan.json", record.plan_sha256),
    )


def capture_rows(session: SessionSummary) -> Rows:
    """How the frames were exposed and shown."""
    if session.source is not None:
        return (("frames", str(session.frames)), ("exposure and settling", "unknown: imported"))
    camera, projector = session.camera, session.projector
    resolution = projector.resolution_px
    return (
        ("frames", str(session.frames)),
        ("camera.exposure_s", f"{camera.exposure_s:g}"),
        ("camera.aperture", NOT_SET if camera.aperture is None else f"{camera.aperture:g}"),
        ("camera.iso", NOT_SET if camera.iso is None else str(camera.iso)),
        ("camera.retries", str(camera.retries)),
        ("projector.settle_s", f"{projector.settle_s:g}"),
        ("projector.gamma", f"{projector.gamma:g}"),
        ("projector.resolution_px", "any" if resolution is None else str(list(resolution))),
    )


def profile_rows(record: ResultRecord) -> Rows:
    """Kind and digest of every calibration profile that changed the processing.

    Results from before profiles were summed up have nothing else of them.
    """
    used = record.options.get("profiles")
    if not isinstance(used, dict):
        return ()
    told = {profile.sha256 for profile in record.profiles}
    return tuple((kind, _text(digest)) for kind, digest in used.items() if digest not in told)


def pattern_rows(record: ResultRecord) -> tuple[PatternRow, ...]:
    """Families, their pitches and the number of shifts of each."""
    groups: dict[tuple[str, int], list[int]] = {}
    for pitch in record.pitches:
        groups.setdefault((pitch.family.value, pitch.shifts), []).append(pitch.pitch_px)
    return tuple(
        PatternRow(family, ", ".join(map(str, pitches)), shifts)
        for (family, shifts), pitches in groups.items()
    )


def source_rows(session: SessionSummary) -> Rows:
    """Where imported frames came from; nothing for frames that were captured."""
    source = session.source
    if source is None:
        return ()
    return (
        ("table", source.table),
        ("digest of the table", source.table_sha256),
        ("transfer curve", source.transfer.value),
    )


def run_row(run: RunRecord) -> RunRow:
    """One start of the capture."""
    seconds = None if run.finished_s is None else run.finished_s - run.started_s
    return RunRow(
        started=_moment(run.started_s),
        duration=NOT_SET if seconds is None else f"{seconds:.0f} s",
        first_step=run.first_step,
        outcome=run.outcome,
        reason=run.reason,
    )


def _moment(since_epoch_s: float) -> str:
    try:
        return f"{datetime.fromtimestamp(since_epoch_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (OverflowError, ValueError, OSError):
        return f"{since_epoch_s:g} s after 1970-01-01 UTC"


def version_rows(record: ResultRecord) -> tuple[VersionRow, ...]:
    """Versions, each name once."""
    captured, processed = record.session.versions, record.versions
    return tuple(
        VersionRow(name, captured.get(name, NOT_SET), processed.get(name, NOT_SET))
        for name in dict.fromkeys((*processed, *captured))
    )
