"""Who commands the bench: one viewer at a time, the others watch."""

from __future__ import annotations

from dataclasses import dataclass

SILENCE_S = 15.0


@dataclass(frozen=True, slots=True)
class Helm:
    """Pure bookkeeping; time comes from the caller.

    The first viewer to come while nobody commands gets control. Later ones may take it when it
    is free, or ask for it: the holder hands it over, keeps it, or loses it by a silence of
    `SILENCE_S` seconds, because an operator may have left the other screen behind.

    Parameters
    ----------
    holder
        Number of the viewer who commands.
    asking
        Number of the viewer who asked for control, and since when.
    """

    holder: int | None = None
    asking: int | None = None
    asked_s: float = 0.0

    def joined(self, viewer: int) -> Helm:
        """A viewer has come."""
        return Helm(viewer) if self.holder is None else self

    def left(self, viewer: int) -> Helm:
        """A viewer has gone; control is handed to who asked for it, or is free."""
        if viewer == self.holder:
            return Helm(self.asking)
        return Helm(self.holder) if viewer == self.asking else self

    def asked(self, viewer: int, now_s: float) -> Helm:
        """A viewer wants control: has it at once when it is free."""
        if self.holder is None:
            return Helm(viewer)
        if viewer == self.holder or self.asking is not None:
            return self
        return Helm(self.holder, viewer, now_s)

    def answered(self, viewer: int, *, hand_over: bool) -> Helm:
        """The holder hands over or keeps; from anyone else it means nothing."""
        if viewer != self.holder or self.asking is None:
            return self
        return Helm(self.asking if hand_over else self.holder)

    def given_up(self, viewer: int) -> Helm:
        """The holder goes on as one who watches."""
        return Helm(self.asking) if viewer == self.holder else self

    def at(self, now_s: float) -> Helm:
        """After a silence control passes to who asked for it."""
        if self.asking is not None and now_s - self.asked_s >= SILENCE_S:
            return Helm(self.asking)
        return self
