"""A result folder: cleared of an earlier result, and filled."""

from __future__ import annotations

import shutil
from pathlib import Path

from pydantic import JsonValue

from acquire.blanking import Unusable
from acquire.cluster import PARKED
from acquire.errors import ResultError
from acquire.methods import HARMONICS, Components
from acquire.pitches import SeparatedPitches
from acquire.result import (
    RECORD,
    ResultRecord,
    SessionSummary,
    write_record,
    write_tiff,
)
from acquire.session import Session
from acquire.session.folder import storage
from acquire.session.records import Caution, versions
from acquire.session.verification import incidents

OWN_NAMES = {
    RECORD,
    "components",
    "pitches",
    "white.tiff",
    "mask.tiff",
    "report.html",
    "deviations",
    "proof",
    HARMONICS,
    PARKED,
}


def prepare(folder: Path, session_folder: Path) -> None:
    """Clear an earlier result away; refuses a folder that holds anything else."""
    if folder.resolve() == session_folder.resolve():
        raise ResultError("--out is the session itself; a result needs a folder of its own.")
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise ResultError(f"{folder} is not a folder; give another --out.")
    strangers = (
        sorted({path.name for path in folder.iterdir()} - OWN_NAMES) if folder.exists() else []
    )
    if strangers:
        raise ResultError(
            f"{folder} holds {strangers[0]!r}, which is no part of a result; nothing was written. "
            "Give another --out."
        )
    with storage(folder):
        (folder / RECORD).unlink(missing_ok=True)
        for name in ("components", "deviations", "pitches", "proof", HARMONICS, PARKED):
            if (folder / name).is_symlink():
                (folder / name).unlink()
            shutil.rmtree(folder / name, ignore_errors=True)
        (folder / "components").mkdir(parents=True)


def fill(
    folder: Path, separated: SeparatedPitches, components: Components, record: ResultRecord
) -> None:
    """Write images and record, what could not be measured blanked; the record comes last."""
    unusable = Unusable.of(separated.mask)
    for pitch in separated.pitches:
        for path in (pitch.direct, pitch.global_):
            unusable.blank_file(folder / path)
    images = {
        **{f"components/{name}.tiff": image for name, image in components.images.items()},
        **{f"deviations/{name}.tiff": image for name, image in components.deviations.items()},
        "white.tiff": components.white,
    }
    for relative, image in images.items():
        unusable.blank(image)
        with storage(folder):
            (folder / relative).parent.mkdir(exist_ok=True)
        write_tiff(folder / relative, image)
    write_tiff(folder / "mask.tiff", separated.mask)
    write_record(folder, record)


def record_of(
    session: Session,
    separated: SeparatedPitches,
    components: Components,
    options: dict[str, JsonValue],
    found: tuple[Caution, ...],
) -> ResultRecord:
    """The record of a result made with some options, and what was found that weakens it."""
    height, width = separated.mask.shape
    notes = session.record.source.notes if session.record.source else ()
    told = (*notes, *found, *components.cautions)
    used = options | components.used
    return ResultRecord(
        method=str(used["method"]),
        options=used,
        components=tuple(components.images),
        shape=(height, width),
        pitches=separated.pitches,
        mixing=components.mixing,
        pca_shares=components.shares,
        convergence=components.cost,
        mask=separated.mask_record(),
        noise=components.noise,
        deviations=bool(components.deviations),
        warnings=tuple(caution.text for caution in told),
        cautions=told,
        drift=separated.references.record,
        exposures=separated.references.exposures,
        plan_sha256=session.plan.sha256,
        session=SessionSummary(
            plan_sha256=session.plan.sha256,
            frames=len(session.frames),
            bench=session.record.bench,
            source=session.record.source,
            camera=session.plan.camera,
            projector=session.plan.projector,
            runs=session.record.runs,
            incidents=tuple(incidents(session)),
            versions=session.record.versions,
        ),
        versions=versions(),
    )
