"""What a calibration is asked and what it yields."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from numpy.typing import NDArray

from acquire.plan import CameraPlan, Plan, ProfileKind, ProjectorPlan
from acquire.profile_file import Curve, Quantity
from acquire.report.figures import Drawing
from acquire.session import Session


@dataclass(frozen=True, slots=True)
class Setting:
    """Under what a calibration is captured.

    Parameters
    ----------
    camera, projector
        Settings as a scene's plan has them.
    resolution
        (height, width) of the projector in pixels.
    """

    camera: CameraPlan
    projector: ProjectorPlan
    resolution: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Plot:
    """A drawing of the page and what to say below it."""

    title: str
    drawing: Drawing
    caption: str


@dataclass(frozen=True, slots=True)
class Finding:
    """What was found: see `acquire.profile_file.Profile`.

    `beside` are files in formats of others, by suffix, that lie beside the profile.
    """

    quantities: dict[str, Quantity]
    curves: dict[str, Curve] = field(default_factory=dict)
    maps: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    plots: tuple[Plot, ...] = ()
    beside: Mapping[str, str] = field(default_factory=dict)


class Calibration(Protocol):
    """One kind of calibration."""

    @property
    def kind(self) -> ProfileKind:
        """Its name."""

    @property
    def purpose(self) -> str:
        """What it is good for and what has to stand in front of the camera, for a person."""

    def plan(self, setting: Setting, sessions: Sequence[Session]) -> Plan | None:
        """What to capture after the sessions that are there; None when they are enough."""

    def fit(self, sessions: Sequence[Session], frame_done: Callable[[], None]) -> Finding:
        """The result; raises `calibration.errors.UnsupportedError` where there is none."""
