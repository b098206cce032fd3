"""A session opened for reading or for appending."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import disk_usage
from typing import TypeVar

from filelock import FileLock, Timeout
from pydantic import BaseModel, JsonValue, ValidationError

from acquire.errors import SessionError
from acquire.plan import Plan
from acquire.session.folder import (
    append_durably,
    read_plain,
    storage,
    sync_folder,
    whole_bytes,
    write_durably,
)
from acquire.session.log import Kind, read_notes
from acquire.session.records import CAMERA_BODY, FrameRecord, RunRecord, SessionRecord
from acquire.validation import explain

MAX_JSON_BYTES = 32 << 20
MAX_LINE_BYTES = 4096
MAX_LINES_A_STEP = 4
MAX_SIDE = 65_536
ModelT = TypeVar("ModelT", bound=BaseModel)
PLAN, RECORD, LINES, FRAMES = "plan.json", "session.json", "frames.jsonl", "frames"
PROOF = "proof.jsonl"
PROFILES = "profiles"
LOCK = ".lock"
INTERRUPTED = "It ended without a word: the power failed, or the program was killed."
FILLED = (
    "It ended without a word: the power failed, the program was killed, or its disk filled up so "
    "far that not even that could be written. The disk is full now: make room."
)
FULL_BYTES = 64 << 10


class Session:
    """A session folder whose plan, record and lines are consistent with each other.

    The first line of step k comes after that of step k − 1. A later line of the same step takes
    its place: `frames` holds the line that counts for each step, in order, and the next step to
    capture is their number; `lines` holds all of them, in the order of the exposures.
    """

    def __init__(self, folder: Path, plan: Plan, record: SessionRecord) -> None:
        self.folder = folder
        self.plan = plan
        self.record = record
        self.frames: list[FrameRecord] = []
        self.lines: list[FrameRecord] = []
        self._orders: dict[tuple[int, int], int] = {}

    @classmethod
    def create(cls, folder: Path, plan: Plan, record: SessionRecord) -> Session:
        """Start a session in a folder that is empty or does not exist; hold its lock."""
        _check_blank(folder)
        with storage(folder):
            (folder / FRAMES).mkdir(parents=True, exist_ok=True)
            (folder / LINES).touch()
        write_durably(folder / PLAN, plan.to_json().encode())
        write_durably(folder / RECORD, _json(record))
        sync_folder(folder.absolute().parent)
        return cls(folder, plan, record)

    @classmethod
    def exists(cls, folder: Path) -> bool:
        """Whether the folder holds a session (its record is written last)."""
        with storage(folder):
            return (folder / RECORD).exists()

    @classmethod
    def open(cls, folder: Path) -> Session:
        """Open what is there; raises `SessionError` when it cannot be trusted."""
        with storage(folder):
            there = folder.is_dir()
        if not there:
            raise SessionError(f"There is no session at {folder}: no such folder.")
        if not cls.exists(folder):
            raise SessionError(f"{folder} is not a session: it has no {RECORD}.")
        if (folder / FRAMES).is_symlink() or not (folder / FRAMES).is_dir():
            raise SessionError(f"{folder} is damaged: {FRAMES} is not a folder of its own.")
        record = _parse(SessionRecord, folder / RECORD)
        plan = _parse(Plan, folder / PLAN)
        if plan.sha256 != record.plan_sha256:
            raise SessionError(
                f"{folder / PLAN} was changed after the capture began: its digest is not the one "
                f"that {RECORD} holds. Restore it from a copy."
            )
        session = cls(folder, plan, record)
        for line in session.complete_lines():
            session._accept(line)
        return session

    @staticmethod
    @contextmanager
    def locked(folder: Path) -> Iterator[None]:
        """Hold a folder for writing a session; refuses when another process has it."""
        if not Session.exists(folder):
            _check_blank(folder)
        with storage(folder):
            folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK)
        with storage(folder / LOCK):
            try:
                lock.acquire(timeout=0)
            except Timeout as error:
                raise SessionError(
                    f"Another lumisplit is writing to {folder}. Wait for it or stop it."
                ) from error
            except NotImplementedError as error:
                raise SessionError(
                    f"The disk of {folder} cannot keep two programs from writing at once (it has "
                    "no locks). Capture onto another disk and copy the session afterwards."
                ) from error
        try:
            yield
        finally:
            lock.release()

    @property
    def is_being_written(self) -> bool:
        """Whether another process captures into it now, as far as the system tells."""
        if not (self.folder / LOCK).exists():
            return False
        lock = FileLock(self.folder / LOCK)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            return True
        except (OSError, NotImplementedError):
            return False
        lock.release()
        return False

    def forget(self, count: int) -> None:
        """Drop the last lines and their files; the frames that they replaced count again."""
        kept, dropped = self.lines[:-count], self.lines[-count:]
        with storage(self.folder), (self.folder / LINES).open("rb+") as file:
            file.truncate(sum(map(len, self.complete_lines()[: len(kept)])))
        for frame in dropped:
            with storage(self.folder):
                (self.folder / frame.file).unlink(missing_ok=True)
        self.lines, self.frames, self._orders = [], [], {}
        for frame in kept:
            self._take_in(frame)

    def store(self, record: FrameRecord, data: bytes) -> None:
        """Keep a frame: the file first, then, when that is on the disk, its line."""
        path = self.folder / record.file
        write_durably(path, data)
        append_durably(self.folder / LINES, record.to_line())
        self._take_in(record)

    def begin_run(self, started_s: float) -> None:
        """Note that a capture starts here and goes on from the lines that are there."""
        run = RunRecord(started_s=started_s, first_step=len(self.frames))
        before = self.record.runs
        if before and before[-1].outcome == "running":
            broken = {"outcome": "interrupted", "reason": self.unsaid_end}
            before = (*before[:-1], before[-1].model_copy(update=broken))
        self._rewrite(runs=(*before, run))

    def end_run(self, finished_s: float, outcome: str, reason: str = "") -> None:
        """Note how the run that was begun last has ended."""
        *before, last = self.record.runs
        ended = RunRecord.model_validate(
            last.model_dump()
            | {"finished_s": finished_s, "outcome": outcome, "reason": reason[:2000]}
        )
        self._rewrite(runs=(*before, ended))

    def know_camera(self, body: str) -> None:
        """Note which camera takes the frames; raises `SessionError` if another one took some."""
        known = self.record.bench.get(CAMERA_BODY)
        if known is None:
            self._rewrite(bench=self.record.bench | {CAMERA_BODY: body})
        elif known != body:
            raise SessionError(
                f"{self.folder} was begun with the camera {known}, this is {body}; a session is "
                "captured with one. Connect that camera, or give another --out."
            )

    @property
    def unsaid_end(self) -> str:
        """Why the last run ended, where its record does not say."""
        started_s = self.record.runs[-1].started_s
        ends = (note for note in read_notes(self.folder) if note.kind is Kind.END)
        said = [note.text for note in ends if note.time_s >= started_s]
        if said:
            return said[-1]
        with storage(self.folder):
            return FILLED if disk_usage(self.folder).free < FULL_BYTES else INTERRUPTED

    def order(self, frame: FrameRecord) -> int:
        """Place of a frame among all exposures, those included that were taken again."""
        return self._orders[frame.step, frame.attempt]

    def read(self, frame: FrameRecord) -> bytes:
        """The camera's bytes of a frame, checked against their digest."""
        path = self.folder / frame.file
        data = read_plain(path, frame.size_bytes)
        if len(data) != frame.size_bytes or hashlib.sha256(data).hexdigest() != frame.sha256:
            raise SessionError(
                f"{path} is not the file that was captured: its digest differs. "
                f"`lumisplit verify {self.folder}` lists everything that is wrong."
            )
        return data

    def complete_lines(self) -> list[bytes]:
        """Lines of frames.jsonl that are whole; a crash can leave one that is not."""
        content = read_plain(
            self.folder / LINES, MAX_LINES_A_STEP * (len(self.plan) + 1) * MAX_LINE_BYTES
        )
        return [line + b"\n" for line in content[: whole_bytes(content)].split(b"\n")[:-1]]

    @property
    def projector_px(self) -> tuple[int, int] | None:
        """(height, width) of the projector; None where it was not recorded."""
        size = self.record.bench.get("projector_px")
        match size:
            case [int(height), int(width)] if 0 < height <= MAX_SIDE and 0 < width <= MAX_SIDE:
                return height, width
        return None

    @property
    def complete(self) -> bool:
        """Whether every step of the plan has its frame."""
        return len(self.frames) == len(self.plan)

    def _accept(self, line: bytes) -> None:
        where = f"line {len(self.lines) + 1} of {self.folder / LINES}"
        if len(line) > MAX_LINE_BYTES:
            raise SessionError(f"Refused {where}: {len(line)} bytes long.")
        try:
            frame = FrameRecord.model_validate_json(line)
        except ValidationError as error:
            raise SessionError(f"Cannot use {where}:\n{explain(error)}") from error
        number = len(self.frames)
        known = frame.step < number
        if not known and (frame.step != number or number >= len(self.plan)):
            raise SessionError(f"Cannot use {where}: it is for step {frame.step}, not {number}.")
        attempt = self.frames[frame.step].attempt + 1 if known else 0
        if frame.attempt != attempt:
            raise SessionError(
                f"Cannot use {where}: it is attempt {frame.attempt} at step {frame.step}, "
                f"not {attempt}."
            )
        if frame.pattern != self.plan.patterns[frame.step]:
            raise SessionError(
                f"Cannot use {where}: it says {frame.pattern}, the plan "
                f"{self.plan.patterns[frame.step]}."
            )
        self._take_in(frame)

    def _take_in(self, frame: FrameRecord) -> None:
        self._orders[frame.step, frame.attempt] = len(self.lines)
        self.lines.append(frame)
        if frame.step < len(self.frames):
            self.frames[frame.step] = frame
        else:
            self.frames.append(frame)

    def _rewrite(self, **changed: tuple[RunRecord, ...] | dict[str, JsonValue]) -> None:
        self.record = self.record.model_copy(update=changed)
        write_durably(self.folder / RECORD, _json(self.record))


def _check_blank(folder: Path) -> None:
    """Refuse a folder that holds more than the beginnings of an interrupted `Session.create`."""
    with storage(folder):
        if not (folder.exists() or folder.is_symlink()):
            return
    beginnings = {PLAN, LINES, FRAMES, LOCK, f".{PLAN}.part", f".{RECORD}.part"}
    blank = folder.is_dir() and all(
        path.name in beginnings
        and not (any(path.iterdir()) if path.name == FRAMES else False)
        and not (path.name == LINES and path.stat().st_size)
        for path in folder.iterdir()
    )
    if not blank:
        raise SessionError(
            f"{folder} exists and is not an empty folder; nothing was written. Give another --out."
        )


def _json(record: BaseModel) -> bytes:
    return record.model_dump_json(indent=1).encode() + b"\n"


def _parse(model: type[ModelT], path: Path) -> ModelT:
    try:
        return model.model_validate_json(read_plain(path, MAX_JSON_BYTES))
    except ValidationError as error:
        raise SessionError(f"{path} cannot be used:\n{explain(error)}") from error
