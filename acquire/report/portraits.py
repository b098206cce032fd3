"""The worst frames of a capture as pictures: what was measured, what should be, the difference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from acquire.report.pictures import Picture, photograph, sign_map
from acquire.result import PortraitRecord, Result
from acquire.tone import exposure_of

SIDE_PX = 256
# Difference that takes the full colour, as a part of white.
SPAN = 0.2


@dataclass(frozen=True, slots=True)
class PortraitPlate:
    """A frame as the page shows it; without a prediction where nothing predicts it.

    Parameters
    ----------
    title, verdict
        Which frame it is, and what was found.
    is_right
        It counts and shows its pattern.
    figures
        Name and value of its key figures, in words.
    measured, predicted, difference
        At one exposure; the difference in full colour at a fifth of white.
    """

    title: str
    verdict: str
    is_right: bool
    how: str
    figures: tuple[tuple[str, str], ...]
    measured: Picture
    predicted: Picture | None
    difference: Picture | None


def portrait_plates(result: Result) -> tuple[PortraitPlate, ...]:
    """Pictures of the frames that the result kept, the worst first."""
    proof = result.record.proof
    return () if proof is None else tuple(_plate(result, one) for one in proof.worst)


def _plate(result: Result, one: PortraitRecord) -> PortraitPlate:
    title = f"step {one.step}, {one.pattern}"
    if one.attempt or not one.is_right:
        title += f", attempt {one.attempt + 1}"
    measured = result.portrait(one.measured, one.shape)
    scale = one.white or exposure_of(measured) ** -1
    gain = 1 / scale
    predicted = difference = None
    if one.predicted is not None:
        due = result.portrait(one.predicted, one.shape)
        predicted = photograph(due, gain, SIDE_PX, f"What {title} should show.")
        miss = (measured - due).astype(np.float32)
        difference = sign_map(miss, gain / SPAN, SIDE_PX, f"{title} less what it should show.")
    return PortraitPlate(
        title=title,
        verdict=one.verdict,
        is_right=one.is_right,
        how=one.how,
        figures=tuple(_figures(one)),
        measured=photograph(measured, gain, SIDE_PX, f"{title} as it was taken."),
        predicted=predicted,
        difference=difference,
    )


def _figures(one: PortraitRecord) -> list[tuple[str, str]]:
    known = (
        ("misses its prediction by", one.miss, "{:.2%} of white, root mean square"),
        ("part of the contrast left over", one.residual, "{:.2%}"),
        ("sum with its complement less white", one.additivity, "{:+.2%}"),
        ("light", one.light, "{:.1%} of the first"),
        ("part that the prediction knows", one.holds, "{:.1%}"),
    )
    return [(name, words.format(value)) for name, value, words in known if value is not None]
