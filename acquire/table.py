"""A stack that somebody else captured becomes a session.

Everything is checked before anything is written: the table, that every file is a plain one in
the table's folder, and that all are pictures of one kind and size. The files are then copied
byte for byte, with the same care for the disk as in a capture; when that was interrupted, the
same command goes on.
"""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from acquire.errors import SessionError, StackError, StorageError
from acquire.frames import decode_frame
from acquire.import_notes import import_notes
from acquire.plan import Plan
from acquire.session import FrameRecord, Session, SessionRecord, SourceRecord, Transfer
from acquire.session.folder import read_plain
from acquire.session.records import MAX_FRAME_BYTES, frame_path, host, versions
from acquire.session.recovery import recover
from acquire.storage import check_room
from acquire.table_file import Row, Table, read_table, refuse
from drivers.errors import DecodeError
from drivers.media import PICTURE_TYPES, media_type
from drivers.picture import decode_picture
from drivers.picture_header import read_header
from drivers.raw import decode_raw
from processing.frames.frame_noise import lattice, ordered
from processing.patterns import Family

TransferChoice: TypeAlias = Literal["auto", "srgb", "linear"]
# Pitches whose frames tell whether they are extrema.
_LOOKED_AT = 3


class Observer(Protocol):
    """Hears of the import as it goes on."""

    def stage(self, name: str, total: int) -> None:
        """A stage of `total` frames begins."""

    def advance(self) -> None:
        """One frame of the stage is done."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """What all frames of a stack have in common."""

    media_type: str
    height: int
    width: int
    channels: int
    dtype: str
    profile: str | None = field(compare=False)

    def __str__(self) -> str:
        return (
            f"{self.media_type} {self.dtype}, {self.channels} channel(s), "
            f"{self.width} × {self.height} px"
        )


@dataclass(frozen=True, slots=True)
class _Frame:
    row: Row
    path: Path
    sha256: str
    size_bytes: int
    kind: _Kind


def import_table(
    table: Path, out: Path, *, transfer: TransferChoice = "auto", progress: Observer
) -> Session:
    """Make a session of the frames that a table lists.

    Parameters
    ----------
    table
        CSV with the columns file, role, pattern, pitch_px, shift_y_px and shift_x_px.
    out
        Folder of the session: new or empty, or left by the same import when it was interrupted.
    transfer
        How the numbers of rendered pictures relate to light; ``auto`` takes 8-bit pictures as
        sRGB and all others as linear.
    progress
        Told of every frame.

    Raises
    ------
    StackError
        The table or its files cannot be used; nothing was written.
    SessionError
        `out` holds something else.
    StorageError
        The disk does not take a frame; the session stays whole.
    """
    listed = read_table(table)
    frames = _inspect(listed, progress)
    kind = frames[0].kind
    chosen = _transfer(kind, transfer)
    plan = Plan(patterns=tuple(row.pattern for row in listed.rows))
    notes = import_notes(
        listed.rows,
        chosen,
        kind.media_type,
        kind.dtype,
        kind.profile,
        extrema=_are_extrema(frames, chosen),
    )
    record = SessionRecord(
        plan_sha256=plan.sha256,
        bench={"kind": "import"},
        source=SourceRecord(
            table=table.name, table_sha256=listed.sha256, transfer=chosen, notes=notes
        ),
        versions=versions(),
        host=host(),
    )
    if not Session.exists(out):
        check_room(out, sum(frame.size_bytes for frame in frames))
    with Session.locked(out):
        session = _resumed(out, record, frames) or Session.create(out, plan, record)
        if not session.complete:
            _copy(session, frames, progress)
    return session


def _inspect(table: Table, progress: Observer) -> list[_Frame]:
    """Check every file; nothing but the digest and the kind of a frame is kept."""
    progress.stage("checking", len(table.rows))
    frames, problems = [], []
    folder = table.path.resolve().parent
    for row in table.rows:
        try:
            frames.append(_inspected(folder, row))
        except (StackError, SessionError, DecodeError) as error:
            problems.append(f"line {row.line}, column file: {row.file!r}: {error}")
        progress.advance()
    refuse(table.path, problems)
    usual, _ = Counter(frame.kind for frame in frames).most_common(1)[0]
    example = next(frame for frame in frames if frame.kind == usual)
    refuse(
        table.path,
        (
            f"line {frame.row.line}, column file: {frame.row.file!r} is {frame.kind}, but "
            f"{example.row.file!r} (line {example.row.line}) is {usual}; all frames of a stack "
            "come from one camera, in one format and size"
            for frame in frames
            if frame.kind != usual
        ),
    )
    return frames


def _inspected(folder: Path, row: Row) -> _Frame:
    path = _located(folder, row.file)
    data = read_plain(path, MAX_FRAME_BYTES)
    return _Frame(row, path, hashlib.sha256(data).hexdigest(), len(data), _kind(data))


def _located(folder: Path, name: str) -> Path:
    """The plain file inside `folder` that a table names; nothing outside can be named."""
    outside = StackError(
        "it lies outside the table's folder; put the table beside its pictures and name them "
        "relative to it"
    )
    written = PurePosixPath(name), PureWindowsPath(name)
    if any(path.is_absolute() or path.anchor or ".." in path.parts for path in written):
        raise outside
    try:
        path = (folder / name).resolve(strict=True)
    except FileNotFoundError:
        hint = ", with / between folders" if "\\" in name else ""
        raise StackError(
            f"there is no such file; names are relative to the table's folder{hint}"
        ) from None
    except (OSError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "its links run in a circle"
        raise StackError(f"it cannot be read: {reason}") from error
    if not path.is_relative_to(folder):
        raise outside
    if not path.is_file():
        raise StackError("it is not a plain file; name a picture or raw file")
    return path


def _kind(data: bytes) -> _Kind:
    """Kind and size from the header; raws are decoded, for their headers promise too much."""
    name = media_type(data)
    if name not in PICTURE_TYPES:
        height, width = decode_raw(data).saturated.shape
        return _Kind(name, height, width, 1, "raw", None)
    header = read_header(data)
    if header.has_alpha:
        decode_picture(data, "linear")
    return _Kind(name, header.height, header.width, header.channels, header.dtype, header.profile)


def _transfer(kind: _Kind, wanted: TransferChoice) -> Transfer:
    if kind.dtype == "raw":
        if wanted == "srgb":
            raise StackError(
                "--transfer srgb: the files are raw and linear as they are; leave it out."
            )
        return Transfer.RAW
    if wanted == "srgb" and kind.dtype.startswith("float"):
        raise StackError(
            "--transfer srgb: the pictures are floating point, which is linear; leave it out."
        )
    if wanted == "auto":
        return Transfer.SRGB if kind.dtype == "uint8" else Transfer.LINEAR
    return Transfer(wanted)


def _are_extrema(frames: list[_Frame], transfer: Transfer) -> bool:
    """Whether every pitch has two frames of which one is nowhere darker than the other.

    The frames of the coarsest pitches are looked at, which optics resolve: where they do not, two
    positions of a pattern differ by little but light and noise.
    """
    pairs: dict[tuple[Family, int], list[_Frame]] = {}
    for frame in frames:
        pattern = frame.row.pattern
        if not pattern.family.is_reference:
            pairs.setdefault((pattern.family, pattern.pitch_px), []).append(frame)
    if not all(len(pair) == 2 and family.is_binary for (family, _), pair in pairs.items()):
        return False
    coarsest = sorted(pairs, key=lambda key: -key[1])[:_LOOKED_AT]
    return all(ordered(*(_some(frame, transfer) for frame in pairs[key])) for key in coarsest)


def _some(frame: _Frame, transfer: Transfer) -> NDArray[np.float32]:
    """Light of some thousand pixels."""
    data = read_plain(frame.path, MAX_FRAME_BYTES)
    try:
        values = decode_frame(data, frame.kind.media_type, transfer).values
    except DecodeError as error:
        raise StackError(f"{frame.path}: {error}") from error
    return values[lattice(values.shape[:2])]


def _resumed(out: Path, record: SessionRecord, frames: list[_Frame]) -> Session | None:
    """The session that an interrupted import of the same table and files left in `out`."""
    if not Session.exists(out):
        return None
    session = Session.open(out)
    digests = [frame.sha256 for frame in frames[: len(session.frames)]]
    same_files = digests == [frame.sha256 for frame in session.frames]
    if _origin(session.record) != _origin(record) or not same_files:
        raise SessionError(
            f"{out} holds another session, or files of this one have changed since; nothing was "
            "written. Give another --out."
        )
    recover(session)
    return session


def _origin(record: SessionRecord) -> tuple[str, Transfer] | None:
    source = record.source
    return None if source is None else (source.table_sha256, source.transfer)


def _copy(session: Session, frames: list[_Frame], progress: Observer) -> None:
    progress.stage("copying", len(frames) - len(session.frames))
    session.begin_run(time.time())
    try:
        for step in range(len(session.frames), len(frames)):
            _store(session, step, frames[step])
            progress.advance()
    except BaseException as error:
        stopped = isinstance(error, KeyboardInterrupt)
        with suppress(StorageError):
            session.end_run(time.time(), "stopped" if stopped else "failed", str(error))
        raise
    session.end_run(time.time(), "complete")


def _store(session: Session, step: int, frame: _Frame) -> None:
    data = read_plain(frame.path, MAX_FRAME_BYTES)
    if hashlib.sha256(data).hexdigest() != frame.sha256:
        raise StackError(
            f"{frame.path} changed while it was imported; let nothing else write there, and give "
            "the same command again."
        )
    line = FrameRecord(
        step=step,
        pattern=frame.row.pattern,
        settings=None,
        raster_sha256=None,
        file=frame_path(step, frame.kind.media_type),
        sha256=frame.sha256,
        size_bytes=frame.size_bytes,
        media_type=frame.kind.media_type,
        started_s=None,
        finished_s=None,
    )
    session.store(line, data)
