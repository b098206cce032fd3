"""What a person must know of an imported stack whose camera chose exposure and tone by itself."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from acquire.exposure_record import ExposureRecord, PairRecord, ToneCurveRecord
from acquire.session.records import Caution

WARNED_LEFT = 0.02
WARNED_OUTLYING = 0.1
# Part of what is left that something must explain to be named.
MOST = 0.5


def exposure_cautions(record: ExposureRecord | None) -> Iterator[Caution]:
    """Everything about the exposures of an imported stack that weakens the result."""
    if record is None:
        return
    if record.obstacle:
        yield Caution(
            what="Whether the camera changed gain or white balance between frames could not be "
            f"found: {record.obstacle}.",
            meaning="Where it did, direct and global light are wrong by as much.",
            remedy="Capture with exposure, gain and white balance fixed, with white and black "
            "frames, and with the complement of every pattern.",
        )
        return
    if record.curve is not None:
        yield from _curve(record.curve)
    if record.differs:
        yield _gains(record)
    yield from _left(record)


def _curve(curve: ToneCurveRecord) -> Iterator[Caution]:
    if curve.corrected:
        yield Caution(
            what="The pictures have a tone curve of the camera's own: patterns and complements "
            f"missed white by {curve.without:.1%} (gains taken off) and by {curve.with_curve:.1%} "
            "with a curve found from other patterns; it was undone.",
            meaning=f"{_reach(curve)} What is left of it is in every share of light.",
            remedy="Use the camera's raw files, if there are any; `--no-tone-correction` leaves "
            "the pictures as they were linearised.",
        )


def _reach(curve: ToneCurveRecord) -> str:
    factors = np.array(curve.factors)
    low, high = factors[:, 1].max(), factors[:, -3].min()
    return (
        f"Light at {curve.codes[1]:.0%} of the codes was multiplied by up to {low:.2f}, at "
        f"{curve.codes[-3]:.0%} by down to {high:.2f}."
    )


def _gains(record: ExposureRecord) -> Caution:
    pairs = [pair for pair in record.pairs if pair.corrected or not record.corrected]
    gains = np.array([one.gain for pair in pairs for one in pair.frames] or [(1.0,)])
    errors = np.array([one.error for pair in pairs for one in pair.frames] or [(0.0,)])
    spread = f"{gains.min() - 1:+.1%} to {gains.max() - 1:+.1%} of that of the white frame"
    if not record.corrected:
        return Caution(
            what=f"The camera's gain differs between frames, {spread}, and was not taken off, as "
            "asked.",
            meaning="Direct and global light are wrong by as much.",
            remedy="Process without `--no-gain-correction`.",
        )
    kept = [pair for pair in record.pairs if not pair.corrected]
    meaning = (
        "Every frame was divided by its gain, colour by colour, as patterns and complements tell "
        f"it (standard error {np.median(errors):.2%}, the median). "
        f"{_sums(pairs)}"
    )
    if kept:
        meaning += (
            f" {2 * len(kept)} frames were left as they are, because gains do not explain what "
            f"they miss: {_named(kept)}."
        )
    if record.unpaired:
        meaning += f" {record.unpaired} frames without a complement were left as they are."
    if record.black is None:
        meaning += " Of the black frame it is not known, which is too dark to tell."
    return Caution(
        what=f"The camera's gain differs between frames, {spread}.",
        meaning=meaning,
        remedy="Fix exposure, gain and white balance in the next capture; "
        "`--no-gain-correction` leaves the frames as they are.",
    )


def _sums(pairs: Sequence[PairRecord]) -> str:
    if not pairs:
        return ""
    before, after = _mean([p.missed for p in pairs]), _mean([p.left for p in pairs])
    return f"What they miss white by fell from {before:.1%} to {after:.1%}, root mean square."


def _left(record: ExposureRecord) -> Iterator[Caution]:
    """What no gain explains."""
    if not record.pairs:
        return
    left = [
        pair.left if pair.corrected or not record.corrected else pair.missed
        for pair in record.pairs
    ]
    size = _mean(left)
    weights = np.array([pair.left for pair in record.pairs]) ** 2 + 1e-30
    level, place, outlying = (
        float(np.average([getattr(pair, name) for pair in record.pairs], weights=weights))
        for name in ("by_level", "by_place", "outlying")
    )
    if size > WARNED_LEFT:
        yield Caution(
            what=f"Patterns and complements miss white by {size:.1%}, root mean square over the "
            f"picture, beyond any gain: {_why(level, place)}.",
            meaning="Shares of light carry errors of that size.",
            remedy="Use raw files, keep the scene, the room and the lamp steady.",
        )
    if outlying > WARNED_OUTLYING:
        yield Caution(
            what=f"{outlying:.0%} of the light is where patterns and complements do not add up "
            "at all.",
            meaning="Something moved, or shone into the picture: nothing there can be trusted.",
            remedy="Keep everything still.",
        )


def _why(level: float, place: float) -> str:
    if level >= MOST:
        return f"{level:.0%} of the square goes with the level of the light, as of a tone curve"
    if place >= MOST:
        return (
            f"{place:.0%} of the square goes with the place in the picture, as of other light, of "
            "movement or of a lamp that is uneven in time"
        )
    return (
        f"{level:.0%} of the square goes with the level of the light, {place:.0%} with the place "
        "in the picture, the rest with neither, as of compression, sharpening and movement by "
        "parts of a pixel"
    )


def _mean(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _named(pairs: Sequence[PairRecord]) -> str:
    names = [pair.frames[0].pattern.rpartition(":")[0] for pair in pairs]
    several = list(dict.fromkeys(names))
    return ", ".join(several[:6]) + (f" and {len(several) - 6} more" if len(several) > 6 else "")
