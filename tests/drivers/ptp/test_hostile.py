"""Nothing that a camera or a host sends brings out anything but the package's own error."""

from __future__ import annotations

import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.ptp.errors import PtpError
from tests.drivers.ptp.hostile import attempt, readers

READERS = readers()


@pytest.mark.parametrize("name", READERS)
def test_valid_bytes_are_read(name: str) -> None:
    for example in READERS[name].examples:
        READERS[name].read(example, random.Random(1))


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(rng=st.randoms(use_true_random=False))
def test_spoiled_bytes_are_read_or_refused(name: str, rng: random.Random) -> None:
    attempt(READERS[name], rng)


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=200, deadline=None)
@given(stream=st.binary(max_size=300), seed=st.integers(0, 999))
def test_any_bytes_are_read_or_refused(name: str, stream: bytes, seed: int) -> None:
    try:
        READERS[name].read(stream, random.Random(seed))
    except PtpError:
        return
