"""A request that a capture rests between two frames, and whether it does."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Pause:
    """Asked for by anyone, kept by the capture loop; safe from several threads.

    A resting capture holds no frame in flight and shows black; nothing of it is lost however
    long it rests.

    Parameters
    ----------
    changed
        Called by the capture loop when a rest begins and when it is over.
    """

    def __init__(self, changed: Callable[[], None] = lambda: None) -> None:
        self._changed = changed
        self._going = threading.Event()
        self._going.set()
        self._resting = False

    def ask(self) -> None:
        """Rest as soon as the frame in flight is on the disk."""
        self._going.clear()

    def go_on(self) -> None:
        """End the rest, or withdraw the request."""
        self._going.set()

    @property
    def is_asked(self) -> bool:
        """Whether the capture rests or should."""
        return not self._going.is_set()

    @property
    def is_resting(self) -> bool:
        """Whether the capture rests."""
        return self._resting

    @contextmanager
    def resting(self) -> Iterator[None]:
        """Mark the capture as resting; for the capture loop."""
        self._resting = True
        self._changed()
        try:
            yield
        finally:
            self._resting = False
            self._changed()

    def wait(self, limit_s: float) -> bool:
        """Wait until the rest is over, at most `limit_s` seconds; whether it is over."""
        return self._going.wait(limit_s)
