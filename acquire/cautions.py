"""What a person must know about the frames before believing a number made of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from acquire.pitches import SeparatedPitches
from acquire.result import Caution
from acquire.session import Session
from calibration.projector import measure_leak

WARNED_SPREAD = 0.01
WARNED_ADDITIVITY = 0.02
WARNED_LEAK = 0.05
WARNED_PEAK = 1.05
WARNED_SATURATION = 0.001


def cautions(session: Session, separated: SeparatedPitches) -> Iterator[Caution]:
    """Everything about the frames that weakens the result."""
    if not session.complete:
        yield Caution(
            what=f"The session is incomplete: {len(session.frames)} of {len(session.plan)} frames.",
            meaning="Pitches that are missing take no part; one that was interrupted reads less "
            "direct light where its shifts are missing.",
            remedy="`lumisplit capture` goes on where it stopped; then process again.",
        )
    yield from _references(separated)
    if session.record.source is None:
        yield from _positions(separated)
    yield from _pitches(separated)
    counted = separated.mask_record()
    if counted.saturated > WARNED_SATURATION * counted.pixels:
        yield Caution(
            what=f"{counted.saturated / counted.pixels:.1%} of the pixels are saturated in some "
            "frame.",
            meaning="They were left out: their components are unknown and in no share.",
            remedy="Expose less and capture again, if what they show matters.",
        )


def _references(separated: SeparatedPitches) -> Iterator[Caution]:
    white, black = separated.white_reference, separated.black_reference
    if white is None:
        yield Caution(
            what="No white frame: twice the mean of the frames stands in for it.",
            meaning="No pitch could be checked against it; drift and a change of gain go unseen.",
            remedy="Let the next plan hold white frames, or import them with their role.",
        )
    elif white.spread > WARNED_SPREAD:
        yield Caution(
            what=f"The white frames differ by up to ±{white.spread:.1%} in level: lamp, camera or "
            "room light changed during the capture.",
            meaning="Direct light carries errors of that size.",
            remedy="Let the lamp warm up, fix the camera's exposure and gain, and darken the room; "
            "capture again if that is too much.",
        )
    if black is None:
        yield Caution(
            what="No black frame: light of the room and of the projector's dark pixels was not "
            "subtracted.",
            meaning="It counts as global light.",
            remedy="Capture black frames; or give `--leak`, which `lumisplit calibrate leak` "
            "measures.",
        )
    usable = separated.mask == 0
    if white is not None and black is not None and usable.any():
        leak = measure_leak(white.image, black.image, usable)
        if leak.fraction > WARNED_LEAK:
            yield Caution(
                what=f"The black frame is {leak.fraction:.1%} as bright as white: room light or a "
                "projector of low contrast.",
                meaning="It was subtracted, its noise was not: dark pixels are noisier than they "
                "need be.",
                remedy="Darken the room, or switch off the projector's dynamic contrast.",
            )


def _positions(separated: SeparatedPitches) -> Iterator[Caution]:
    pairs = [p for p in separated.pitches if p.family.is_binary and p.shifts == 2]
    if pairs:
        yield Caution(
            what=f"{len(pairs)} of {len(separated.pitches)} pitches were captured in two positions "
            "only.",
            meaning="Pixels on the edge of a stripe or check are half lit in both, and their "
            "direct light reads too low.",
            remedy="Take at least four shifts in each direction in which the pattern changes.",
        )


def _pitches(separated: SeparatedPitches) -> Iterator[Caution]:
    errors = [p.additivity_error for p in separated.pitches if p.additivity_error is not None]
    if errors and np.max(np.abs(errors)) > WARNED_ADDITIVITY:
        worst = max(errors, key=abs)
        yield Caution(
            what=f"Patterns and their complements do not add up to white: {worst:+.1%} at the "
            "worst pitch, 1 to 2 % on a sound capture. Light, gain or exposure changed, or a tone "
            "curve was not undone.",
            meaning="Direct and global light carry errors of that size.",
            remedy="`lumisplit verify SESSION --images` tells when the light changed; for "
            "imported pictures, import again with the right `--transfer`.",
        )
    peaks = [p.direct_peak for p in separated.pitches if p.direct_peak is not None]
    if peaks and max(peaks) > WARNED_PEAK:
        yield Caution(
            what=f"The most direct pixels read up to {max(peaks):.0%} of white, more than all "
            "light there is: the black or the white frame was taken with another gain or exposure "
            "than the patterns, or the pictures' curve was not undone.",
            meaning="Fractions of light mean little.",
            remedy="Take references and patterns at the same settings; for imported pictures, "
            "check `--transfer`.",
        )
    unresolved = [f"{p.family} {p.pitch_px}" for p in separated.pitches if not p.resolved]
    if unresolved:
        yield Caution(
            what=f"Not resolved: {', '.join(unresolved)} px. Even the most direct pixels lose "
            "contrast there, by blur of lens or projector (or because everything in view "
            "scatters; only a reference board could tell).",
            meaning="Max/min reads too little direct light at these pitches; iva leaves them out, "
            "ranges corrects for the blur that it measures.",
            remedy="Focus camera and projector and stop down, or leave these pitches out of the "
            "next plan; `lumisplit calibrate board` tells blur from scattering.",
        )
