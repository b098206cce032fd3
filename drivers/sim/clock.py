"""A clock on which waiting costs nothing."""

from __future__ import annotations

import time

# Simulated runs begin at a fixed moment, so that they repeat to the byte: 2026-01-01 00:00 UTC.
EPOCH_S = 1_767_225_600.0


class SimulatedClock:
    """Simulated time (see `drivers.protocols.Clock`): sleeping advances it at once.

    Parameters
    ----------
    start_s
        First reading, seconds since 1970-01-01 UTC.
    """

    def __init__(self, start_s: float = EPOCH_S) -> None:
        self._now_s = start_s

    def now(self) -> float:
        """Seconds since 1970-01-01 UTC."""
        return self._now_s

    def monotonic(self) -> float:
        """Seconds since the simulated run began."""
        return self._now_s - EPOCH_S

    def awake(self) -> float:
        """As `monotonic`: a simulated computer is never suspended."""
        return self.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Advance by `duration_s` ≥ 0 seconds."""
        if not duration_s >= 0:
            raise ValueError(f"time does not run back: cannot sleep {duration_s} s")
        self._now_s += duration_s


class PacedClock(SimulatedClock):
    """The same readings, but waiting takes its time: for trying a bench out at its real pace."""

    def sleep(self, duration_s: float) -> None:
        """Advance by `duration_s` ≥ 0 seconds and block for as long."""
        super().sleep(duration_s)
        time.sleep(duration_s)
