"""What the pitches of a session tell of each other's places, without a geometry profile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from acquire.plan import Plan
from acquire.proof.exposures import Exposures
from acquire.proof.records import FrameProof, displaced
from acquire.proof.units import Unit
from acquire.proof.white_black import WhiteBlack, spread_evenly
from processing.proof.agreement import Disagreement, PitchPhases, disagreements, pitch_phases
from processing.proof.finding import Finding

# Samples that are looked at, evenly spread.
MOST_PLACES = 2000
FEWEST_PLACES = 300
_STEADY = {Finding.OWN, Finding.UNSEEN, Finding.MISPLACED}


class Agreement:
    """Gathers the phases of every pitch of a plan as its frames are judged.

    Parameters
    ----------
    plan
        What should be shown.
    units
        Of the plan.
    projector_px
        (height, width); None where it is not known, and nothing is said.
    """

    def __init__(
        self, plan: Plan, units: Sequence[Unit], projector_px: tuple[int, int] | None
    ) -> None:
        self._plan, self._projector_px = plan, projector_px
        self._missing = {unit for unit in units if not unit.are_references}
        self._phases: list[PitchPhases] = []
        self._chosen: NDArray[np.int64] | None = None

    def add(
        self,
        unit: Unit,
        exposures: Exposures,
        known: WhiteBlack | None,
        proofs: Mapping[int, FrameProof],
    ) -> None:
        """Take in the frames of a unit, by what was found about each step."""
        self._missing.discard(unit)
        # A frame that is wrong by itself would spoil its pitch.
        own = [proofs[step] for step in unit.steps if step in proofs]
        if known is None or any(one.finding not in _STEADY for one in own):
            return
        if self._chosen is None:
            self._chosen = spread_evenly(known.usable, MOST_PLACES)
        chosen = self._chosen
        black = known.black.grid.ravel()[chosen].astype(np.float64)
        span = known.white.grid.ravel()[chosen] - black
        if len(chosen) < FEWEST_PLACES or span.min() <= 0:
            return
        light = np.stack([exposures[step].samples.grid.ravel()[chosen] for step in unit.steps])
        gains = [proofs[step].light if step in proofs else None for step in unit.steps]
        lamp = np.array([1.0 if gain is None else gain for gain in gains])
        relative = (light - black) / span / lamp[:, np.newaxis]
        variance = 2 * known.noise.at(black + span / 2) / span**2
        patterns = [self._plan.patterns[step] for step in unit.steps]
        found = pitch_phases(patterns, relative, variance)
        if found is not None:
            self._phases.append(found)

    def in_words(self) -> list[str]:
        """What does not agree; nothing before every pitch was taken in."""
        if self._missing or self._projector_px is None:
            return []
        return told(disagreements(self._phases, self._projector_px))


def told(found: Sequence[Disagreement]) -> list[str]:
    """Sentences on pitches that do not agree with others."""
    sentences = [_sentence(one) for one in found if one.is_certain]
    vague = [f"{one.family} of {one.pitch_px} px" for one in found if not one.is_certain]
    if vague:
        sentences.append(
            f"The frames of {', '.join(vague)} do not fit together, or not with the rest: one "
            "of these pitches at least stands elsewhere on the scene, or is another pattern, than "
            "its rasters say."
        )
    return sentences


def _sentence(one: Disagreement) -> str:
    which = f"The frames of {one.family} of {one.pitch_px} px"
    if one.displaced_px is None:
        return (
            f"{which} do not fit those of the other pitches: they stand elsewhere on the scene, or "
            "are turned over, or of another size or kind of pattern, than their rasters say."
        )
    where = displaced((round(one.displaced_px[0]), round(one.displaced_px[1])))
    return f"{which} stand {where} from where those of the other pitches let expect them."
