"""From a session to a result folder: separation at every pitch, decomposition, record."""

from __future__ import annotations

import shutil
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from pydantic import JsonValue

from acquire.cautions import cautions
from acquire.cluster import PARKED, Cluster, RemoteGatherer
from acquire.corrections import correct
from acquire.errors import ResultError, StackError
from acquire.methods import (
    HARMONICS,
    Components,
    Iva,
    Method,
    Ranges,
    check_components,
    obstacle_to_ranges,
)
from acquire.pitches import SeparatedPitches, blank_files, blank_unusable, separate_pitches
from acquire.profile_use import Profiles
from acquire.proof import keep_portraits, proof_of, proven
from acquire.references import read_references
from acquire.result import (
    RECORD,
    PixelClass,
    ProofRecord,
    Result,
    ResultRecord,
    SessionSummary,
    write_record,
    write_tiff,
)
from acquire.session import Session
from acquire.session.folder import storage
from acquire.session.records import Caution, versions
from acquire.session.verification import incidents
from acquire.stack import Stack
from drivers.image import Demosaic
from processing.patterns import Family

OWN_NUMBER = Caution(
    what="The number of components that was asked for had no effect.",
    meaning="ranges decides it by the evidence for subsurface scattering.",
    remedy="`--method iva` takes a number.",
)
METHODS = ("ranges", "iva")
INTERPOLATED = Caution(
    what="Two thirds of every frame's values are interpolated (`--demosaic bilinear`).",
    meaning="Neighbouring pixels share their light and their noise; standard errors of means over "
    "pixels are too small.",
    remedy="Process without it, and every value is one that was measured.",
)
NO_MOSAICS = Caution(
    what="`--demosaic` had no effect.",
    meaning="The frames are pictures, whose pixels are given; nothing else changed.",
    remedy="Leave it out for such sessions.",
)
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


@dataclass(frozen=True, slots=True)
class Options:
    """How a session is processed.

    Parameters
    ----------
    method
        One of `METHODS`; None takes ``ranges`` where the session allows it, else ``iva``.
    n_components, n_iterations, smoothing_px
        Of ``iva``: its number of components, 2 to the number of pitches plus one, None for the
        paper's 3 where there are pitches enough; its iterations; σ of the Gaussian before the
        gradients in pixels, None to choose it from the noise.
    leak
        b of the projector where no black frame was captured.
    demosaic
        How raw frames become pixels.
    drift_correction
        Whether smooth drift between the references is taken off the frames.
    """

    method: str | None = None
    n_components: int | None = None
    n_iterations: int = 10
    smoothing_px: float | None = None
    leak: float = 0.0
    demosaic: Demosaic = Demosaic.SUPERPIXEL
    drift_correction: bool = True


class Observer(Protocol):
    """Hears of the processing as it goes on."""

    def stage(self, name: str, total: int) -> None:
        """A stage of `total` units begins."""

    def advance(self) -> None:
        """One unit of the stage is done."""


# Of the decomposition, as progress shows it.
_STEPS = 50


class _Steps:
    """A part of the work done, as steps of a stage."""

    def __init__(self, observer: Observer) -> None:
        self._observer, self._reached = observer, 0

    def reach(self, part: float) -> None:
        """Advance to a part of the work in [0, 1]; never back."""
        while self._reached < int(part * _STEPS + 1e-6):
            self._reached += 1
            self._observer.advance()


def process(
    session: Session,
    folder: Path,
    options: Options,
    observer: Observer,
    cluster: Cluster | None = None,
    profiles: Profiles | None = None,
) -> Result:
    """Separate and decompose a session; whatever `folder` held of an earlier result is replaced.

    Parameters
    ----------
    session, folder
        What to process, and where the result goes.
    options
        How.
    observer
        Told of the progress.
    cluster
        Where the pitches are decoded and separated; here, if it is not given. Session and result
        lie on a file system that its workers share. The result is the same, bit for bit.
    profiles
        What calibrations say about the session.
    """
    profiles = profiles or Profiles()
    has_black = any(frame.pattern.family is Family.BLACK for frame in session.frames)
    if profiles.leak is not None and not options.leak and not has_black:
        options = replace(options, leak=profiles.leak)
    stack = Stack(session, options.demosaic)
    if profiles.hot is not None:
        stack.leave_out(profiles.hot)
    name, remark = _method_name(session, options)
    if name == "iva":
        check_components(len(stack.groups), options.n_components or 2)
    _prepare(folder, session.folder)
    method = _method(name, session, folder, options, profiles)
    try:
        observer.stage("separating", len(stack))
        gatherer = _gatherer(cluster, session, folder, options, method, observer)
        references = read_references(
            session, stack, observer.advance, correct_drift=options.drift_correction
        )
        separated = separate_pitches(
            stack, references, folder, options.leak, method.frame, observer.advance, gatherer
        )
        if not np.any(separated.mask == PixelClass.MEASURED):
            raise StackError(
                f"{session.folder}: no pixel can be measured; every one is saturated or unlit in "
                "some frame. Check the exposure and that the projector lit the scene."
            )
        separated = replace(separated, pitches=proven(session, separated.pitches))
        separated, noise = correct(folder, separated, options.leak, observer)
        observer.stage("decomposing", _STEPS)
        steps = _Steps(observer)
        components = method.decompose(folder, separated, steps.reach)
        steps.reach(1.0)
    finally:
        method.close()
        shutil.rmtree(folder / PARKED, ignore_errors=True)
    found = (*cautions(session, separated), *_interpolation(stack, options), *remark)
    used: dict[str, JsonValue] = {
        "method": name,
        "demosaic": options.demosaic if stack.has_mosaics else None,
    }
    if profiles.uses:
        used["profiles"] = {use.kind: use.sha256 for use in profiles.uses}
    proof = _proof(session, folder, observer)
    about = {"frame_noise": noise, "profiles": profiles.summaries, "proof": proof}
    record = _record(session, separated, components, asdict(options) | used, found)
    record = record.model_copy(update=about)
    _write(folder, separated, components, record)
    return Result(folder, record)


def _gatherer(
    cluster: Cluster | None,
    session: Session,
    folder: Path,
    options: Options,
    method: Method,
    observer: Observer,
) -> RemoteGatherer | None:
    """Who gathers the pitches; None for this process."""
    if cluster is None:
        return None
    heard = method.pitch if method.wants_harmonics else None
    task = (session, folder, options.demosaic, options.leak)
    return RemoteGatherer(cluster, *task, heard, observer.advance)


def _proof(session: Session, folder: Path, observer: Observer) -> ProofRecord | None:
    """What was found about the frames, with pictures of the worst."""
    proof = proof_of(session)
    if proof is None:
        return None
    worst = keep_portraits(
        session, folder, lambda total: observer.stage("looking back", total), observer.advance
    )
    return proof.model_copy(update={"worst": worst})


def _method_name(session: Session, options: Options) -> tuple[str, tuple[Caution, ...]]:
    """The method to use, and a remark when it is not the best one."""
    if options.method not in (None, *METHODS):
        raise ResultError(f"No method {options.method!r}; there are {', '.join(METHODS)}.")
    if options.method is not None:
        given = options.method == "ranges" and options.n_components is not None
        return options.method, (OWN_NUMBER,) if given else ()
    obstacle = obstacle_to_ranges(session)
    if obstacle is None:
        given = options.n_components is not None
        return "ranges", (OWN_NUMBER,) if given else ()
    return "iva", (
        Caution(
            what="Decomposed by independent vector analysis, because the default method cannot be "
            f"used: {obstacle}.",
            meaning="The components have no standard errors, and nothing keeps them from being "
            "negative.",
            remedy="Capture with the shifts of `lumisplit plan --example` for the default method.",
        ),
    )


def _interpolation(stack: Stack, options: Options) -> tuple[Caution, ...]:
    """What a reader must know of pixels that were not measured."""
    if options.demosaic is Demosaic.SUPERPIXEL:
        return ()
    return (INTERPOLATED if stack.has_mosaics else NO_MOSAICS,)


def _method(
    name: str, session: Session, folder: Path, options: Options, profiles: Profiles
) -> Method:
    if name == "ranges":
        return Ranges(session, folder, profiles)
    return Iva(options.n_components, options.n_iterations, options.smoothing_px)


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
        for name in ("components", "deviations", "pitches", "proof", PARKED):
            if (folder / name).is_symlink():
                (folder / name).unlink()
            shutil.rmtree(folder / name, ignore_errors=True)
        (folder / "components").mkdir(parents=True)


def _write(
    folder: Path, separated: SeparatedPitches, components: Components, record: ResultRecord
) -> None:
    blank_files(folder, separated)
    images = {
        **{f"components/{name}.tiff": image for name, image in components.images.items()},
        **{f"deviations/{name}.tiff": image for name, image in components.deviations.items()},
        "white.tiff": components.white,
    }
    for relative, image in images.items():
        blank_unusable(image, separated.mask)
        with storage(folder):
            (folder / relative).parent.mkdir(exist_ok=True)
        write_tiff(folder / relative, image)
    write_tiff(folder / "mask.tiff", separated.mask)
    write_record(folder, record)


def _record(
    session: Session,
    separated: SeparatedPitches,
    components: Components,
    options: dict[str, JsonValue],
    found: tuple[Caution, ...],
) -> ResultRecord:
    height, width = separated.mask.shape
    notes = session.record.source.notes if session.record.source else ()
    told = (*notes, *found, *components.cautions)
    return ResultRecord(
        method=str(options["method"]),
        options=options | components.used,
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
