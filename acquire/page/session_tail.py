"""The newest frame of a session that another process is writing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from acquire.errors import SessionError
from acquire.page.darkroom import Negative, negative
from acquire.proof.records import FrameProof, read_proofs
from acquire.session import FrameRecord
from acquire.session.folder import read_plain
from acquire.session.store import LINES

MAX_WRONG = 3


@dataclass(frozen=True, slots=True)
class Proofs:
    """What the frames were found to show.

    Parameters
    ----------
    judged
        Steps of the plan whose frame was judged.
    retaken
        Frames that were taken again.
    wrong
        In words, the last of those that are still wrong.
    """

    judged: int
    retaken: int
    wrong: tuple[str, ...]


class SessionTail:
    """Reads the lines of a session as they come, and the files that they name.

    `frames` holds the line that counts for each step, `last` the newest line.

    Parameters
    ----------
    folder
        Of the session.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read_bytes = self._lines = 0
        self.frames: dict[int, FrameRecord] = {}
        self.last: FrameRecord | None = None

    def follow(self) -> None:
        """Take in the whole lines that are new; none while there is no session yet."""
        path = self._folder / LINES
        if not path.exists():
            return
        try:
            with path.open("rb") as file:
                file.seek(self._read_bytes)
                lines = file.read().split(b"\n")[:-1]
            for line in lines:
                record = FrameRecord.model_validate_json(line)
                self._read_bytes += len(line) + 1
                self._lines += 1
                self.frames[record.step] = self.last = record
        except (OSError, ValidationError) as error:
            raise SessionError(f"{path} cannot be read: {error}") from error

    def proofs(self) -> Proofs:
        """How many frames were judged so far, and what was found wrong."""
        found = read_proofs(self._folder)
        last: dict[int, FrameProof] = {}
        for (step, _), proof in sorted(found.items()):
            last[step] = proof
        wrong = tuple(
            f"step {proof.step} {proof.in_words}" for proof in last.values() if proof.is_wrong
        )
        return Proofs(len(last), self._lines - len(self.frames), wrong[-MAX_WRONG:])

    def picture(self, record: FrameRecord) -> Negative:
        """The file of a line, decoded."""
        data = read_plain(self._folder / record.file, record.size_bytes)
        return negative(record.media_type, data)
