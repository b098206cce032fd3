"""What every way of taking a scene apart wants of the frames, and what it yields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from acquire.pitches import SeparatedPitches
from acquire.result import MixingRecord
from acquire.session.records import Caution
from processing.frames.harmonics import PitchHarmonics
from processing.remarks import Remark

Image = NDArray[np.float32]

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


class OfPitches:
    """What a method leaves out that needs nothing but the separated pitches."""

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


def cautions_of(remarks: tuple[Remark, ...]) -> tuple[Caution, ...]:
    """What a decomposition remarked, as the report tells it."""
    return tuple(Caution(what=r.what, meaning=r.meaning, remedy=r.remedy) for r in remarks)


def or_none(values: NDArray[np.float64]) -> tuple[tuple[tuple[float | None, ...], ...], ...]:
    """Numbers as JSON holds them."""
    return tuple(
        tuple(tuple(v if np.isfinite(v) else None for v in row) for row in colour)
        for colour in values.tolist()
    )
