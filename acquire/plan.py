"""The plan: every exposure of a session in order, with nothing left to choose.

A plan lists its patterns one by one; `acquire.plan_file` writes one out from the few numbers
that a person gives, and `acquire.table` from a list of frames that somebody else captured.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from acquire.validation import StrictModel
from drivers.protocols import CameraSettings
from processing.patterns import Pattern

MAX_STEPS = 100_000


def _pattern_from_text(value: object) -> object:
    return Pattern.parse(value) if isinstance(value, str) else value


def _without_unused(values: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    """Leave out keys that say nothing: plans from before there were such keys keep their text."""
    return {key: value for key, value in values.items() if key not in names or value}


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


LevelLight = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...], Field(min_length=256, max_length=256)
]


class ProjectorPlan(StrictModel):
    """How long a pattern stands before it counts, and the projector's response.

    `light`, where it was measured, is the light of every level, 0 to 255, as a fraction of white
    less black, for all colours alike or for red, green and blue; `gamma` then has no effect.
    """

    settle_s: float = Field(default=0.1, ge=0, le=3600)
    gamma: float = Field(default=1.0, ge=0.1, le=10)
    resolution_px: tuple[int, int] | None = None
    light: tuple[LevelLight, ...] | None = None

    @model_validator(mode="after")
    def _sensible(self) -> ProjectorPlan:
        if self.light is not None and len(self.light) not in {1, 3}:
            raise ValueError(f"light: 1 or 3 colours, not {len(self.light)}")
        return self

    @model_serializer(mode="wrap")
    def _to_file(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return _without_unused(handler(self), ("light",))

    def raster(self, pattern: Pattern, resolution: tuple[int, int]) -> NDArray[np.uint8]:
        """What the projector, (height, width) pixels, is told so that it shows a pattern."""
        light = None if self.light is None else np.array(self.light)
        return pattern.raster(resolution, self.gamma, light)


ProfileKind = Literal[
    "dark", "noise", "response", "leak", "exposure", "latency", "geometry", "board"
]


class ProfileUse(StrictModel):
    """A calibration that a plan names, by the digest of its file."""

    kind: ProfileKind
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class Plan(StrictModel):
    """Every exposure of a session, in order.

    `exposures_s`, one for each pattern, takes the place of the camera's one exposure time.
    """

    camera: CameraPlan = CameraPlan()
    projector: ProjectorPlan = ProjectorPlan()
    patterns: tuple[PatternText, ...] = Field(min_length=1, max_length=MAX_STEPS)
    exposures_s: tuple[Annotated[float, Field(gt=0, le=3600)], ...] | None = None
    calibration: tuple[ProfileUse, ...] = ()

    @model_validator(mode="after")
    def _sensible(self) -> Plan:
        if self.exposures_s is not None and len(self.exposures_s) != len(self.patterns):
            raise ValueError(
                f"exposures_s: {len(self.exposures_s)} for {len(self.patterns)} patterns"
            )
        return self

    @model_serializer(mode="wrap")
    def _to_file(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return _without_unused(handler(self), ("exposures_s", "calibration"))

    def __len__(self) -> int:
        return len(self.patterns)

    @property
    def steps(self) -> Iterator[Step]:
        """The exposures in order."""
        return (self.step(index) for index in range(len(self)))

    def step(self, index: int) -> Step:
        """The exposure at `index`, from 0."""
        settings = self.camera.settings
        if self.exposures_s is not None:
            settings = replace(settings, exposure_s=self.exposures_s[index])
        return Step(index, self.patterns[index], settings)

    @property
    def exposed_s(self) -> float:
        """Sum of all exposure times, seconds."""
        if self.exposures_s is not None:
            return sum(self.exposures_s)
        return len(self) * self.camera.exposure_s

    def to_json(self) -> str:
        """The plan's one canonical text."""
        return self.model_dump_json(indent=1) + "\n"

    @property
    def sha256(self) -> str:
        """Digest of the canonical text, hexadecimal."""
        return hashlib.sha256(self.to_json().encode()).hexdigest()
