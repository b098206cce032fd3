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
from acquire.session.records import FrameRecord
from acquire.session.store import FRAMES, LINES, Session


def recover(session: Session, *, mend: bool = False) -> list[str]:
    """Put right what the run before left; what was lost by that, in words.

    Parameters
    ----------
    session
        Locked by the caller.
    mend
        However the last run ended, take the last frames as lost from the first that is damaged.

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
    runs = session.record.runs
    broken = bool(runs) and runs[-1].outcome == "running"
    lost = _lost(session) if broken else 0
    lost = max(lost, _in_reach(session)) if mend else lost
    if lost:
        steps = ", ".join(str(frame.step) for frame in session.lines[-lost:])
        why = (
            f"the disk had not kept the last {lost} frame(s) that it had confirmed (step {steps})"
            if broken
            else f"files were lost after the capture: its last {lost} frame(s) (step {steps}) are "
            "dropped"
        )
        said.append(f"{why}; they are taken again")
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
    """How many of the last frames the disk does not hold although it had confirmed them.

    Raises
    ------
    SessionError
        They are more than a disk loses of what it has not written yet.
    """
    for lost, frame in enumerate(reversed(session.lines)):
        if lost > MOST_LOST:
            raise SessionError(
                f"More than {MOST_LOST} of the last frames of {session.folder} are missing or "
                "damaged, which no power cut explains. Restore them from a copy; `lumisplit "
                "verify` lists them."
            )
        if _is_sound(session, frame):
            return lost
    return len(session.lines)


def _in_reach(session: Session) -> int:
    """How many of the last frames must go with the first that is damaged among them."""
    last = session.lines[-MOST_LOST:]
    for number, frame in enumerate(last):
        if not _is_sound(session, frame):
            return len(last) - number
    return 0


def remedy(session: Session, damaged: int) -> str:
    """What to do about frames that are missing or damaged, the first of them in line `damaged`."""
    if session.record.source is not None:
        return "Restore the files from a copy, or import the frames again."
    dropped = len(session.lines) - damaged
    if dropped > MOST_LOST:
        return (
            f"Of frames {dropped} exposures back none can be taken again by itself. Restore the "
            "files from a copy, or capture anew."
        )
    return (
        f"If bench and scene are as they were, give the capture's command again with `--mend`: it "
        f"takes the last {dropped} exposure(s) again. Otherwise restore the files from a copy."
    )


def _is_sound(session: Session, frame: FrameRecord) -> bool:
    try:
        session.read(frame)
    except SessionError:
        return False
    return True
