"""A calibration from its first plan to its profile."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from acquire.calibrating.finding import Calibration, Finding, Setting
from acquire.errors import ProfileError
from acquire.plan import Step
from acquire.profile_file import Profile, measured_at, session_use, write_profile
from acquire.recording import record
from acquire.rig import Bench
from acquire.sequencer import Outcome
from acquire.session import Session
from acquire.session.folder import write_durably
from acquire.session.records import versions
from calibration.errors import CalibrationError

MAX_SESSIONS = 20


class Observer(Protocol):
    """Hears of captures and of the fit."""

    def stage(self, name: str, total: int, done: int = 0) -> None:
        """A stage of `total` units begins, of which `done` are done already."""

    def advance(self) -> None:
        """One unit of the stage is done."""

    def frame_kept(self, step: Step, total: int) -> None:
        """Called after a frame and its line are on the disk."""

    def warning(self, message: str) -> None:
        """Called when the capture goes on, but a person should know why."""


@dataclass(frozen=True, slots=True)
class Calibrated:
    """A calibration and its profile as it was written."""

    profile: Profile
    finding: Finding


def capture_all(
    calibration: Calibration,
    setting: Setting,
    bench: Bench,
    folder: Path,
    observer: Observer,
    stop: threading.Event,
) -> tuple[list[Session], Outcome]:
    """Capture every plan of a calibration into ``folder/1``, ``2`` …; goes on where it stopped."""
    sessions: list[Session] = []
    while True:
        try:
            plan = calibration.plan(setting, sessions)
        except CalibrationError as error:
            raise _refusal(calibration, error) from error
        if plan is None:
            return sessions, Outcome.COMPLETE
        at = folder / str(len(sessions) + 1)
        done = len(Session.open(at).frames) if Session.exists(at) else 0
        observer.stage("capturing", len(plan), done)
        session, outcome = record(plan, bench, at, observer, stop, keep_unproven=True)
        if outcome is not Outcome.COMPLETE:
            return sessions, outcome
        sessions.append(session)


def recorded_sessions(folder: Path) -> list[Session]:
    """The sessions of a calibration that was captured: the folder itself, or its 1, 2 …."""
    paths = [folder]
    if not Session.exists(folder):
        numbered = [folder / str(number) for number in range(1, MAX_SESSIONS + 1)]
        paths = [path for path in numbered if Session.exists(path)]
    if not paths:
        raise ProfileError(
            f"There is no session at {folder}, nor at {folder / '1'}. Name the session of a "
            "calibration, or give --bench to capture one there."
        )
    sessions = [Session.open(path) for path in paths]
    for session in sessions:
        if not session.complete:
            raise ProfileError(
                f"{session.folder} holds {len(session.frames)} of {len(session.plan)} frames. Give "
                "the same command with --bench to go on with it."
            )
    return sessions


def calibrate(
    calibration: Calibration, sessions: Sequence[Session], out: Path, observer: Observer
) -> Calibrated:
    """Fit what was captured and write the profile.

    Raises
    ------
    ProfileError
        The frames cannot support a result; nothing is written.
    """
    observer.stage("fitting", 1)
    try:
        finding = calibration.fit(sessions, lambda: None)
    except CalibrationError as error:
        raise _refusal(calibration, error) from error
    observer.advance()
    last = sessions[-1]
    profile = Profile(
        kind=calibration.kind,
        measured=measured_at(last),
        bench=last.record.bench,
        camera=last.plan.camera,
        projector=last.plan.projector,
        sessions=tuple(session_use(session) for session in sessions),
        quantities=finding.quantities,
        curves=finding.curves,
        warnings=finding.warnings,
        versions=versions(),
    )
    for suffix, text in finding.beside.items():
        write_durably(out.with_suffix(suffix), text.encode())
    return Calibrated(write_profile(out, profile, finding.maps), finding)


def _refusal(calibration: Calibration, error: CalibrationError) -> ProfileError:
    return ProfileError(f"No {calibration.kind} profile can be had: {error}.")
