from __future__ import annotations

import math

import pytest

from drivers.sim.defects import Defects


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gamma", 0.0),
        ("gamma", math.nan),
        ("black_level", 1.0),
        ("blur_px", -0.1),
        ("latency_s", -1.0),
        ("latency_s", math.inf),
        ("late", 1.1),
        ("dropped", -0.1),
        ("swapped", 2.0),
        ("timeouts", -1.0),
        ("full_well_e", 0.0),
        ("read_noise_e", -1.0),
        ("drift", -1.0),
        ("flicker", 1.5),
        ("ambient", -0.1),
        ("move_px", math.nan),
        ("shade", 1.0),
        ("slip_px", 0.5),
        ("zoom", 0.0),
        ("iso_turned", 3.0),
    ],
)
def test_what_makes_no_sense_is_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        Defects(**{name: value})


def test_read_noise_in_electrons_needs_the_full_well_for_its_scale() -> None:
    with pytest.raises(ValueError, match="give full_well_e"):
        Defects(read_noise_e=5.0)
    assert Defects(read_noise_e=5.0, full_well_e=20_000.0).read_noise_e == 5


def test_a_bench_is_ideal_unless_told_otherwise() -> None:
    assert Defects() == Defects(gamma=1.0, black_level=0.0, full_well_e=None, move_px=0.0)
