"""What a transport of PTP must do: the seam between the session above and USB or TCP below."""

from __future__ import annotations

from typing import Protocol

from drivers.ptp.transaction import Happening, Request


class Link(Protocol):
    """A way to one camera, with the conversation that is held over it.

    Every method raises `drivers.ptp.errors.PtpTransportError` or a kind of it when bytes do not
    get through, and `drivers.ptp.errors.PtpProtocolError` when they are not PTP.
    """

    def send(self, request: Request, into: memoryview | None = None) -> None:
        """Begin a transaction; the camera's data go to `into` if that is given."""

    def receive(self, timeout_s: float) -> Happening:
        """What comes next; never `NeedData`. `PtpTimeoutError` after `timeout_s` of silence."""

    def poll_events(self, timeout_s: float) -> None:
        """Take in events for at most `timeout_s`, between transactions; silence is no error."""

    def take(self) -> Happening:
        """What has been taken in already; `NeedData` when there is nothing."""

    def recover(self) -> None:
        """Get back in step: forget the transaction under way on both sides."""

    def close(self) -> None:
        """Let the way go; may be called more than once and never raises."""
