"""From a session to a result folder: separation at every pitch, decomposition, record."""

from __future__ import annotations

import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from acquire.cautions import cautions
from acquire.errors import ResultError, StackError
from acquire.pitches import (
    SeparatedPitches,
    blank_files,
    blank_unusable,
    open_rows,
    separate_pitches,
)
from acquire.result import (
    RECORD,
    MixingRecord,
    PixelClass,
    Result,
    ResultRecord,
    SessionSummary,
    write_record,
    write_tiff,
)
from acquire.session import Session
from acquire.session.folder import storage
from acquire.session.records import versions
from acquire.stack import Stack
from processing.decomposition import Decomposition, decompose_iva
from processing.patterns import Family

METHODS = ("iva",)
OWN_NAMES = {RECORD, "components", "pitches", "white.tiff", "mask.tiff", "report.html"}


@dataclass(frozen=True, slots=True)
class Options:
    """How a session is processed.

    Parameters
    ----------
    method
        One of `METHODS`.
    n_components
        Number of components, 2 to the number of pitches plus one.
    n_iterations
        AuxIVA iterations.
    smoothing_px
        σ of the Gaussian before the gradients, in pixels; None chooses it from the noise.
    leak
        b of the projector where no black frame was captured.
    """

    method: str = "iva"
    n_components: int = 3
    n_iterations: int = 10
    smoothing_px: float | None = None
    leak: float = 0.0


class Observer(Protocol):
    """Hears of the processing as it goes on."""

    def stage(self, name: str, total: int) -> None:
        """A stage of `total` units begins."""

    def advance(self) -> None:
        """One unit of the stage is done."""


def process(session: Session, folder: Path, options: Options, observer: Observer) -> Result:
    """Separate and decompose a session; whatever `folder` held of an earlier result is replaced."""
    stack = Stack(session)
    _check(stack, options)
    _prepare(folder, session.folder)
    observer.stage("separating", len(stack))
    separated = separate_pitches(stack, folder, options.leak, observer.advance)
    if not np.any(separated.mask == PixelClass.MEASURED):
        raise StackError(
            f"{session.folder}: no pixel can be measured; every one is saturated or unlit in some "
            "frame. Check the exposure and that the projector lit the scene."
        )
    observer.stage("decomposing", 1)
    _check_components(len(separated.resolved), options, "resolved ")
    decomposition = _decompose(folder, separated, options)
    observer.advance()
    record = _write(session, folder, separated, decomposition, options)
    return Result(folder, record)


def _check(stack: Stack, options: Options) -> None:
    if options.method not in METHODS:
        raise ResultError(f"No method {options.method!r}; there are {', '.join(METHODS)}.")
    _check_components(len(stack.groups), options, "")


def _check_components(n_pitches: int, options: Options, resolved: str) -> None:
    rows = n_pitches + 1
    if not 2 <= options.n_components <= rows:
        raise ResultError(
            f"--components {options.n_components}: {n_pitches} {resolved}pitch(es) and white light "
            f"give {rows} observations of a pixel, so 2 to {rows} components can be told apart."
        )


def _prepare(folder: Path, session_folder: Path) -> None:
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
        for name in ("components", "pitches"):
            if (folder / name).is_symlink():
                (folder / name).unlink()
            shutil.rmtree(folder / name, ignore_errors=True)
        (folder / "components").mkdir(parents=True)


def _decompose(folder: Path, separated: SeparatedPitches, options: Options) -> Decomposition:
    return decompose_iva(
        [*open_rows(folder, separated.resolved), separated.white],
        [*(float(pitch.pitch_px) for pitch in separated.resolved), np.inf],
        separated.mask == PixelClass.MEASURED,
        n_components=options.n_components,
        n_iterations=options.n_iterations,
        smoothing_px=options.smoothing_px,
    )


def _write(
    session: Session,
    folder: Path,
    separated: SeparatedPitches,
    decomposition: Decomposition,
    options: Options,
) -> ResultRecord:
    blank_files(folder, separated)
    images: dict[str, NDArray[np.float32]] = {
        f"components/{name}.tiff": image
        for name, image in zip(decomposition.names, decomposition.components, strict=True)
    }
    for relative, image in (images | {"white.tiff": separated.white}).items():
        blank_unusable(image, separated.mask)
        write_tiff(folder / relative, image)
    write_tiff(folder / "mask.tiff", separated.mask)
    record = _record(session, separated, decomposition, options)
    write_record(folder, record)
    return record


def _record(
    session: Session,
    separated: SeparatedPitches,
    decomposition: Decomposition,
    options: Options,
) -> ResultRecord:
    return ResultRecord(
        method=options.method,
        options=asdict(options) | {"smoothing_px_used": decomposition.smoothing_px},
        components=decomposition.names,
        shape=separated.mask.shape,
        pitches=separated.pitches,
        mixing=MixingRecord(
            families=(*(pitch.family for pitch in separated.resolved), Family.WHITE),
            pitch_px=(*(pitch.pitch_px for pitch in separated.resolved), None),
            alpha=decomposition.mixing.tolist(),
        ),
        pca_shares=decomposition.shares.tolist(),
        convergence=decomposition.cost.tolist(),
        mask=separated.mask_record(),
        noise=decomposition.noise,
        warnings=(*cautions(session, separated), *decomposition.warnings),
        plan_sha256=session.plan.sha256,
        session=SessionSummary(
            plan_sha256=session.plan.sha256,
            frames=len(session.frames),
            bench=session.record.bench,
            source=session.record.source,
            camera=session.plan.camera,
            projector=session.plan.projector,
            runs=session.record.runs,
            versions=session.record.versions,
        ),
        versions=versions(),
    )
