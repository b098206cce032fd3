from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from acquire.errors import PlanError
from acquire.plan import Plan
from acquire.plan_file import check_fits, example_text, parse_plan, read_plan
from processing.patterns import Family

SMALL = "[pattern]\npitch_px = [8, 12, 16]\n"


def test_the_papers_plan() -> None:
    plan = parse_plan(example_text(), "paper")
    shown = [pattern for pattern in plan.patterns if not pattern.family.is_reference]
    assert sorted({pattern.pitch_px for pattern in shown}) == list(range(8, 97, 4))
    assert len(shown) == len(set(shown)) == 828
    whites = [k for k, pattern in enumerate(plan.patterns) if pattern.family is Family.WHITE]
    assert whites[0] == 0
    assert whites[-1] == len(plan) - 2
    assert max(b - a for a, b in pairwise(whites)) == 209


def test_references_come_once_by_default() -> None:
    plan = parse_plan(SMALL, "small")
    assert [str(pattern) for pattern in plan.patterns[:3]] == ["white", "black", "checker:8:0,0"]
    assert len(plan) == 2 + 3 * 36


def test_canonical_text_round_trip() -> None:
    plan = parse_plan(SMALL, "small")
    again = Plan.model_validate_json(plan.to_json())
    assert again == plan
    assert again.sha256 == plan.sha256


def test_a_pitch_too_fine_for_its_grid_repeats_no_frame() -> None:
    plan = parse_plan("[pattern]\npitch_px = [4]\n", "fine")
    assert len(set(plan.patterns)) == len(plan.patterns) == 2 + 24


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        pytest.param("[pattern", ["not valid TOML"], id="no TOML"),
        pytest.param("", ["pattern", "required"], id="empty"),
        pytest.param("[pattern]\npitch_px = []", ["pattern.pitch_px"], id="no pitch"),
        pytest.param("[pattern]\npitch_px = [0]", ["pitch_px", "0"], id="zero pitch"),
        pytest.param("[pattern]\npitch_px = [8, 8]", ["pitch_px", "twice"], id="pitch twice"),
        pytest.param("[pattern]\npitch_px = [8.5]", ["pitch_px", "integer"], id="half a pixel"),
        pytest.param(SMALL + "colour = 1", ["pattern.colour", "no such key"], id="unknown key"),
        pytest.param(SMALL + 'family = "dots"', ["pattern.family"], id="unknown family"),
        pytest.param(SMALL + "shifts = [0, 6]", ["shifts"], id="no shift"),
        pytest.param(SMALL + "shifts = [1000, 1000]", ["shifts", "frames"], id="too many frames"),
        pytest.param(
            SMALL + "span_pitches = [1, 1]",
            ["pattern.shifts", "pitch 8", "always lit"],
            id="untoggled by span",
        ),
        pytest.param(SMALL + "shifts = [1, 1]", ["pattern.shifts", "direct"], id="one shift"),
        pytest.param(
            SMALL + 'family = "sinusoid-rows"\nshifts = [2, 6]',
            ["pattern.shifts", "2 different"],
            id="sinusoid with two phases",
        ),
        pytest.param(SMALL + "[camera]\niso = -1", ["camera.iso"], id="negative iso"),
        pytest.param(SMALL + "[camera]\nexposure_s = nan", ["exposure_s"], id="nan"),
        pytest.param(SMALL + "[projector]\nsettle_s = -1", ["settle_s"], id="negative settle"),
    ],
)
def test_refused_naming_key_and_reason(text: str, parts: list[str]) -> None:
    with pytest.raises(PlanError) as refusal:
        parse_plan(text, "bad.toml")
    message = str(refusal.value)
    assert "bad.toml" in message or message.startswith("pattern.shifts")
    assert all(part in message for part in parts)


def test_a_pitch_wider_than_the_projector_is_refused() -> None:
    plan = parse_plan("[pattern]\npitch_px = [8, 400]\n", "wide")
    with pytest.raises(PlanError, match=r"pattern.pitch_px: a pitch of 400 px is wider"):
        check_fits(plan, (288, 384), "sim")


def test_the_plans_projector_is_kept_to() -> None:
    plan = parse_plan(SMALL + "[projector]\nresolution_px = [800, 1280]\n", "lab")
    check_fits(plan, (800, 1280), "lab")
    with pytest.raises(PlanError, match=r"projector\.resolution_px"):
        check_fits(plan, (288, 384), "sim")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        pytest.param(None, "Cannot read the plan", id="missing"),
        pytest.param(b"\xff\xfe\x00", "UTF-8", id="not text"),
        pytest.param(b"#" * 2_000_000, "no plan is that long", id="huge"),
    ],
)
def test_unreadable_plans(tmp_path: Path, content: bytes | None, reason: str) -> None:
    path = tmp_path / "plan.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PlanError, match=reason):
        read_plan(path)


def test_keys_that_say_nothing_leave_the_plans_text_as_it_was() -> None:
    text = parse_plan(SMALL, "plain").to_json()
    assert "exposures_s" not in text
    assert "calibration" not in text
    assert "light" not in text


def test_each_step_may_have_its_own_exposure() -> None:
    plan = Plan(patterns=("white", "uniform:7"), exposures_s=(0.1, 0.4))
    assert [step.settings.exposure_s for step in plan.steps] == [0.1, 0.4]
    assert Plan.model_validate_json(plan.to_json()) == plan
    with pytest.raises(ValueError, match="exposures_s: 1 for 2"):
        Plan(patterns=("white", "black"), exposures_s=(0.1,))
