"""The newest frame of a session that another process is writing."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from acquire.errors import SessionError
from acquire.page.darkroom import Negative, negative
from acquire.proof.records import FrameProof, read_proofs
from acquire.session import FrameRecord
from acquire.session.folder import read_plain
from acquire.session.store import LINES
from processing.patterns import Family

PIECE_BYTES = 16_384
MAX_WRONG = 3


@dataclass(frozen=True, slots=True)
class Light:
    """How bright a frame is, and how bright it should be if all light were direct.

    Parameters
    ----------
    measured
        Mean of the frame less black, over white less black; None without both.
    expected
        Mean code of the pattern.
    """

    measured: float | None
    expected: float


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
    """Reads the last line of a session and its file; knows the first white and black frame.

    Parameters
    ----------
    folder
        Of the session.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._levels: dict[Family, float] = {}

    def last(self) -> FrameRecord | None:
        """The last whole line; None while there is none."""
        records = self._records(from_end=True)
        return records[-1] if records else None

    def proofs(self) -> Proofs:
        """How many frames were judged so far, and what was found wrong."""
        found = read_proofs(self._folder)
        last: dict[int, FrameProof] = {}
        for (step, _), proof in sorted(found.items()):
            last[step] = proof
        wrong = tuple(
            f"step {proof.step} {proof.in_words}" for proof in last.values() if proof.is_wrong
        )
        return Proofs(len(last), len(found) - len(last), wrong[-MAX_WRONG:])

    def picture(self, record: FrameRecord) -> Negative:
        """The file of a line, decoded."""
        data = read_plain(self._folder / record.file, record.size_bytes)
        return negative(record.media_type, data)

    def light(self, record: FrameRecord, picture: Negative) -> Light:
        """The frame's light against the references that came first."""
        self._find_references()
        expected = float(record.pattern.code((256, 256)).mean())
        white, black = self._levels.get(Family.WHITE), self._levels.get(Family.BLACK)
        if white is None or black is None or not white > black:
            return Light(None, expected)
        return Light((_level(picture) - black) / (white - black), expected)

    def _find_references(self) -> None:
        if len(self._levels) == 2:
            return
        for record in self._records(from_end=False):
            family = record.pattern.family
            if family.is_reference and family not in self._levels:
                self._levels[family] = _level(self.picture(record))

    def _records(self, *, from_end: bool) -> list[FrameRecord]:
        """Lines of the first or last few kilobytes; none that is cut off."""
        path = self._folder / LINES
        try:
            with path.open("rb") as file:
                size = file.seek(0, os.SEEK_END)
                start = max(size - PIECE_BYTES, 0) if from_end else 0
                file.seek(start)
                lines = file.read(PIECE_BYTES).split(b"\n")[1 if start else 0 : -1]
            return [FrameRecord.model_validate_json(line) for line in lines]
        except (OSError, ValidationError) as error:
            raise SessionError(f"{path} cannot be read: {error}") from error


def _level(picture: Negative) -> float:
    return float(picture.values.mean(dtype=np.float64))
