"""What a person must know about the frames before believing a number made of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from acquire.pitches import SeparatedPitches
from acquire.result import DriftRecord, PitchRecord
from acquire.session import Session
from acquire.session.records import Caution
from calibration.projector import measure_leak
from processing.frames.drift import Course
from processing.frames.optical_contrast import USABLE

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
    yield from _drift(session, separated)
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
    white, black = separated.references.white, separated.references.black
    if white is None:
        yield Caution(
            what="No white frame: twice the mean of the frames stands in for it.",
            meaning="No pitch could be checked against it; drift and a change of gain go unseen.",
            remedy="Let the next plan hold white frames, or import them with their role.",
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


def _drift(session: Session, separated: SeparatedPitches) -> Iterator[Caution]:
    found, white = separated.references.record, separated.references.white
    if found is not None and found.course is Course.ROUGH:
        yield Caution(
            what=f"Light or black level changed by {found.range:.1%} of white between the "
            f"references, and not smoothly: one lies {found.bend:.1%} off the line between its "
            "neighbours.",
            meaning="The frames were not corrected, because what happened between two references "
            "is not known; direct light carries errors of that size.",
            remedy="Let the lamp warm up, keep projector and camera from changing light or gain, "
            "and darken the room; repeat references more often (`references.every_frames`).",
        )
    elif found is not None and found.corrected:
        yield _corrected(session, separated, found)
    elif found is not None and found.range > WARNED_SPREAD:
        imported = session.record.source is not None
        yield Caution(
            what=f"Light or black level drifted by {found.range:.1%} of white between the "
            "references, and the frames were not corrected"
            + (": in which order they were taken is not known." if imported else ", as asked."),
            meaning="Direct light carries errors of that size.",
            remedy="Correct the frames before importing them, or capture with lumisplit."
            if imported
            else "Process without `--no-drift-correction`.",
        )
    elif found is None and white is not None and white.spread > WARNED_SPREAD:
        yield Caution(
            what=f"The white frames differ by up to ±{white.spread:.1%} in level.",
            meaning="Direct light carries errors of that size.",
            remedy="Fix the camera's exposure and gain, and let the lamp warm up.",
        )


def _corrected(session: Session, separated: SeparatedPitches, found: DriftRecord) -> Caution:
    only_two = max(len(found.white_order), len(found.black_order)) == 2
    after = len(session.lines) - 1 - max(found.white_order)
    course = (
        "Its course between the only two references is taken to be a straight line."
        if only_two
        else f"What it bends between references leaves some {found.bend / 4:.2%} in the frames."
    )
    if not session.complete and after > 1:
        course += f" The last {after} frames have no reference after them and are corrected as it."
    sums = [abs(p.additivity_error) for p in separated.pitches if p.additivity_error is not None]
    if sums:
        course += f" Patterns and complements now miss white by {max(sums):.2%} at most."
    return Caution(
        what=f"Light or black level drifted by {found.range:.1%} of white during the capture; "
        "the frames were corrected.",
        meaning="Every frame was brought to the light and the black level of the first "
        f"references, colour by colour, on the line between those before and after it. {course}",
        remedy="Let lamp and camera warm up, and there is less to correct; "
        "`--no-drift-correction` leaves the frames as they were captured.",
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
    unresolved = [p for p in separated.pitches if not p.resolved]
    if unresolved:
        yield _unresolved(", ".join(f"{p.family} {p.pitch_px}" for p in unresolved), unresolved)


def _unresolved(named: str, unresolved: list[PitchRecord]) -> Caution:
    if all(pitch.contrast is not None for pitch in unresolved):
        return Caution(
            what=f"Not resolved, by the board: {named} px. Camera and projector leave less than "
            f"{USABLE:.0%} of their contrast.",
            meaning="What max/min reads there is mostly noise and was not divided by so little; "
            "iva leaves these pitches out, ranges weighs them by what is left.",
            remedy="Focus camera and projector and stop down, or leave these pitches out of the "
            "next plan.",
        )
    return Caution(
        what=f"Not resolved: {named} px. Even the most direct pixels lose "
        "contrast there, by blur of lens or projector (or because everything in view "
        "scatters; only a reference board could tell).",
        meaning="Max/min reads too little direct light at these pitches; iva leaves them out, "
        "ranges corrects for the blur that it measures.",
        remedy="Focus camera and projector and stop down, or leave these pitches out of the "
        "next plan; `lumisplit calibrate board` tells blur from scattering.",
    )
