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
from acquire.corrections import correct, frame_noise
from acquire.errors import ResultError, StackError
from acquire.exposure_cautions import exposure_cautions
from acquire.exposures import find_exposures
from acquire.frames import Reading
from acquire.gathering import Gatherer, LocalGatherer
from acquire.methods import (
    Components,
    Iva,
    Method,
    Pairs,
    Ranges,
    check_components,
    obstacle_to_ranges,
)
from acquire.pitches import SeparatedPitches, separate_pitches
from acquire.profile_cautions import for_photosites, profile_cautions
from acquire.profile_use import Profiles
from acquire.proof import keep_portraits, proof_of, proven
from acquire.references import References, read_references
from acquire.result import (
    FrameNoiseRecord,
    PixelClass,
    ProofRecord,
    Result,
)
from acquire.result_folder import fill, prepare, record_of
from acquire.session import Session
from acquire.session.records import Caution
from acquire.stack import Stack
from drivers.image import Demosaic
from processing.frames.frame_noise import FrameNoise
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
    gain_correction, tone_correction
        Whether frames of an imported stack are divided by the gains, and freed from the tone
        curve, that they are found to have.
    """

    method: str | None = None
    n_components: int | None = None
    n_iterations: int = 10
    smoothing_px: float | None = None
    leak: float = 0.0
    demosaic: Demosaic = Demosaic.SUPERPIXEL
    drift_correction: bool = True
    gain_correction: bool = True
    tone_correction: bool = True


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
    given = profiles or Profiles()
    options = _with_leak(session, options, given)
    stack = Stack(session, Reading(options.demosaic, given.black))
    if given.hot is not None:
        stack.leave_out(given.hot)
    used, unused = _suiting(stack, options, given)
    obstacle = _obstacle(session, stack, options)
    prepare(folder, session.folder)
    exposures = find_exposures(
        session,
        stack.reading,
        lambda total: observer.stage("comparing exposures", total),
        observer.advance,
        correct_gains=options.gain_correction,
        correct_tone=options.tone_correction,
    )
    if exposures is not None:
        stack.reading = replace(stack.reading, curve=exposures.curve)
    observer.stage("separating", len(stack))
    references = read_references(
        session, stack, observer.advance, exposures, correct_drift=options.drift_correction
    )
    drift = references.levels.drift
    if drift is not None and used.noise is not None:
        used = replace(used, noise=drift.noise(used.noise, len(session.lines)))
    work = _Work(session, folder, options, used, stack, references, obstacle)
    separated, noise, components, measured = work.done(observer, cluster)
    by_ranges = components.used["method"] == "ranges"
    found = (
        *cautions(session, separated),
        *exposure_cautions(separated.references.exposures),
        *profile_cautions(separated, used.noise, measured),
        *_interpolation(stack, options),
        *unused,
        *((OWN_NUMBER,) if by_ranges and options.n_components is not None else ()),
    )
    said = _options_said(stack, options, used)
    proof = _proof(session, folder, observer)
    about = {"frame_noise": noise, "profiles": given.summaries, "proof": proof}
    record = record_of(session, separated, components, said, found).model_copy(update=about)
    fill(folder, separated, components, record)
    return Result(folder, record)


@dataclass(frozen=True, slots=True)
class _Work:
    """A session whose references are read."""

    session: Session
    folder: Path
    options: Options
    profiles: Profiles
    stack: Stack
    references: References
    obstacle: str | None

    def done(
        self, observer: Observer, cluster: Cluster | None
    ) -> tuple[SeparatedPitches, FrameNoiseRecord | None, Components, FrameNoise | None]:
        """The pitches, the noise that they were freed from, the components, the noise measured."""
        profiles, leak = self.profiles, self.options.leak
        method = self._method()
        try:
            if self.references.levels.lit is not None:
                method.white(self.references.levels.lit)
            separated = separate_pitches(
                self.stack,
                self.references,
                self.folder,
                leak,
                self._gatherer(method, observer, cluster),
                method.pitch,
                profiles.contrast,
            )
            if not np.any(separated.mask == PixelClass.MEASURED):
                raise StackError(
                    f"{self.session.folder}: no pixel can be measured; every one is saturated or "
                    "unlit in some frame. Check the exposure and that the projector lit the scene."
                )
            separated = replace(separated, pitches=proven(self.session, separated.pitches))
            separated, noise = correct(
                self.folder, separated, leak, observer, profiles.noise, profiles.contrast
            )
            observer.stage("decomposing", _STEPS)
            steps = _Steps(observer)
            components = method.decompose(self.folder, separated, steps.reach)
            steps.reach(1.0)
        finally:
            method.close()
            shutil.rmtree(self.folder / PARKED, ignore_errors=True)
        return separated, noise, components, frame_noise(separated)

    def _method(self) -> Method:
        """What takes the scene apart, by the option or else by what the frames allow."""
        chosen = self.options.method
        iva = Iva(self.options.n_components, self.options.n_iterations, self.options.smoothing_px)
        if chosen == "iva":
            return iva
        ranges = Ranges(self.session, self.folder, self.profiles) if not self.obstacle else None
        if ranges is not None and not all(len(one.frames) == 2 for one in self.stack.groups):
            return ranges
        return Pairs(self.obstacle, None if chosen == "ranges" else iva, ranges)

    def _gatherer(self, method: Method, observer: Observer, cluster: Cluster | None) -> Gatherer:
        leak, wanted, advance = self.options.leak, method.wants_harmonics, observer.advance
        if cluster is None:
            return LocalGatherer(leak, wanted, advance)
        place = self.session, self.folder, self.stack.reading
        return RemoteGatherer(cluster, *place, leak, wanted, advance)


def _with_leak(session: Session, options: Options, profiles: Profiles) -> Options:
    """The options with the leak of a profile, where no black frame tells better."""
    has_black = any(frame.pattern.family is Family.BLACK for frame in session.frames)
    if profiles.leak is None or options.leak or has_black:
        return options
    return replace(options, leak=profiles.leak)


def _suiting(
    stack: Stack, options: Options, profiles: Profiles
) -> tuple[Profiles, tuple[Caution, ...]]:
    """The profiles that hold for pixels as they are read."""
    if options.demosaic is Demosaic.SUPERPIXEL or not stack.has_mosaics:
        return profiles, ()
    return for_photosites(profiles)


def _options_said(stack: Stack, options: Options, profiles: Profiles) -> dict[str, JsonValue]:
    """The options as they were used."""
    said: dict[str, JsonValue] = asdict(options)
    said |= {"demosaic": options.demosaic if stack.has_mosaics else None}
    if profiles.uses:
        said["profiles"] = {use.kind: use.sha256 for use in profiles.uses}
    return said


def _proof(session: Session, folder: Path, observer: Observer) -> ProofRecord | None:
    """What was found about the frames, with pictures of the worst."""
    proof = proof_of(session)
    if proof is None:
        return None
    worst = keep_portraits(
        session, folder, lambda total: observer.stage("looking back", total), observer.advance
    )
    return proof.model_copy(update={"worst": worst})


def _interpolation(stack: Stack, options: Options) -> tuple[Caution, ...]:
    """What a reader must know of pixels that were not measured."""
    if options.demosaic is Demosaic.SUPERPIXEL:
        return ()
    return (INTERPOLATED if stack.has_mosaics else NO_MOSAICS,)


def _obstacle(session: Session, stack: Stack, options: Options) -> str | None:
    """Why places cannot be found in the patterns; refuses what the options then exclude."""
    if options.method not in (None, *METHODS):
        raise ResultError(f"No method {options.method!r}; there are {', '.join(METHODS)}.")
    obstacle = obstacle_to_ranges(session)
    may_be_extrema = all(len(group.frames) == 2 for group in stack.groups)
    if options.method == "ranges" and obstacle and not may_be_extrema:
        raise StackError(f"{obstacle}; `--method iva` takes such sessions.")
    if options.method == "iva" or (obstacle and not options.method):
        check_components(len(stack.groups), options.n_components or 2)
    return obstacle
