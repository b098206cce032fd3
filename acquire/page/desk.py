"""What the bench is doing, as told to the page."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from acquire.page.commands import BenchCommand
from acquire.page.link import PageLink
from acquire.page.state import Note, Snapshot


class Desk:
    """Holds the snapshot and posts every change of it; safe from several threads.

    Parameters
    ----------
    link
        To the page.
    say
        Says a line to the person at the terminal.
    session
        Folder that frames go to.
    """

    def __init__(
        self, link: PageLink, say: Callable[[str], None], session: Path | None = None
    ) -> None:
        self._link, self._say = link, say
        self._lock = threading.RLock()
        self._snapshot = Snapshot(session=None if session is None else str(session.absolute()))

    @property
    def snapshot(self) -> Snapshot:
        """What was posted last."""
        return self._snapshot

    def change(self, alter: Callable[[Snapshot], Snapshot]) -> None:
        """Post an altered snapshot."""
        with self._lock:
            self._snapshot = alter(self._snapshot)
            self._link.post(self._snapshot)

    def listen(self, listener: Callable[[BenchCommand], None]) -> None:
        """Call `listener` with every command of the page, from another thread."""
        self._link.listen(listener)

    def picture(self, media_type: str, data: bytes) -> None:
        """Post what the camera delivered while aiming."""
        self._link.post_picture(media_type, data)

    def note(self, text: str, *, is_error: bool = False) -> None:
        """Tell the page and the terminal something."""
        self._say(text)
        self.remark(text, is_error=is_error)

    def remark(self, text: str, *, is_error: bool = False) -> None:
        """Tell the page something that the terminal knows."""
        note = Note(time.time(), text, is_error)
        self.change(lambda snapshot: snapshot.with_note(note))
