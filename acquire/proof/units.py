"""Which steps of a plan are judged together."""

from __future__ import annotations

from dataclasses import dataclass

from acquire.plan import Plan
from drivers.protocols import CameraSettings
from processing.patterns import Family

FAMILIES = {
    Family.CHECKER,
    Family.STRIPES_COLUMNS,
    Family.STRIPES_ROWS,
    Family.SINUSOID_COLUMNS,
    Family.SINUSOID_ROWS,
}
# A unit of more frames is judged in pieces: the work grows with the cube of their number.
MOST_FRAMES = 144


@dataclass(frozen=True, slots=True)
class Unit:
    """Steps that are judged when the last of them is there.

    Parameters
    ----------
    steps
        In order.
    are_references
        White and black frames; else patterns of one family, pitch and exposure.
    """

    steps: tuple[int, ...]
    are_references: bool

    @property
    def closes_at(self) -> int:
        """The step after which the unit is judged."""
        return self.steps[-1]


def units_of(plan: Plan) -> tuple[Unit, ...]:
    """The units of a plan in the order in which they close; other patterns belong to none."""
    patterns: dict[tuple[Family, int, CameraSettings, int], list[int]] = {}
    counts: dict[tuple[Family, int, CameraSettings], int] = {}
    references: list[list[int]] = []
    for step in plan.steps:
        pattern = step.pattern
        if pattern.family.is_reference:
            if not references or references[-1][-1] != step.index - 1:
                references.append([])
            references[-1].append(step.index)
        elif pattern.family in FAMILIES:
            alike = pattern.family, pattern.pitch_px, step.settings
            counts[alike] = counts.get(alike, 0) + 1
            piece = (counts[alike] - 1) // MOST_FRAMES
            patterns.setdefault((*alike, piece), []).append(step.index)
    units = [Unit(tuple(steps), are_references=True) for steps in references]
    units += [Unit(tuple(steps), are_references=False) for steps in patterns.values()]
    return tuple(sorted(units, key=lambda unit: unit.closes_at))
