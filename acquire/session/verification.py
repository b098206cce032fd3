"""Every file, every digest: what is wrong with a session, if anything."""

from __future__ import annotations

from collections.abc import Iterator

from acquire.errors import SessionError
from acquire.session.store import FRAMES, LINES, LOCK, PLAN, PROOF, RECORD, Session

KNOWN = {PLAN, RECORD, LINES, PROOF, FRAMES, "truth.npz", LOCK}


def problems(session: Session) -> Iterator[str | None]:
    """One item a line, None when it is sound, then one for each thing that does not belong."""
    for frame in session.lines:
        try:
            session.read(frame)
        except SessionError as error:
            yield str(error).split(". `lumisplit verify", maxsplit=1)[0] + "."
        else:
            yield None
    yield from _strangers(session)


def happenings(session: Session) -> Iterator[str]:
    """How the runs of the capture ended that did not complete it, in words."""
    runs = session.record.runs
    for number, run in enumerate(runs, 1):
        if run.outcome == "complete":
            continue
        reason = run.reason
        if run.outcome == "running":
            reason = "It is still going on, or the power failed or the program was killed."
        where = f"run {number} of {len(runs)}, from step {run.first_step}"
        yield f"{where}: {run.outcome}{': ' if reason else '.'}{reason}"


def _strangers(session: Session) -> Iterator[str]:
    listed = {frame.file for frame in session.lines}
    found = {f"{FRAMES}/{path.name}" for path in (session.folder / FRAMES).iterdir()}
    for name in sorted(found - listed):
        yield f"{session.folder / name} belongs to no line of {LINES}."
    for path in sorted(session.folder.iterdir()):
        if path.name not in KNOWN:
            yield f"{path} is not part of a session."
    content = (session.folder / LINES).read_bytes()
    if content and not content.endswith(b"\n"):
        yield f"The last line of {session.folder / LINES} is unfinished; `capture` mends that."
