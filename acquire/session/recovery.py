"""What a crash or a power cut leaves in a session folder, and how it is put right.

The frame in flight may have left a part of its file, its whole file without a line, or a part of
its line. A disk that said of more frames that it holds them than it does (as cheap USB drives do)
may have lost the last few: where a run ended without a word, they are taken again.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from acquire.errors import SessionError
from acquire.session.folder import MOST_LOST, storage
from acquire.session.log import recover_notes
from acquire.session.store import FRAMES, LINES, Session


def recover(session: Session) -> list[str]:
    """Put right what the run before left; what was lost by that, in words.

    Raises
    ------
    SessionError
        More is damaged than a crash explains.
    """
    _check_lines(session)
    said = []
    for path in remains(session):
        with storage(path):
            path.unlink()
    lost = _lost(session)
    if lost:
        steps = ", ".join(str(frame.step) for frame in session.lines[-lost:])
        said.append(
            f"the disk had not kept the last {lost} frame(s) that it had confirmed (step {steps}); "
            "they are taken again"
        )
        session.forget(lost)
    with storage(session.folder), (session.folder / LINES).open("rb+") as file:
        file.truncate(sum(map(len, session.complete_lines())))
    recover_notes(session.folder)
    return said


def remains(session: Session) -> Iterator[Path]:
    """Files of frames that were in flight when a run ended: of no use, and no damage."""
    listed = {frame.file for frame in session.lines}
    number = len(session.frames)
    expected = {f"{step:06d}" for step in range(number, number + MOST_LOST)}
    expected |= {f"{frame.step:06d}-{frame.attempt + 1}" for frame in session.frames}
    for path in sorted((session.folder / FRAMES).iterdir()):
        is_part = path.name.startswith(".") and path.name.endswith(".part")
        is_frame = path.stem in expected and f"{FRAMES}/{path.name}" not in listed
        if is_part or is_frame:
            yield path
    yield from sorted(session.folder.glob(".*.part"))


def _check_lines(session: Session) -> None:
    """Refuse to begin anew where frames lie that some lines must have spoken of."""
    listed = {frame.file for frame in session.lines}
    frames = [path for path in (session.folder / FRAMES).iterdir() if path.name[:1] != "."]
    unlisted = sum(f"{FRAMES}/{path.name}" not in listed for path in frames)
    if unlisted > MOST_LOST:
        raise SessionError(
            f"{session.folder / LINES} has lost its lines: {unlisted} frames in {FRAMES} belong to "
            "none, which no power cut explains. Restore it from a copy; nothing was changed."
        )


def torn_bytes(session: Session) -> int:
    """Length of the line of frames.jsonl that a crash left unfinished."""
    whole = sum(map(len, session.complete_lines()))
    return (session.folder / LINES).stat().st_size - whole


def _lost(session: Session) -> int:
    """How many of the last frames the disk does not hold although it had confirmed them."""
    runs = session.record.runs
    if not runs or runs[-1].outcome != "running":
        return 0
    for lost, frame in enumerate(reversed(session.lines)):
        if lost > MOST_LOST:
            raise SessionError(
                f"More than {MOST_LOST} of the last frames of {session.folder} are missing or "
                "damaged, which no power cut explains. Restore them from a copy; `lumisplit "
                "verify` lists them."
            )
        try:
            session.read(frame)
        except SessionError:
            continue
        return lost
    return len(session.lines)
