from __future__ import annotations

from dataclasses import replace

import pytest

from drivers.errors import ProjectorError
from drivers.monitors import Monitor, choose_monitor

OPERATOR = Monitor(
    "DP-1", "DELL U2412M", (1200, 1920), (0, 0), 59.95, (324, 518), primary=True, exact=True
)
PROJECTOR = Monitor(
    "HDMI-1", "BenQ PJ", (800, 1280), (0, 1920), 59.81, (0, 0), primary=False, exact=True
)
TABLET = Monitor("DP-2", "BenQ PJ", (768, 1024), (0, 3200), 60.0, (0, 0), primary=False, exact=True)


@pytest.mark.parametrize(
    ("monitors", "name", "expected"),
    [
        pytest.param([OPERATOR, PROJECTOR], "HDMI-1", PROJECTOR, id="connector"),
        pytest.param([OPERATOR, PROJECTOR], "hdmi-1", PROJECTOR, id="connector in small letters"),
        pytest.param([OPERATOR, PROJECTOR], "BenQ PJ", PROJECTOR, id="name"),
        pytest.param([OPERATOR, PROJECTOR, TABLET], "DP-2", TABLET, id="third"),
        pytest.param([OPERATOR, PROJECTOR], None, PROJECTOR, id="the only other one"),
        pytest.param([OPERATOR, PROJECTOR], "DP-1", OPERATOR, id="the operator's, by its name"),
        pytest.param([OPERATOR], "DP-1", OPERATOR, id="a single one, by its name"),
    ],
)
def test_the_projector_is_the_monitor_that_was_named(
    monitors: list[Monitor], name: str | None, expected: Monitor
) -> None:
    assert choose_monitor(monitors, name) == expected


NEITHER_PRIMARY = [replace(OPERATOR, primary=False), PROJECTOR]


@pytest.mark.parametrize(
    ("monitors", "name", "reason"),
    [
        pytest.param([OPERATOR], None, "no second monitor", id="one monitor"),
        pytest.param([PROJECTOR], None, "no second monitor", id="only the projector"),
        pytest.param([], None, "No monitor is lit", id="no monitor"),
        pytest.param([OPERATOR, PROJECTOR], "HDMI-2", "HDMI-1", id="a typing error"),
        pytest.param([OPERATOR, PROJECTOR], "", "no monitor ''", id="empty"),
        pytest.param([OPERATOR, PROJECTOR, TABLET], None, "Which", id="two others"),
        pytest.param([OPERATOR, PROJECTOR, TABLET], "BenQ PJ", "HDMI-1 or DP-2", id="twins"),
        pytest.param(NEITHER_PRIMARY, None, "Which", id="none is primary"),
        pytest.param(
            [OPERATOR, replace(PROJECTOR, position_px=(0, 0))], "HDMI-1", "mirrored", id="mirrored"
        ),
        pytest.param(
            [OPERATOR, replace(PROJECTOR, position_px=(0, 1919))], None, "mirrored", id="one column"
        ),
        pytest.param(
            [OPERATOR, replace(PROJECTOR, exact=False)], "HDMI-1", "--scale 1x1", id="scaled"
        ),
    ],
)
def test_where_exact_pixels_cannot_be_had_it_says_what_to_do(
    monitors: list[Monitor], name: str | None, reason: str
) -> None:
    with pytest.raises(ProjectorError, match=reason):
        choose_monitor(monitors, name)


def test_a_monitor_reads_like_a_line_of_a_list() -> None:
    assert str(OPERATOR) == "DP-1 (DELL U2412M) 1920x1200+0+0 at 59.95 Hz, primary"
    assert str(replace(PROJECTOR, name="HDMI-1")) == "HDMI-1 1280x800+1920+0 at 59.81 Hz"
