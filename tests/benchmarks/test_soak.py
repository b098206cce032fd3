"""A short soak: every kind of fault is survived, and nothing differs in the end."""

from __future__ import annotations

from pathlib import Path

from benchmarks.soak import soak


def test_disturbed_at_random_a_capture_ends_in_the_same_bits(tmp_path: Path) -> None:
    tally = soak(tmp_path, frames=38, seed=5, every=6, processing=False)
    assert tally.failures == []
    assert tally.injected.total() >= 3
    assert tally.survived == tally.injected
