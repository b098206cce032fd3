"""One exposure as the camera's events tell of it: objects and completion, in any order."""

from __future__ import annotations

from drivers.errors import CameraError, CameraTimeoutError
from drivers.protocols import Clock
from drivers.ptp.body import GIVE_UP_S

# How long the missing half is waited for once the other half is there and the camera is quiet.
MISSING_S = 3.0


class Shot:
    """What is known of an exposure under way.

    Parameters
    ----------
    clock
        Of the bench.
    exposure_s
        How long the shutter is open.
    expected
        Number of files that the picture quality makes.
    linger_s
        How long to wait for another file after a complete shot; for cameras whose picture
        quality is not known.
    """

    def __init__(
        self, clock: Clock, exposure_s: float, expected: int = 1, linger_s: float = 0.0
    ) -> None:
        self._clock = clock
        self._due_s = clock.monotonic() + exposure_s
        self._expected = expected
        self._linger_s = linger_s
        self._quiet_since_s = clock.monotonic()
        self._is_complete = False
        self.objects: list[int] = []

    def object_added(self, handle: int) -> None:
        """A file is there; both of a pair may bear the same handle, one after the other."""
        self.objects.append(handle)
        self._quiet_since_s = self._clock.monotonic()

    def completed(self) -> None:
        """The camera says that the shot is over."""
        self._is_complete = True
        self._quiet_since_s = self._clock.monotonic()

    def store_full(self) -> None:
        """The camera says that the picture has no place."""
        raise CameraError("the card is full: put in an empty one or delete pictures")

    def is_late(self) -> bool:
        """Whether the exposure should have told of itself by now."""
        return self._clock.monotonic() >= self._due_s + MISSING_S

    def is_over(self) -> bool:
        """Whether there is nothing more to wait for."""
        quiet_s = self._clock.monotonic() - self._quiet_since_s
        if self._is_complete and len(self.objects) >= self._expected:
            return quiet_s >= self._linger_s
        if self._is_complete or self.objects:
            return quiet_s >= MISSING_S
        if self._clock.monotonic() >= self._due_s + GIVE_UP_S:
            raise CameraTimeoutError(
                f"the camera told of no picture within {GIVE_UP_S:.0f} s of the exposure; "
                "was it switched off, asleep or in a menu?"
            )
        return False
