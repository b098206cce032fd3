"""What a person must know about the frames before believing a number made of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from acquire.pitches import SeparatedPitches
from acquire.session import Session
from calibration.projector import measure_leak

WARNED_SPREAD = 0.01
WARNED_ADDITIVITY = 0.02
WARNED_LEAK = 0.05
WARNED_PEAK = 1.05
WARNED_SATURATION = 0.001


def cautions(session: Session, separated: SeparatedPitches) -> Iterator[str]:
    """Everything about the frames that weakens the result, in words."""
    if not session.complete:
        yield (
            f"The session is incomplete: {len(session.frames)} of {len(session.plan)} frames. "
            "`lumisplit capture` goes on where it stopped."
        )
    if session.record.source is not None:
        yield from session.record.source.notes
    yield from _references(separated)
    if session.record.source is None:
        yield from _positions(separated)
    yield from _pitches(separated)
    counted = separated.mask_record()
    if counted.saturated > WARNED_SATURATION * counted.pixels:
        yield (
            f"{counted.saturated / counted.pixels:.1%} of the pixels are saturated in some frame "
            "and were left out: expose less."
        )


def _references(separated: SeparatedPitches) -> Iterator[str]:
    white, black = separated.white_reference, separated.black_reference
    if white is None:
        yield (
            "No white frame: twice the mean of the frames stands in for it, and no pitch could be "
            "checked against it."
        )
    elif white.spread > WARNED_SPREAD:
        yield (
            f"The white frames differ by up to ±{white.spread:.1%} in level: lamp, camera or room "
            "light changed during the capture. Direct light carries errors of that size."
        )
    if black is None:
        yield (
            "No black frame: light of the room and of the projector's dark pixels was not "
            "subtracted and counts as global light."
        )
    usable = separated.mask == 0
    if white is not None and black is not None and usable.any():
        leak = measure_leak(white.image, black.image, usable)
        if leak.fraction > WARNED_LEAK:
            yield (
                f"The black frame is {leak.fraction:.1%} as bright as white: room light or a "
                "projector of low contrast. It was subtracted, its noise was not."
            )


def _positions(separated: SeparatedPitches) -> Iterator[str]:
    pairs = [p for p in separated.pitches if p.family.is_binary and p.shifts == 2]
    if pairs:
        yield (
            f"{len(pairs)} of {len(separated.pitches)} pitches were captured in two positions "
            "only: pixels on the edge of a stripe or check are half lit in both, and their direct "
            "light reads too low."
        )


def _pitches(separated: SeparatedPitches) -> Iterator[str]:
    errors = [p.additivity_error for p in separated.pitches if p.additivity_error is not None]
    if errors and np.max(np.abs(errors)) > WARNED_ADDITIVITY:
        worst = max(errors, key=abs)
        yield (
            f"Patterns and their complements do not add up to white: {worst:+.1%} at the worst "
            "pitch, 1 to 2 % on a sound capture. Light, gain or exposure changed, or a tone curve "
            "was not undone; direct and global light carry errors of that size."
        )
    peaks = [p.direct_peak for p in separated.pitches if p.direct_peak is not None]
    if peaks and max(peaks) > WARNED_PEAK:
        yield (
            f"The most direct pixels read up to {max(peaks):.0%} of white, more than all light "
            "there is: the black or the white frame was taken with another gain or exposure than "
            "the patterns, or the pictures' curve was not undone. Fractions of light mean little."
        )
    unresolved = [f"{p.family} {p.pitch_px}" for p in separated.pitches if not p.resolved]
    if unresolved:
        yield (
            f"Not resolved: {', '.join(unresolved)} px. Even the most direct pixels lose contrast "
            "there, by blur of lens or projector (or because everything in view scatters; only a "
            "reference board could tell). Max/min reads too little direct light at these pitches; "
            "iva leaves them out, ranges corrects for the blur that it measures."
        )
