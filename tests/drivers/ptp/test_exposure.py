"""What is asked in seconds and f-numbers against the numbers of cameras."""

from __future__ import annotations

import pytest

from drivers.errors import SettingsError
from drivers.ptp.canon_scales import APERTURE, EXPOSURE_TIME, ISO_SPEED
from drivers.ptp.exposure import F_NUMBER, FRACTION, ISO, TENTHS_OF_MILLISECONDS, Scale

D4_TENTHS = (
    1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 31, 40, 50, 62, 80, 100, 125, 166, 200, 250, 333,
    400, 500, 666, 769, 1000, 1250, 1666, 2000, 2500, 3333, 4000, 5000, 6250, 7692, 10000, 13000,
    16000, 20000, 25000, 30000, 300000, 0xFFFFFFFF,
)  # fmt: skip
D4_FRACTIONS = (
    1 << 16 | 8000, 1 << 16 | 60, 1 << 16 | 30, 1 << 16 | 13, 1 << 16 | 10, 10 << 16 | 25,
    1 << 16 | 3, 10 << 16 | 13, 1 << 16 | 1, 13 << 16 | 10, 30 << 16 | 1,
    0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD,
)  # fmt: skip


@pytest.mark.parametrize(
    ("scale", "numbers", "asked", "number"),
    [
        pytest.param(TENTHS_OF_MILLISECONDS, D4_TENTHS, 1 / 10, 1000, id="1/10 in 0.1 ms"),
        pytest.param(TENTHS_OF_MILLISECONDS, D4_TENTHS, 1 / 3, 3333, id="1/3, cut off"),
        pytest.param(TENTHS_OF_MILLISECONDS, D4_TENTHS, 1 / 15, 666, id="1/15, cut off"),
        pytest.param(TENTHS_OF_MILLISECONDS, (166, 167, 168), 1 / 60, 167, id="1/60, rounded"),
        pytest.param(TENTHS_OF_MILLISECONDS, D4_TENTHS, 30.0, 300000, id="30 s"),
        pytest.param(FRACTION, D4_FRACTIONS, 1 / 8000, 1 << 16 | 8000, id="1/8000"),
        pytest.param(FRACTION, D4_FRACTIONS, 0.333, 1 << 16 | 3, id="0.333 for 1/3"),
        pytest.param(FRACTION, D4_FRACTIONS, 0.0167, 1 << 16 | 60, id="0.0167 for 1/60"),
        pytest.param(FRACTION, D4_FRACTIONS, 0.4, 10 << 16 | 25, id="1/2.5"),
        pytest.param(FRACTION, D4_FRACTIONS, 1.3, 13 << 16 | 10, id="1.3 s"),
        pytest.param(F_NUMBER, (560, 630, 800), 6.3, 630, id="f/6.3"),
        pytest.param(ISO, (100, 200, 400), 200, 200, id="ISO 200"),
        pytest.param(EXPOSURE_TIME, (0x0C, 0x50, 0x54, 0x58), 0.1, 0x54, id="Canon 1/10"),
        pytest.param(EXPOSURE_TIME, (0x30, 0x40, 0x98), 0.5, 0x40, id="Canon 1/2"),
        pytest.param(APERTURE, (0x30, 0x33, 0x38), 8.0, 0x38, id="Canon f/8"),
        pytest.param(ISO_SPEED, (0x00, 0x48, 0x50), 200, 0x50, id="Canon ISO 200"),
    ],
)
def test_what_is_asked_is_found(
    scale: Scale, numbers: tuple[int, ...], asked: float, number: int
) -> None:
    assert scale.choose(asked, numbers) == number


@pytest.mark.parametrize(
    ("scale", "numbers", "asked", "named"),
    [
        pytest.param(TENTHS_OF_MILLISECONDS, D4_TENTHS, 0.11, ("1/10", "1/8"), id="0.11 s"),
        pytest.param(FRACTION, D4_FRACTIONS, 0.035, ("1/30", "1/60"), id="0.035 s"),
        pytest.param(FRACTION, D4_FRACTIONS, 40.0, ("30 s", "1.3 s"), id="beyond the longest"),
        pytest.param(F_NUMBER, (560, 630, 800), 7.1, ("f/6.3", "f/8"), id="f/7.1"),
        pytest.param(ISO, (100, 200, 400), 300, ("200", "400"), id="ISO 300"),
        pytest.param(EXPOSURE_TIME, (0x0C,), 0.1, ("none at all",), id="Canon on bulb"),
    ],
)
def test_what_the_camera_does_not_have_names_the_nearest(
    scale: Scale, numbers: tuple[int, ...], asked: float, named: tuple[str, ...]
) -> None:
    with pytest.raises(SettingsError) as caught:
        scale.choose(asked, numbers)
    assert all(text in str(caught.value) for text in named)


@pytest.mark.parametrize("number", [0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD], ids=hex)
@pytest.mark.parametrize("scale", [FRACTION, TENTHS_OF_MILLISECONDS], ids=["D100", "500D"])
def test_bulb_is_no_time(scale: Scale, number: int) -> None:
    assert scale.value(number) is None
    assert not scale.is_same(3600.0, number)
