"""A table of frames as somebody else wrote it: CSV, checked line by line."""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from acquire.errors import StackError
from acquire.plan import MAX_STEPS
from processing.patterns import Family, Pattern

COLUMNS = ("file", "role", "pattern", "pitch_px", "shift_y_px", "shift_x_px")
ROLES = ("white", "black", "pattern")
MAX_TABLE_BYTES = 32 << 20
MAX_PX = 100_000
MAX_SHOWN = 5
# Spreadsheets write a column of whole numbers with gaps as 8.0.
WHOLE = re.compile(r"[0-9]{1,9}(\.0*)?")


@dataclass(frozen=True, slots=True)
class Row:
    """One frame of a table: the line it stands on, its file as written and what it shows."""

    line: int
    file: str
    pattern: Pattern


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose every line is sound, with the digest of its bytes."""

    path: Path
    sha256: str
    rows: tuple[Row, ...]


def read_table(path: Path) -> Table:
    """Read a table; raises `StackError` naming lines, columns and values."""
    data = _content(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise StackError(
            f"{path} is not text in UTF-8 (byte {error.start}); save it as CSV, UTF-8."
        ) from error
    try:
        return Table(path, hashlib.sha256(data).hexdigest(), _rows(path, text))
    except csv.Error as error:
        raise StackError(f"{path} is not valid CSV: {error}.") from error


def refuse(path: Path, problems: Iterable[str]) -> None:
    """Raise one `StackError` for all problems, if there are any; the first few are listed."""
    found = list(problems)
    if found:
        left_out = len(found) - MAX_SHOWN
        more = [f"and {left_out} more"] if left_out > 0 else []
        lines = "\n  ".join([*found[:MAX_SHOWN], *more])
        raise StackError(f"{path} cannot be imported; nothing was written:\n  {lines}")


def _content(path: Path) -> bytes:
    try:
        if not path.is_file():
            why = "it is not a plain file" if path.exists() else "there is no such file"
            raise StackError(f"Cannot read the table {path}: {why}.")
        size_bytes = path.stat().st_size
        if size_bytes > MAX_TABLE_BYTES:
            raise StackError(
                f"Refused {path}: {size_bytes} bytes, no table of frames is that long."
            )
        return path.read_bytes()
    except OSError as error:
        raise StackError(f"Cannot read the table {path}: {error.strerror}.") from error


def _rows(path: Path, text: str) -> tuple[Row, ...]:
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    columns = [name.strip().lower() for name in next(reader, [])]
    _check_header(path, columns)
    rows: list[Row] = []
    problems: list[str] = []
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if len(rows) + len(problems) == MAX_STEPS:
            raise StackError(f"{path} has more than {MAX_STEPS} frames.")
        try:
            rows.append(_row(reader.line_num, columns, cells))
        except ValueError as error:
            problems.append(f"line {reader.line_num}, {error}")
    refuse(path, problems)
    refuse(path, [*_repetitions(rows), *_unmeasurable(rows)])
    return tuple(rows)


def _check_header(path: Path, columns: list[str]) -> None:
    wanted = ",".join(COLUMNS)
    missing = [name for name in COLUMNS if name not in columns]
    if missing:
        separators = any(mark in "".join(columns) for mark in ";\t")
        hint = " Columns are separated by commas." if separators else ""
        raise StackError(
            f"{path}, line 1: the header lacks {', '.join(missing)}; it must name the columns "
            f"{wanted}, in any order.{hint}"
        )
    twice = [name for name in COLUMNS if columns.count(name) > 1]
    if twice:
        raise StackError(f"{path}, line 1: the header names {', '.join(twice)} more than once.")


def _row(line: int, columns: list[str], cells: list[str]) -> Row:
    if len(cells) > len(columns):
        raise ValueError(
            f"{len(cells)} values for {len(columns)} columns: put quotes around a comma in a name"
        )
    values = dict.fromkeys(COLUMNS, "") | dict(
        zip(columns, (cell.strip() for cell in cells), strict=False)
    )
    role = values["role"].lower()
    if role not in ROLES:
        raise ValueError(f"column role: {values['role']!r} is unknown; use {', '.join(ROLES)}")
    if not values["file"] or not values["file"].isprintable():
        raise ValueError(f"column file: {values['file']!r} names no file")
    pattern = _shown(values) if role == "pattern" else _reference(role, values)
    return Row(line, values["file"], pattern)


def _reference(role: str, values: dict[str, str]) -> Pattern:
    if values["pattern"].lower() not in {"", role}:
        raise ValueError(
            f"column pattern: a {role} frame shows no pattern, but {values['pattern']!r} is "
            "given; leave it empty or set role to pattern"
        )
    for name in COLUMNS[3:]:
        if _whole(name, values[name]):
            raise ValueError(
                f"column {name}: a {role} frame has neither pitch nor shift, but {values[name]!r} "
                "is given; leave it empty or set role to pattern"
            )
    return Pattern(Family(role))


def _shown(values: dict[str, str]) -> Pattern:
    families = [family.value for family in Family if family.is_separable]
    name = values["pattern"].lower()
    if name not in families:
        raise ValueError(
            f"column pattern: {values['pattern']!r} is unknown; use {', '.join(families)}"
        )
    family = Family(name)
    pitch_px = _whole("pitch_px", values["pitch_px"])
    if pitch_px < 1:
        raise ValueError(
            f"column pitch_px: {values['pitch_px']!r}; a pattern needs its pitch in projector "
            f"pixels, 1 to {MAX_PX}"
        )
    down, right = (_whole(name, values[name]) for name in COLUMNS[4:])
    if down and not family.varies_down:
        raise ValueError(f"column shift_y_px: {family} does not vary down; {down} must be 0")
    if right and not family.varies_right:
        raise ValueError(
            f"column shift_x_px: {family} does not vary to the right; {right} must be 0"
        )
    return Pattern(family, pitch_px, down, right)


def _whole(column: str, text: str) -> int:
    if not text:
        return 0
    number = int(text.partition(".")[0]) if WHOLE.fullmatch(text) else MAX_PX + 1
    if number > MAX_PX:
        raise ValueError(
            f"column {column}: {text!r} is not a whole number of projector pixels, 0 to {MAX_PX}"
        )
    return number


def _repetitions(rows: list[Row]) -> Iterable[str]:
    files: dict[PurePosixPath, int] = {}
    patterns: dict[Pattern, int] = {}
    for row in rows:
        first = files.setdefault(PurePosixPath(row.file), row.line)
        if first != row.line:
            yield f"line {row.line}, column file: {row.file!r} stands on line {first} already"
        if row.pattern.family.is_reference:
            continue
        first = patterns.setdefault(row.pattern, row.line)
        if first != row.line:
            yield (
                f"line {row.line}: {row.pattern} stands on line {first} already; "
                "keep one of the two frames, or correct the shift"
            )


def by_pitch(rows: Iterable[Row]) -> dict[tuple[Family, int], list[Row]]:
    """Rows with a pattern, by its family and pitch, in the order of the table."""
    groups: dict[tuple[Family, int], list[Row]] = {}
    for row in rows:
        if not row.pattern.family.is_reference:
            groups.setdefault((row.pattern.family, row.pattern.pitch_px), []).append(row)
    return groups


def _unmeasurable(rows: list[Row]) -> Iterable[str]:
    groups = by_pitch(rows)
    if not groups:
        yield "there is no line with role pattern: direct and global light need shifted patterns"
    for (family, pitch_px), members in groups.items():
        needed = 2 if family.is_binary else 3
        forms = len({_form(row.pattern) for row in members})
        if forms < needed:
            lines = ", ".join(str(row.line) for row in members[:MAX_SHOWN])
            yield (
                f"line {lines}: {family} at pitch {pitch_px} has {forms} different shift(s), and "
                f"{needed} are the least that can be measured; add frames at other shifts within "
                f"2 pitches ({2 * pitch_px} px), or leave this pitch out"
            )


def _form(pattern: Pattern) -> tuple[int, ...]:
    """What tells patterns of one family and pitch apart: shifts repeat after two pitches."""
    pitch_px = pattern.pitch_px
    if pattern.family is not Family.CHECKER:
        return ((pattern.shift_y_px + pattern.shift_x_px) % (2 * pitch_px),)
    down, right = divmod(pattern.shift_y_px, pitch_px), divmod(pattern.shift_x_px, pitch_px)
    return (down[1], right[1], (down[0] + right[0]) % 2)
