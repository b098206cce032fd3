"""Frames against a geometry profile: rasters that stand elsewhere are found when they are taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from acquire.calibrating.geometry import GeometryCalibration
from acquire.errors import ProofError
from acquire.plan import ProfileUse
from acquire.profile_file import (
    Profile,
    Quantity,
    SessionUse,
    read_maps,
    read_profile,
    write_profile,
)
from acquire.proof import Recorded, read_proofs, verdict
from acquire.recording import record
from acquire.rig import Bench
from acquire.rig.simulated import simulated_bench
from acquire.session import Session
from drivers.protocols import Raster
from drivers.sim.devices import SimulationConfig, build
from processing.proof.finding import Finding
from tests.acquire.captures import SMALL_SIM, Notes, captured, recorded_bytes, small_plan
from tests.acquire.faults import Faults, with_faults

PLAN = small_plan("[pattern]\npitch_px = [8, 12, 16]\nshifts = [4, 2]\n")
SIM = SMALL_SIM.model_copy(
    update={
        "camera_px": (48, 64),
        "projector_px": (144, 192),
        "full_well_e": 2500.0,
        "read_noise_e": 25.0,
    }
)
MIDDLE = [pattern for pattern in PLAN.patterns if pattern.pitch_px == 12]  # steps 10 to 17


def bench(**changes: object) -> Bench:
    return simulated_bench(SIM.model_copy(update=changes))


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Places as the scene has them, to a tenth of a pixel, as the calibration would write them."""
    places = build(
        SimulationConfig(SIM.scene, 0, SIM.camera_px, SIM.projector_px)
    ).projector_coordinates()
    places = places + np.random.default_rng(1).normal(0, 0.1, places.shape)
    path = tmp_path_factory.mktemp("profile") / "geometry.json"
    about = Profile(
        kind=GeometryCalibration().kind,
        measured="unknown",
        bench={"kind": "sim", "sim": SIM.model_dump(mode="json")},
        camera=PLAN.camera,
        projector=PLAN.projector,
        sessions=(SessionUse(plan_sha256="0" * 64, frames_sha256="0" * 64, frames=1),),
        quantities={},
        versions={},
    )
    maps = {"column": places[..., 1].astype(np.float32), "row": places[..., 0].astype(np.float32)}
    write_profile(path, about, maps)
    return path


def rolled(raster: Raster, right: int) -> Raster:
    return np.roll(raster, right, 1)


def told(session: Session) -> str:
    return "\n".join(verdict(session, list(Recorded(session).proofs(lambda: None))))


def taken(
    folder: Path,
    where: Bench,
    profile: Path,
    notes: Notes | None = None,
    *,
    keep_unproven: bool = False,
) -> Session:
    notes = notes or Notes()
    use = ProfileUse(kind="geometry", sha256=read_profile(profile)[1])
    plan = PLAN.model_copy(update={"calibration": (use,)})
    session, _ = record(
        plan,
        where,
        folder,
        notes,
        notes.stop,
        keep_unproven=keep_unproven,
        profiles={"geometry": profile},
    )
    return session


@pytest.mark.parametrize(
    "conditions",
    [
        pytest.param({}, id="noise of 2 and 1 %"),
        pytest.param({"blur_px": 1.0, "gamma": 2.2, "black_level": 0.02}, id="blurred"),
        pytest.param({"drift": 0.2, "flicker": 0.2, "ambient": 0.2}, id="unsteady light"),
        pytest.param({"move_px": 0.5}, id="moved"),
    ],
)
def test_right_frames_are_left_alone(
    tmp_path: Path, profile: Path, conditions: dict[str, float]
) -> None:
    notes = Notes()
    session = taken(tmp_path / "s", bench(**conditions), profile, notes)
    assert notes.warnings == []
    proofs = read_proofs(session.folder)
    matches = [proofs[step, 0].match for step in range(2, len(PLAN))]
    assert min(match for match in matches if match is not None) > 0.5
    assert None not in matches
    assert told(session).splitlines()[1:] == [] or "drift" in conditions or "move_px" in conditions


@pytest.mark.parametrize(
    ("defect", "words"),
    [
        pytest.param({"slip_px": 5}, r"5 px to the right.*like 3 exposures before", id="moved"),
        pytest.param({"zoom": -1.0}, r"elsewhere on the scene", id="turned"),
        pytest.param(
            {"zoom": 1.25}, r"in part only|what its pattern predicts", id="scaled a little"
        ),
        pytest.param({"zoom": 1.5}, r"does not show what its pattern predicts", id="scaled"),
    ],
)
def test_a_picture_that_stands_elsewhere_from_some_frame_on_stops_the_capture(
    tmp_path: Path, profile: Path, defect: dict[str, float], words: str
) -> None:
    with pytest.raises(ProofError, match=words):
        taken(tmp_path / "s", bench(**defect), profile)
    # The second half begins with the fourth frame of the second pitch, of eight.
    assert 17 <= len(Session.open(tmp_path / "s").frames) <= 18


def test_frames_that_agree_with_each_other_elsewhere_are_taken_again(
    tmp_path: Path, profile: Path
) -> None:
    good = taken(tmp_path / "good", bench(), profile)
    faults = Faults(shown=lambda number, raster: rolled(raster, 8 * (number in {10, 11, 12})))
    session = taken(tmp_path / "s", with_faults(bench(), faults), profile)
    again = [line.step for line in session.lines if line.attempt]
    assert sorted(again) == [10, 11, 12]
    assert len(good.lines) == len(good.frames)
    found = read_proofs(session.folder)
    assert {found[step, 0].finding for step in again} == {Finding.MISPLACED}
    assert not any(found[frame.step, frame.attempt].is_wrong for frame in session.frames)


def test_a_session_kept_all_the_same_says_which_pitch_stands_where(
    tmp_path: Path, profile: Path
) -> None:
    those = {PLAN.projector.raster(one, SIM.projector_px).tobytes() for one in MIDDLE}
    faults = Faults(shown=lambda _, raster: rolled(raster, 5 * (raster.tobytes() in those)))
    session = taken(tmp_path / "s", with_faults(bench(), faults), profile, keep_unproven=True)
    assert "The frames of checker of 12 px stand 5 px to the right" in told(session)
    assert "16 px" not in told(session).partition("stand")[0]


@pytest.mark.parametrize("family", ["checker", "stripes-columns"])
def test_without_a_profile_the_other_pitches_tell_of_one_that_stands_elsewhere(
    tmp_path: Path, family: str
) -> None:
    text = f'[pattern]\nfamily = "{family}"\npitch_px = [8, 10, 12, 18]\nshifts = [4, 3]\n'
    plan = small_plan(text.replace("[4, 3]", "[6, 6]" if "stripes" in family else "[4, 3]"))
    those = {
        plan.projector.raster(pattern, SIM.projector_px).tobytes()
        for pattern in plan.patterns
        if pattern.pitch_px == 12
    }
    faults = Faults(shown=lambda _, raster: rolled(raster, 7 * (raster.tobytes() in those)))
    notes, good_notes = Notes(), Notes()
    session, _ = captured(tmp_path / "s", plan, with_faults(bench(), faults), notes)
    good, _ = captured(tmp_path / "good", plan, bench(), good_notes)
    (said,) = notes.warnings
    assert f"The frames of {family} of 12 px" in said
    assert good_notes.warnings == []
    for one, expected in ((session, [said]), (good, [])):
        recorded = Recorded(one)
        assert not any(proof.is_wrong for proof in recorded.proofs(lambda: None))
        assert recorded.disagreements() == expected


def test_interrupted_it_ends_in_the_same_bytes(tmp_path: Path, profile: Path) -> None:
    where = bench(late=0.05, seed=3)
    whole = taken(tmp_path / "whole", where, profile)
    assert len(whole.lines) > len(whole.frames)
    for stop_after in (9, 21):
        folder = tmp_path / f"cut-{stop_after}"
        taken(folder, where, profile, Notes(stop_after=stop_after))
        taken(folder, where, profile)
        assert recorded_bytes(folder) == recorded_bytes(whole.folder)


def test_a_profile_of_a_board_or_one_that_was_lost_is_not_used_and_that_is_said(
    tmp_path: Path, profile: Path
) -> None:
    found, _ = read_profile(profile)
    board = tmp_path / "board.json"
    lens = Quantity(meaning="of a board", unit="px", value=(0.1,))
    content = found.model_copy(update={"quantities": {"reprojection_px": lens}})
    write_profile(board, content, read_maps(profile, found))
    session = taken(tmp_path / "s", bench(slip_px=5), board)
    assert "No frame was compared with the plan's geometry profile" in told(session)
    session = taken(tmp_path / "t", bench(), profile)
    (session.folder / "profiles" / "geometry.npz").unlink()
    assert "No frame was compared with the plan's geometry profile" in told(session)
