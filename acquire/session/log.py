"""log.jsonl: what a person should know of a capture and the frames themselves do not tell."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from enum import StrEnum
from pathlib import Path

from pydantic import Field, ValidationError

from acquire.errors import SessionError, StorageError
from acquire.plan import MAX_STEPS
from acquire.session.folder import append_durably, read_plain, storage, whole_bytes
from acquire.validation import StrictModel, explain

LOG = "log.jsonl"
MAX_BYTES = 64 << 20
MAX_TEXT = 2000


class Kind(StrEnum):
    """What a note is about."""

    SUSPECT = "suspect"  # to be judged, and where it is wrong taken again
    RETAKE = "retake"
    TIMEOUT = "timeout"
    SUSPENSION = "suspension"
    REPAIR = "repair"
    WARNING = "warning"
    END = "end"  # why a run ended, where its record could not be written


class Note(StrictModel):
    """One line: when, by the bench's clock; what; at which step of the plan, where it is of one."""

    time_s: float
    kind: Kind
    step: int | None = Field(default=None, ge=0, lt=MAX_STEPS)
    text: str = Field(max_length=MAX_TEXT)


def append_note(folder: Path, note: Note) -> None:
    """Append a line; a disk that does not take it does not stop the capture by that."""
    with suppress(StorageError):
        append_durably(folder / LOG, note.model_dump_json().encode() + b"\n", make=True)


def recover_notes(folder: Path) -> None:
    """Cut off what a power cut left unfinished."""
    path = folder / LOG
    if not path.exists():
        return
    end = whole_bytes(read_plain(path, MAX_BYTES))
    with storage(path), path.open("rb+") as file:
        file.truncate(end)


def read_notes(folder: Path) -> Iterator[Note]:
    """All lines in order; raises `SessionError` for one that cannot be used."""
    path = folder / LOG
    with storage(path):
        if not path.exists():
            return
    content = read_plain(path, MAX_BYTES)
    for number, line in enumerate(content[: whole_bytes(content)].split(b"\n")[:-1], 1):
        try:
            yield Note.model_validate_json(line)
        except ValidationError as error:
            raise SessionError(f"Cannot use line {number} of {path}:\n{explain(error)}") from error
