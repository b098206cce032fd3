"""By the range over which light travelled, correlated with the pattern that each pixel sees."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acquire.errors import StackError
from acquire.methods.components import Components, Image, Told, cautions_of, or_none
from acquire.parked import ParkedImages
from acquire.pitches import SeparatedPitches
from acquire.profile_use import Profiles
from acquire.result import MixingRecord, PixelClass
from acquire.session import Session
from acquire.session.folder import storage
from processing.frames.gathering import HarmonicsStack
from processing.frames.harmonics import PitchHarmonics
from processing.patterns import Family, Pattern
from processing.ranges.decomposition import decompose_ranges
from processing.ranges.result import RangeDecomposition
from processing.ranges.two_positions.decomposition import decompose_pairs

HARMONICS = ".harmonics"
# Where a projector's size was not recorded, its pixels are looked for within the largest there is.
LARGEST_PROJECTOR_PX = 2400, 4096
RANGES_INTERVAL = (
    "95 % confidence of the mean over the scene, by leaving out one of its 8 × 8 tiles at a time; "
    "it holds noise and how the scene varies, no error that all pixels share (blur, references), "
    "and single places differ by far more"
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
        # Of a pair there is one difference.
        kept = gathered.harmonics[:1] if design.is_pair else gathered.harmonics
        self._stack.join(gathered, ParkedImages.park(path, kept))

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
        decompose = decompose_pairs if self._stack.is_paired else decompose_ranges
        try:
            found = decompose(
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
        return by_range(found, [(design.family, design.pitch_px) for design in designs])

    def close(self) -> None:
        """Remove the parked images."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _begin(self, shape: tuple[int, ...]) -> HarmonicsStack:
        height, width, colours = shape
        try:
            return HarmonicsStack(self._patterns, (height, width, colours), self._projector_px)
        except ValueError as error:
            raise StackError(f"{error}; `--method iva` takes such sessions.") from error


def by_range(found: RangeDecomposition, rows: Sequence[tuple[str, int]]) -> Components:
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
            half_width=or_none(found.mixing_half_width),
            interval=RANGES_INTERVAL,
        ),
        noise=None if noise is None else float(noise),
        used={
            "method": "ranges",
            "blur_projector_px": [float(np.sqrt(max(b.side_px2, 0))) for b in found.blur],
        },
        cautions=cautions_of(found.warnings),
    )


def obstacle_to_ranges(session: Session) -> str | None:
    """Why the default method cannot take a session; None when it can."""
    patterns = [frame.pattern for frame in session.frames]
    try:
        HarmonicsStack(patterns, (1, 1, 1), LARGEST_PROJECTOR_PX)
    except ValueError as error:
        return str(error)
    return None
