"""The ways of taking a scene apart: what each wants of the frames and what it yields."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from acquire.errors import StackError
from acquire.parked import ParkedImages
from acquire.pitches import SeparatedPitches, open_rows
from acquire.profile_use import Profiles
from acquire.result import MixingRecord, PixelClass
from acquire.session import Session
from acquire.session.folder import storage
from acquire.session.records import Caution
from processing.frames.gathering import HarmonicsStack
from processing.frames.harmonics import PitchHarmonics
from processing.independence.decomposition import decompose_iva
from processing.patterns import Family, Pattern
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.extrema import decompose_extrema
from processing.ranges.result import RangeDecomposition
from processing.remarks import Remark

Image = NDArray[np.float32]
HARMONICS = ".harmonics"
PAPERS_COMPONENTS = 3
# Where a projector's size was not recorded, its pixels are looked for within the largest there is.
LARGEST_PROJECTOR_PX = 2400, 4096
IVA_INTERVAL = (
    "95 % confidence of α as the separation found it, by separating again without each tenth of "
    "the picture, the principal components given"
)
RANGES_INTERVAL = (
    "95 % confidence of the mean over the scene, by leaving out one of its 8 × 8 tiles at a time; "
    "it holds noise and how the scene varies, no error that all pixels share (blur, references), "
    "and single places differ by far more"
)
FROM_EXTREMA = Caution(
    what="Every pitch has two frames, of which one is nowhere darker than the other: they were "
    "taken for the largest and smallest value over many shifts, and ranges were found from them "
    "alone.",
    meaning="No places in the patterns are known: the noise of the extreme frames and shifts that "
    "miss the middle of a check enter in full, and translucent objects are recognised less well. "
    "What the import says of two shifts does not hold for extrema.",
    remedy="Capture or import all frames of every pitch where they exist.",
)

# Told the part of the work that is done, rising to 1.
Told = Callable[[float], object]


@dataclass(frozen=True, slots=True)
class Components:
    """What a method yields.

    Parameters
    ----------
    images
        Name and float32 (height, width, 3) image of each component, in order.
    deviations
        Standard error of each, where the method knows it.
    white
        float32, (height, width, 3), what the components add up to.
    mixing
        α against pitch.
    noise
        Standard deviation of a frame, fraction of full scale; None where it is unknown.
    shares, cost
        PCA shares and convergence, where the method has them.
    used
        Options as they were chosen by the method itself.
    cautions
        What a reader must know.
    """

    images: dict[str, Image]
    deviations: dict[str, Image]
    white: Image
    mixing: MixingRecord
    noise: float | None
    shares: tuple[float, ...] = ()
    cost: tuple[float, ...] = ()
    used: dict[str, JsonValue] = field(default_factory=dict)
    cautions: tuple[Caution, ...] = ()


class Method(Protocol):
    """A decomposition: told of every pitch once, then yields components."""

    @property
    def wants_harmonics(self) -> bool:
        """Whether the frames of each pitch must be gathered as its harmonics."""
        ...

    def white(self, lit: Image) -> None:
        """White less black light; before any pitch, where there is such a frame."""

    def pitch(self, gathered: PitchHarmonics) -> None:
        """The frames of a pitch, where harmonics are wanted; they are not kept by others."""

    def decompose(self, folder: Path, separated: SeparatedPitches, told: Told) -> Components:
        """Components from what was seen and from the separated pitches in `folder`."""

    def close(self) -> None:
        """Remove what was parked on the disk."""


class Iva:
    """Independent vector analysis, as in the paper; see `processing.independence.decomposition`."""

    def __init__(
        self, n_components: int | None, n_iterations: int, smoothing_px: float | None
    ) -> None:
        self._n_components, self._n_iterations = n_components, n_iterations
        self._smoothing_px = smoothing_px

    @property
    def wants_harmonics(self) -> bool:
        """See `Method.wants_harmonics`."""
        return False

    def white(self, lit: Image) -> None:
        """The separated pitches are all it needs."""

    def pitch(self, gathered: PitchHarmonics) -> None:
        """The separated pitches are all it needs."""

    def close(self) -> None:
        """Nothing was parked."""

    def decompose(
        self,
        folder: Path,
        separated: SeparatedPitches,
        told: Told,
    ) -> Components:
        """Unmix the direct images of the resolved pitches and white."""
        resolved = separated.resolved
        n_components = self._n_components or min(PAPERS_COMPONENTS, len(resolved) + 1)
        check_components(len(resolved), n_components, "resolved ")
        try:
            found = decompose_iva(
                [*open_rows(folder, resolved), separated.white],
                [*(float(pitch.pitch_px) for pitch in resolved), np.inf],
                separated.mask == PixelClass.MEASURED,
                n_components=n_components,
                n_iterations=self._n_iterations,
                smoothing_px=self._smoothing_px,
                progress=told,
            )
        except ValueError as error:
            raise StackError(
                f"Independent vector analysis finds nothing to hold on to here: {error}. The "
                "direct and global images of single pitches need no decomposition."
            ) from error
        return Components(
            images=dict(zip(found.names, found.components, strict=True)),
            deviations={},
            white=separated.white,
            mixing=MixingRecord(
                families=(*(pitch.family for pitch in resolved), Family.WHITE),
                pitch_px=(*(pitch.pitch_px for pitch in resolved), None),
                alpha=found.mixing.tolist(),
                half_width=_or_none(found.mixing_half_width),
                interval=IVA_INTERVAL,
            ),
            noise=found.noise,
            shares=tuple(found.shares.tolist()),
            cost=tuple(found.cost.tolist()),
            used={
                "method": "iva",
                "n_components": n_components,
                "significant_components": found.significant,
                "smoothing_px_used": found.smoothing_px,
            },
            cautions=_cautions(found.warnings),
        )


class Ranges:
    """By the range over which light travelled (see `processing.ranges.decomposition`).

    Parks 4 images a pitch in the result folder while it works.
    """

    def __init__(self, session: Session, folder: Path, profiles: Profiles) -> None:
        self._profiles = profiles
        self._patterns = [frame.pattern for frame in session.frames]
        self._projector_px = session.projector_px or LARGEST_PROJECTOR_PX
        self._folder = folder / HARMONICS
        self._stack: HarmonicsStack | None = None

    @property
    def wants_harmonics(self) -> bool:
        """See `Method.wants_harmonics`."""
        return True

    def white(self, lit: Image) -> None:
        """It takes the place of twice the mean frame where no pitch is balanced."""
        self._stack = self._begin(lit.shape)
        self._stack.add(lit, Pattern(Family.WHITE))

    def pitch(self, gathered: PitchHarmonics) -> None:
        """Park the harmonics of a pitch, and take in the rest."""
        if self._stack is None:
            self._stack = self._begin(gathered.total.shape)
        design = gathered.design
        path = self._folder / f"{design.family}-{design.pitch_px:04d}"
        with storage(path):
            self._folder.mkdir(exist_ok=True)
        self._stack.join(gathered, ParkedImages.park(path, gathered.harmonics))

    def decompose(
        self,
        folder: Path,  # noqa: ARG002 (its frames are gathered)
        separated: SeparatedPitches,
        told: Told,
    ) -> Components:
        """Fit every pixel's spectrum of ranges."""
        if self._stack is None:
            raise StackError("There is no frame to decompose.")
        known = self._profiles.noise
        # Half of white passes a pattern.
        lines = None if known is None else np.stack([known.constant, known.slope / 2], axis=1)
        try:
            found = decompose_ranges(
                self._stack,
                separated.mask == PixelClass.MEASURED,
                blur=self._profiles.blur,
                noise=lines,
                progress=told,
            )
        except ValueError as error:
            raise StackError(f"{error}; `--method iva` may take this session.") from error
        except SystemError as error:
            # Ctrl-C while compiled code runs comes out wrapped.
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise KeyboardInterrupt from error
            raise
        designs = self._stack.designs
        return _of_ranges(found, [(design.family, design.pitch_px) for design in designs])

    def close(self) -> None:
        """Remove the parked images."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _begin(self, shape: tuple[int, ...]) -> HarmonicsStack:
        height, width, colours = shape
        try:
            return HarmonicsStack(self._patterns, (height, width, colours), self._projector_px)
        except ValueError as error:
            raise StackError(f"{error}; `--method iva` takes such sessions.") from error


class Pairs:
    """Where frames do not tell the places of pixels in the patterns.

    Two frames a pitch may be the largest and the smallest value of many shifts, or two positions
    of the pattern. Of the former the one is nowhere darker than the other, and ranges are found
    from them alone; of the latter half of the pixels are brighter in the second, and independent
    vector analysis is what is left.
    """

    def __init__(self, obstacle: str, iva: Iva | None) -> None:
        self._obstacle, self._iva = obstacle, iva

    @property
    def wants_harmonics(self) -> bool:
        """See `Method.wants_harmonics`."""
        return False

    def white(self, lit: Image) -> None:
        """The separated pitches are all it needs."""

    def pitch(self, gathered: PitchHarmonics) -> None:
        """The separated pitches are all it needs."""

    def close(self) -> None:
        """Nothing was parked."""

    def decompose(self, folder: Path, separated: SeparatedPitches, told: Told) -> Components:
        """By ranges where the frames are extrema, else by independent vector analysis."""
        resolved = tuple(sorted(separated.resolved, key=lambda pitch: pitch.pitch_px))
        distinct = len({pitch.pitch_px for pitch in resolved}) == len(resolved) > 1
        if not (distinct and all(sample.is_ordered for sample in separated.samples)):
            if self._iva is None:
                raise StackError(f"{self._obstacle}; `--method iva` takes such sessions.")
            components = self._iva.decompose(folder, separated, told)
            return replace(components, cautions=(self._by_iva, *components.cautions))
        found = decompose_extrema(
            open_rows(folder, resolved),
            [float(pitch.pitch_px) for pitch in resolved],
            [Family(pitch.family) for pitch in resolved],
            separated.white,
            separated.mask == PixelClass.MEASURED,
        )
        components = _of_ranges(found, [(pitch.family, pitch.pitch_px) for pitch in resolved])
        return replace(components, cautions=(FROM_EXTREMA, *components.cautions))

    @property
    def _by_iva(self) -> Caution:
        return Caution(
            what="Decomposed by independent vector analysis, because the default method cannot be "
            f"used: {self._obstacle}.",
            meaning="The components have no standard errors, and nothing keeps them from being "
            "negative.",
            remedy="Capture with the shifts of `lumisplit plan --example` for the default method.",
        )


def _of_ranges(found: RangeDecomposition, rows: Sequence[tuple[str, int]]) -> Components:
    """What a decomposition by range yields; `rows` are families and pitches, in order."""
    noise = np.nanmean(found.noise) if np.isfinite(found.noise).any() else None
    return Components(
        images=dict(zip(found.names, found.components, strict=True)),
        deviations=dict(zip(found.names, found.deviations, strict=True)),
        white=found.white,
        mixing=MixingRecord(
            families=(*(family for family, _ in rows), Family.WHITE),
            pitch_px=(*(pitch_px for _, pitch_px in rows), None),
            alpha=found.mixing.tolist(),
            half_width=_or_none(found.mixing_half_width),
            interval=RANGES_INTERVAL,
        ),
        noise=None if noise is None else float(noise),
        used={
            "method": "ranges",
            "blur_projector_px": [float(np.sqrt(max(b.side_px2, 0))) for b in found.blur],
        },
        cautions=_cautions(found.warnings),
    )


def _cautions(remarks: tuple[Remark, ...]) -> tuple[Caution, ...]:
    return tuple(Caution(what=r.what, meaning=r.meaning, remedy=r.remedy) for r in remarks)


def _or_none(values: NDArray[np.float64]) -> tuple[tuple[tuple[float | None, ...], ...], ...]:
    """Numbers as JSON holds them."""
    return tuple(
        tuple(tuple(v if np.isfinite(v) else None for v in row) for row in colour)
        for colour in values.tolist()
    )


def check_components(n_pitches: int, n_components: int, kind: str = "") -> None:
    """Refuse more components than there are observations of a pixel."""
    rows = n_pitches + 1
    if not 2 <= n_components <= rows:
        raise StackError(
            f"--components {n_components}: {n_pitches} {kind}pitch(es) and white light give {rows} "
            f"observations of a pixel, so 2 to {rows} components can be told apart."
        )


def obstacle_to_ranges(session: Session) -> str | None:
    """Why the default method cannot take a session; None when it can."""
    patterns = [frame.pattern for frame in session.frames]
    try:
        HarmonicsStack(patterns, (1, 1, 1), LARGEST_PROJECTOR_PX)
    except ValueError as error:
        return str(error)
    return None
