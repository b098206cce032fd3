"""A capture from plan and bench to a session folder, new or gone on with."""

from __future__ import annotations

import io
import threading
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from acquire.bench_file import SimSection
from acquire.bench_identity import is_same_bench
from acquire.errors import SessionError
from acquire.pause import Pause
from acquire.plan import Plan
from acquire.plan_file import check_fits
from acquire.profile_use import keep_profiles
from acquire.rig import Bench, Resumption
from acquire.sequencer import Journal, Observer, Outcome, capture
from acquire.session import Session, SessionRecord
from acquire.session.folder import write_durably
from acquire.session.log import Kind
from acquire.session.records import host, versions
from acquire.session.recovery import recover, remedy
from acquire.storage import check_room

TRUTH = "truth.npz"
ROOM_KEPT_BYTES = 64 << 20


def record(
    plan: Plan,
    bench: Bench,
    folder: Path,
    observer: Observer,
    stop: threading.Event,
    pause: Pause | None = None,
    *,
    keep_unproven: bool = False,
    mend: bool = False,
    profiles: Mapping[str, Path] | None = None,
) -> tuple[Session, Outcome]:
    """Capture a plan into a folder; goes on where an interrupted capture stopped.

    With `mend` the last frames are taken again where their files were lost or damaged since. The
    `profiles` that the plan names, their files by kind, are copied into the session.

    Raises
    ------
    PlanError
        The bench's projector cannot show the plan.
    SessionError
        The folder holds something else, or was begun with another plan or bench.
    DriverError, StorageError
        As from `acquire.sequencer.capture`.
    """
    check_fits(plan, bench.resolution, bench.name)
    with Session.locked(folder):
        session = _session(plan, bench, folder)
        keep_profiles(profiles or {}, folder)
        repairs = recover(session, mend=mend)
        missing = len(plan) - len(session.frames)
        was_complete = session.record.runs and session.record.runs[-1].outcome == "complete"
        # Of what was dropped to be mended nothing may be missing but a second attempt.
        if missing == 0 and was_complete and not repairs:
            _check_there(session)
            return session, Outcome.COMPLETE
        check_room(folder, missing * bench.frame_bytes + ROOM_KEPT_BYTES)
        _write_truth(plan, bench, folder)
        last_file = session.read(session.lines[-1]) if session.lines else None
        with bench.open(Resumption(plan, session.lines, last_file)) as devices:
            if devices.camera_body:
                session.know_camera(devices.camera_body)
            journal = Journal(session, devices.clock, observer)
            for repair in repairs:
                journal.note(repair, Kind.REPAIR)
            outcome = capture(session, devices, observer, stop, pause, keep_unproven=keep_unproven)
    return session, outcome


def described(bench: Bench) -> dict[str, JsonValue]:
    """What a session records of a bench."""
    return bench.description | {"projector_px": list(bench.resolution)}


def _session(plan: Plan, bench: Bench, folder: Path) -> Session:
    description = described(bench)
    if not Session.exists(folder):
        opening = SessionRecord(
            plan_sha256=plan.sha256, bench=description, versions=versions(), host=host()
        )
        return Session.create(folder, plan, opening)
    session = Session.open(folder)
    if session.plan.sha256 != plan.sha256:
        raise SessionError(
            f"{folder} was begun with another plan; a session is captured with one. Give the plan "
            "it was begun with, or another --out."
        )
    if not is_same_bench(_completed(session.record.bench), _completed(description)):
        raise SessionError(
            f"{folder} was begun on another bench (or the bench file was changed since); a session "
            "is captured on one. Give that bench, or another --out."
        )
    return session


def _check_there(session: Session) -> None:
    """Refuse to call a capture complete whose files are obviously not there any more."""
    for number, frame in enumerate(session.lines):
        path = session.folder / frame.file
        if not path.exists() or path.stat().st_size != frame.size_bytes:
            raise SessionError(
                f"{path} is missing or damaged. {remedy(session, number)} `lumisplit verify "
                f"{session.folder}` lists everything that is wrong."
            )


def _completed(bench: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """A bench's description; defects that were unknown when it was written are off."""
    simulation = bench.get("sim")
    if bench.get("kind") != "sim" or not isinstance(simulation, dict):
        return bench
    defaults = SimSection().model_dump(mode="json", exclude={"real_time"})
    return bench | {"sim": defaults | simulation}


def _write_truth(plan: Plan, bench: Bench, folder: Path) -> None:
    truth = bench.truth(plan)
    if truth is None or (folder / TRUTH).exists():
        return
    buffer = io.BytesIO()
    direct, subsurface, interreflection = (
        truth[name].astype(np.float32) for name in ("direct", "subsurface", "interreflection")
    )
    np.savez_compressed(
        buffer, direct=direct, subsurface=subsurface, interreflection=interreflection
    )
    write_durably(folder / TRUTH, buffer.getvalue())
