"""The host's clock."""

from __future__ import annotations

import time


class SystemClock:
    """Wall time of the host (see `drivers.protocols.Clock`)."""

    def now(self) -> float:
        """Seconds since 1970-01-01 UTC."""
        return time.time()

    def monotonic(self) -> float:
        """Seconds since some moment before, time in suspension included where the system tells."""
        if hasattr(time, "CLOCK_BOOTTIME"):
            return time.clock_gettime(time.CLOCK_BOOTTIME)
        return time.monotonic()

    def awake(self) -> float:
        """Seconds since some moment before, time in suspension left out where the system can."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Block for `duration_s` seconds."""
        time.sleep(duration_s)
