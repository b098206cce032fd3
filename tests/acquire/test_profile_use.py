"""Profiles that a plan names or a person gives, and what they change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquire.calibrating import calibrate
from acquire.calibrating.finding import Calibration, Setting
from acquire.calibrating.latency import LatencyCalibration
from acquire.calibrating.projector import LeakCalibration, ResponseCalibration
from acquire.calibrating.run import capture_all
from acquire.calibrating.sensor import DarkCalibration, NoiseCalibration
from acquire.cli.progress import ProgressDisplay
from acquire.errors import ProfileError
from acquire.plan import CameraPlan, ProjectorPlan
from acquire.profile_file import read_profile
from acquire.profile_use import check_profiles, keep_profiles, plan_with_profiles, profiles_for
from acquire.rig.simulated import simulated_bench
from tests.acquire.captures import SMALL_SIM, Notes, captured

SIM = SMALL_SIM.model_copy(
    update={"scene": "board", "gamma": 2.2, "full_well_e": 20_000, "camera_px": (32, 32)}
)
SINUSOIDS = """
[pattern]
family = "sinusoid-columns"
pitch_px = [12]
shifts = [1, 4]
[calibration]
response = "response.json"
latency = "latency.json"
dark = "dark.json"
"""


@pytest.fixture(scope="module")
def profiles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of profiles of one bench, and a plan that names some of them."""
    folder = tmp_path_factory.mktemp("profiles")
    bench = simulated_bench(SIM)
    setting = Setting(CameraPlan(), ProjectorPlan(), bench.resolution)
    kinds: tuple[Calibration, ...] = (
        ResponseCalibration(steps=16),
        LatencyCalibration(),
        DarkCalibration(),
        NoiseCalibration(),
        LeakCalibration(),
    )
    with ProgressDisplay(quiet=True) as progress:
        for one in kinds:
            at = folder / f"{one.kind}.session"
            sessions, _ = capture_all(one, setting, bench, at, progress, Notes().stop)
            calibrate(one, sessions, folder / f"{one.kind}.json", progress)
    (folder / "plan.toml").write_text(SINUSOIDS)
    return folder


def test_a_named_response_makes_sinusoids_straight_on_the_bench(profiles: Path) -> None:
    plan, files = plan_with_profiles(profiles / "plan.toml")
    raster = plan.projector.raster(plan.patterns[2], SIM.projector_px)
    light = (raster / 255.0) ** 2.2
    code = plan.patterns[2].code(SIM.projector_px)
    # Half a level at the steepest place is 2.2/510 of white, and half a per cent of the curve.
    assert np.abs(light - (code[..., np.newaxis] if light.ndim == 3 else code)).max() < 0.0094
    assert sorted(files) == ["dark", "latency", "response"]


def test_a_named_latency_sets_settling_unless_the_plan_does(profiles: Path) -> None:
    plan, _ = plan_with_profiles(profiles / "plan.toml")
    # 20 ms over a delay of nothing, rounded up to a millisecond.
    assert plan.projector.settle_s == pytest.approx(0.02, abs=0.0011)
    own = profiles / "own.toml"
    own.write_text(SINUSOIDS + "[projector]\nsettle_s = 0.7\n")
    assert plan_with_profiles(own)[0].projector.settle_s == 0.7


def test_a_session_holds_its_profiles_and_uses_them(profiles: Path, tmp_path: Path) -> None:
    plan, files = plan_with_profiles(profiles / "plan.toml")
    bench = simulated_bench(SIM)
    check_profiles(files, bench.description, plan.camera)
    session, _ = captured(tmp_path / "session", plan, bench)
    keep_profiles(files, session.folder)
    assert {use.kind for use in session.plan.calibration} == {"response", "latency", "dark"}
    found = profiles_for(session, [profiles / "noise.json", profiles / "leak.json"])
    assert {use.kind for use in found.uses} == {"dark", "noise", "leak"}
    assert found.hot is not None
    assert found.hot.shape == SIM.camera_px
    assert found.noise is not None
    assert found.noise.slope[0] == pytest.approx(1 / 20_000, rel=0.1)
    kept = session.folder / "profiles" / "dark.json"
    kept.write_text(kept.read_text().replace('"warnings": []', '"warnings": ["x"]'))
    with pytest.raises(ProfileError, match="is not the profile"):
        profiles_for(session, [])


def test_profiles_that_do_not_fit_are_refused(profiles: Path, tmp_path: Path) -> None:
    plan, files = plan_with_profiles(profiles / "plan.toml")
    other = simulated_bench(SIM.model_copy(update={"gamma": 1.8}))
    with pytest.raises(ProfileError, match="another bench"):
        check_profiles(files, other.description, plan.camera)
    session, _ = captured(tmp_path / "session", bench=simulated_bench(SIM))
    with pytest.raises(ProfileError, match="name it in the plan"):
        profiles_for(session, [profiles / "response.json"])
    with pytest.raises(ProfileError, match="a second leak profile"):
        profiles_for(session, [profiles / "leak.json"] * 2)
    wrong = profiles / "wrong.toml"
    wrong.write_text(SINUSOIDS.replace('dark = "dark.json"', 'dark = "leak.json"'))
    with pytest.raises(ProfileError, match=r"calibration\.dark"):
        plan_with_profiles(wrong)


def test_a_result_tells_the_key_figures_of_every_profile(profiles: Path, tmp_path: Path) -> None:
    plan, files = plan_with_profiles(profiles / "plan.toml")
    session, _ = captured(tmp_path / "session", plan, simulated_bench(SIM))
    keep_profiles(files, session.folder)
    told = {one.kind: one for one in profiles_for(session, [profiles / "noise.json"]).summaries}
    assert set(told) == {"noise", "dark", "response", "latency"}
    for kind, one in told.items():
        profile, digest = read_profile(profiles / f"{kind}.json")
        assert one.sha256 == digest
        assert one.measured == profile.measured
        assert one.page == f"{kind}.html"
        roles = [figure.role for figure in one.figures.values()]
        assert roles == sorted(roles), kind
        assert "found" in roles
        assert all(profile.quantities[name] == figure for name, figure in one.figures.items())
    assert all("residual" in [f.role for f in told[k].figures.values()] for k in ("noise", "dark"))
    (session.folder / "profiles" / "latency.json").unlink()
    lost = {one.kind: one for one in profiles_for(session, []).summaries}["latency"]
    assert lost.sha256 == told["latency"].sha256
    assert lost.figures == {}
    assert "missing" in lost.warnings[0]
