"""Codes of the patterns that are judged together, and what is expected of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from acquire.plan import Plan
from acquire.proof.units import Unit
from processing.patterns import Family, Pattern
from processing.proof.phases import Phases
from processing.proof.prediction import pattern_covariance

LARGEST_PROJECTOR_PX = 2400, 4096


class Codes:
    """Covariances and differences of the codes of a plan's patterns.

    Parameters
    ----------
    plan
        What should be shown.
    projector_px
        (height, width) of the projector; None where it is not known.
    """

    def __init__(self, plan: Plan, projector_px: tuple[int, int] | None) -> None:
        self._plan = plan
        self.projector_px = projector_px or LARGEST_PROJECTOR_PX
        self._covariance: dict[Unit, NDArray[np.float64]] = {}
        self._phases: dict[Unit, Phases] = {}

    def covariance(self, unit: Unit) -> NDArray[np.float64]:
        """(frames, frames) of a unit's patterns, over whole periods."""
        if unit not in self._covariance:
            patterns = [self._plan.patterns[step] for step in unit.steps]
            self._covariance[unit] = pattern_covariance(patterns, self.projector_px)
        return self._covariance[unit]

    def phases(self, unit: Unit) -> Phases:
        """Codes of a unit's patterns at the places of their period."""
        if unit not in self._phases:
            self._phases[unit] = Phases.of([self._plan.patterns[step] for step in unit.steps])
        return self._phases[unit]

    def is_fine(self, step: int) -> bool:
        """Whether a pattern has about half of the light, wherever the camera looks.

        Assumed is that it sees at least half the height and half the width of what is projected.
        """
        pattern = self._plan.patterns[step]
        return pattern.pitch_px * 3 <= min(self.projector_px)

    def change(self, step: int, before: Pattern) -> float:
        """Mean square of 2(c − c') over a stretch of the projector."""
        pattern = self._plan.patterns[step]
        if before.family not in {pattern.family, Family.WHITE, Family.BLACK}:
            return 1.0
        period = 4 * max(pattern.pitch_px, before.pitch_px)
        size = (min(period, self.projector_px[0]), min(period, self.projector_px[1]))
        own, other = pattern.code(size), before.code(size)
        return float(4 * np.mean((own - other) ** 2))
