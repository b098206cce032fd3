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
