"""The plan: every exposure of a session in order, with nothing left to choose.

A plan lists its patterns one by one; `acquire.plan_file` writes one out from the few numbers
that a person gives, and `acquire.table` from a list of frames that somebody else captured.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator, Field, PlainSerializer

from acquire.validation import StrictModel
from drivers.protocols import CameraSettings
from processing.patterns import Pattern

MAX_STEPS = 100_000


def _pattern_from_text(value: object) -> object:
    return Pattern.parse(value) if isinstance(value, str) else value


PatternText = Annotated[Pattern, BeforeValidator(_pattern_from_text), PlainSerializer(str)]


@dataclass(frozen=True, slots=True)
class Step:
    """One exposure of the plan: its place, what is shown and how it is exposed."""

    index: int
    pattern: Pattern
    settings: CameraSettings


class CameraPlan(StrictModel):
    """How every frame is exposed and how often a silent camera is asked again."""

    exposure_s: float = Field(default=0.1, gt=0, le=3600)
    aperture: float | None = Field(default=8.0, gt=0, le=1000)
    iso: int | None = Field(default=200, gt=0, le=10_000_000)
    retries: int = Field(default=2, ge=0, le=100)

    @property
    def settings(self) -> CameraSettings:
        """The settings as a camera takes them."""
        return CameraSettings(self.exposure_s, self.aperture, self.iso)


class ProjectorPlan(StrictModel):
    """How long a pattern stands before it counts, and the projector's response."""

    settle_s: float = Field(default=0.1, ge=0, le=3600)
    gamma: float = Field(default=1.0, ge=0.1, le=10)
    resolution_px: tuple[int, int] | None = None


class Plan(StrictModel):
    """Every exposure of a session, in order."""

    camera: CameraPlan = CameraPlan()
    projector: ProjectorPlan = ProjectorPlan()
    patterns: tuple[PatternText, ...] = Field(min_length=1, max_length=MAX_STEPS)

    def __len__(self) -> int:
        return len(self.patterns)

    @property
    def steps(self) -> Iterator[Step]:
        """The exposures in order."""
        settings = self.camera.settings
        return (Step(index, pattern, settings) for index, pattern in enumerate(self.patterns))

    def step(self, index: int) -> Step:
        """The exposure at `index`, from 0."""
        return Step(index, self.patterns[index], self.camera.settings)

    def to_json(self) -> str:
        """The plan's one canonical text."""
        return self.model_dump_json(indent=1) + "\n"

    @property
    def sha256(self) -> str:
        """Digest of the canonical text, hexadecimal."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()
