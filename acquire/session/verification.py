"""Every file, every digest: what is wrong with a session, if anything, and what befell it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

from acquire.errors import SessionError
from acquire.session.log import LOG, Kind, read_notes
from acquire.session.recovery import remains, torn_bytes
from acquire.session.store import (
    FRAMES,
    LINES,
    LOCK,
    PLAN,
    PROFILES,
    PROOF,
    RECORD,
    Session,
)

KNOWN = {PLAN, RECORD, LINES, PROOF, LOG, FRAMES, PROFILES, "truth.npz", LOCK}
CLOCK_JUMP_S = 2.0
MOST_TOLD = 10
_COUNTED = {
    Kind.RETAKE: "{} exposure(s) did not show what they should and were taken again",
    Kind.TIMEOUT: "{} time(s) no file came from the camera and the exposure was tried again",
}


def problems(session: Session) -> Iterator[str | None]:
    """One item a line, None when it is sound, then one for each thing that does not belong."""
    for frame in session.lines:
        try:
            session.read(frame)
        except SessionError as error:
            yield str(error).split(". `lumisplit verify", maxsplit=1)[0].rstrip(".") + "."
        else:
            yield None
    yield from _strangers(session)


def happenings(session: Session) -> Iterator[str]:
    """All that befell the capture, in words; nothing where it went through undisturbed."""
    yield from _runs(session)
    yield from _leftovers(session)
    yield from incidents(session)


def incidents(session: Session) -> Iterator[str]:
    """What befell the capture beside the ends of its runs: retakes, time-outs, clocks."""
    notes = list(read_notes(session.folder))
    counts = Counter(note.kind for note in notes)
    for kind, words in _COUNTED.items():
        steps = dict.fromkeys(str(note.step) for note in notes if note.kind is kind)
        if steps:
            more = ", …" if len(steps) > MOST_TOLD else ""
            where = ", ".join(list(steps)[:MOST_TOLD]) + more
            yield f"{words.format(counts[kind])} (step {where})."
    said = {*_COUNTED, Kind.SUSPECT, Kind.END}
    rest = list(dict.fromkeys(note.text for note in notes if note.kind not in said))
    yield from rest[:MOST_TOLD]
    if len(rest) > MOST_TOLD:
        yield f"{len(rest) - MOST_TOLD} more warnings stand in {session.folder / LOG}."
    yield from clock_jumps(session)


def _runs(session: Session) -> Iterator[str]:
    """How the runs ended that did not complete the capture."""
    runs = session.record.runs
    for number, run in enumerate(runs, 1):
        if run.outcome == "complete":
            continue
        reason = run.reason
        if run.outcome == "running":
            going_on = session.is_being_written
            reason = "It is still going on." if going_on else session.unsaid_end
        where = f"run {number} of {len(runs)}, from step {run.first_step}"
        yield f"{where}: {run.outcome}{': ' if reason else '.'}{reason}"


def _leftovers(session: Session) -> Iterator[str]:
    """What the frame in flight left behind; no damage, and gone when the capture goes on."""
    mended = "of a frame that was in flight when the capture ended; `capture` takes it again"
    for path in remains(session):
        yield f"{path} is {mended}."
    if torn_bytes(session):
        yield f"The last line of {session.folder / LINES} is unfinished, {mended}."


def clock_jumps(session: Session) -> Iterator[str]:
    """Jumps of the host's clock against time that nobody sets."""
    for before, after in pairwise(session.lines):
        if None in (before.finished_s, after.finished_s, before.monotonic_s, after.monotonic_s):
            continue
        wall = float(after.finished_s or 0) - float(before.finished_s or 0)
        true = float(after.monotonic_s or 0) - float(before.monotonic_s or 0)
        # Time that nobody sets begins anew when the computer does.
        if true >= 0 and abs(wall - true) > CLOCK_JUMP_S:
            yield (
                f"The computer's clock jumped by {wall - true:+.0f} s between steps {before.step} "
                f"and {after.step}; the order and the spacing of the frames are by another clock."
            )


def _strangers(session: Session) -> Iterator[str]:
    listed = {frame.file for frame in session.lines}
    found = {f"{FRAMES}/{path.name}" for path in (session.folder / FRAMES).iterdir()}
    left = set(remains(session))
    for name in sorted(found - listed):
        if session.folder / name not in left:
            yield f"{session.folder / name} belongs to no line of {LINES}."
    for path in sorted(session.folder.iterdir()):
        if path.name not in KNOWN and path not in left:
            yield f"{path} is not part of a session."
