"""What the figures of all frames say about the session as a whole, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from acquire.proof.displacement import misplaced
from acquire.proof.records import SHADED_AT, FrameProof
from acquire.session import Session
from processing.frames.drift import Course, Trace
from processing.patterns import Family

DRIFT_AT = 0.01
UNSTEADY_AT = 0.005
ADDITIVITY_AT = 0.02
MOVED_AT_PX = 0.1
SATURATED_AT = 0.001
# Standard error of the light of a white frame: mean of some thousand places.
LIGHT_ERROR = 0.0005

Array = NDArray[np.float64]


def verdict(session: Session, proofs: Sequence[FrameProof]) -> Iterator[str]:
    """What the figures say about the session; beyond the first sentence nothing where all is well.

    Parameters
    ----------
    session
        The frames that were judged are the ones that count.
    proofs
        Theirs.
    """
    wrong = sum(proof.is_wrong for proof in proofs)
    unseen = sum(proof.finding == "unseen" for proof in proofs)
    again = len(session.lines) - len(session.frames)
    yield (
        f"{len(proofs)} frames judged: {wrong} wrong, {unseen} too faint or too few of a kind to "
        f"be told; {again} were taken again during the capture."
    )
    exposed = [proof for proof in proofs if proof.settings]
    if exposed:
        yield (
            f"{len(exposed)} frames were exposed otherwise than asked, from step {exposed[0].step} "
            f"on: {exposed[0].settings}. Their light cannot be compared with that of the others."
        )
    yield from misplaced(session, proofs)
    # What is dark in part neither stands where it stood nor has its light, for all one can see.
    whole = [proof for proof in proofs if (proof.shaded or 0.0) <= SHADED_AT]
    yield from _steadiness(session, whole)
    sums = [abs(proof.additivity) for proof in proofs if proof.additivity is not None]
    if sums and max(sums) > ADDITIVITY_AT:
        yield f"Patterns and complements miss white and black by up to {max(sums):.1%}."
    moved = [proof.moved_px for proof in whole if proof.moved_px is not None]
    if moved:
        farthest = max(float(np.hypot(*shift)) for shift in moved)
        if farthest > MOVED_AT_PX:
            yield f"The scene or the camera moved by up to {farthest:.2f} camera pixels."
    yield from _since(
        proofs,
        lambda proof: proof.shaded or 0.0,
        SHADED_AT,
        "Up to {most:.1%} of what white lights is dark in other frames{since}: something stands in "
        "front of the projector or the camera, or did when white was taken.",
    )
    yield from _since(
        proofs,
        lambda proof: proof.saturated,
        SATURATED_AT,
        "Up to {most:.1%} of the pixels of a frame are saturated{since}: expose less.",
    )


def _since(
    proofs: Sequence[FrameProof], part: Callable[[FrameProof], float], least: float, words: str
) -> Iterator[str]:
    """The largest part, and since when it is so large that it is told, unless always."""
    ordered = sorted(proofs, key=lambda proof: proof.step)
    parts = [part(proof) for proof in ordered]
    if max(parts, default=0.0) <= least:
        return
    first = next(k for k, one in enumerate(parts) if one > least)
    # White is brightest: where it is among the frames before, this appeared while capturing.
    since = f" (first at step {ordered[first].step}, not before)" if first > 1 else ""
    yield words.format(most=max(parts), since=since)


def _steadiness(session: Session, proofs: Sequence[FrameProof]) -> Iterator[str]:
    """Drift by the white frames, where they were repeated, and how far all frames lie from it."""
    known = [proof for proof in proofs if proof.light is not None and not proof.is_wrong]
    order = np.array([session.order(session.frames[proof.step]) for proof in known], np.float64)
    light = np.array([proof.light for proof in known], np.float64)
    patterns = session.plan.patterns
    is_white = np.array([patterns[proof.step].family is Family.WHITE for proof in known], bool)
    if is_white.sum() >= 2:
        course = _course(order[is_white], light[is_white])
        yield from _drift(course)
        usual = course.at(order)[:, 0]
    elif light.size >= 3:
        slope, middle = np.polyfit(order, light, 1)
        change = float(slope * np.ptp(order))
        if abs(change) > DRIFT_AT:
            yield (
                f"Lamp or exposure drifted by {change:+.1%} over the session, by a line through "
                "all frames; only repeated white frames (references.every_frames) tell its course."
            )
        usual = middle + slope * order
    else:
        return
    rest = float(np.std((light - usual)[~is_white])) if (~is_white).any() else 0.0
    if rest > UNSTEADY_AT:
        yield f"The light of single frames varies by {rest:.1%} (standard deviation): flicker."


def _course(order: Array, light: Array) -> Trace:
    by_order = np.argsort(order)
    values = light[by_order, np.newaxis]
    return Trace(order[by_order], values, np.full_like(values, LIGHT_ERROR))


def _drift(course: Trace) -> Iterator[str]:
    kind, change = course.course(1.0), float(course.values[-1, 0] - course.values[0, 0])
    if kind is Course.STEADY or course.range <= DRIFT_AT:
        return
    number = len(course.order)
    text = f"Lamp or exposure drifted by {change:+.1%} from the first to the last of {number} white"
    if abs(course.range - abs(change)) > DRIFT_AT:
        text += f" frames, within {course.range:.1%}"
    else:
        text += " frames"
    smooth = f"smoothly: no one is farther than {course.bend:.2%} off the line between its two"
    rough = f"not smoothly: one is {course.bend:.1%} off the line between its two"
    yield f"{text}, {smooth if kind is Course.SMOOTH else rough} neighbours."
