"""Exposures of an imported stack: gains and a tone curve that its camera chose by itself.

Which settings a stranger's camera had is not known. Where the stack holds patterns with their
complements, a white and a black frame, the frames themselves tell: they are gone through once
before they are separated, and a few thousand pixels of each are compared. A session that this
program captured has its settings recorded, and its frames are left alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from acquire.exposure_record import (
    ExposureRecord,
    FrameGainRecord,
    PairRecord,
    ToneCurveRecord,
)
from acquire.frames import Reading
from acquire.session import FrameRecord, Session, Transfer
from acquire.stack import Stack
from drivers.media import PICTURE_TYPES
from drivers.picture_header import read_header
from processing.frames.exposure_gains import Gain, PairGains, black_gain, pair_gains, single_gain
from processing.frames.frame_noise import ordered
from processing.frames.harmonics import complementary_pairs
from processing.frames.sites import Light, Sites
from processing.frames.tone_curve import KNOTS, MOST_PAIRS, Evidence, ToneCurve, due_of, find_curve
from processing.patterns import Family

NO_PAIRS = "no pattern has its complement among the frames"
EXTREMA = "the two frames of each pitch are extrema, put together from many"
TOO_SMALL = "the pictures are too small to tell"
Pair = tuple[FrameRecord, FrameRecord]


@dataclass(frozen=True, slots=True)
class Exposures:
    """What is undone in the frames.

    Parameters
    ----------
    record
        What was found.
    curve
        That the camera gave its pictures, where it is undone.
    gains
        Of pattern frames that are divided by theirs, by their place among all exposures.
    white, black
        Mean gain of the white and of the black frames, (colours,); None where they are left.
    """

    record: ExposureRecord
    curve: ToneCurve | None = None
    gains: dict[int, tuple[float, ...]] | None = None
    white: NDArray[np.float64] | None = None
    black: NDArray[np.float64] | None = None


def find_exposures(
    session: Session,
    reading: Reading,
    begin: Callable[[int], None],
    frame_done: Callable[[], None],
    *,
    correct_gains: bool,
    correct_tone: bool,
) -> Exposures | None:
    """Look for gains and a tone curve in an imported stack; None in any other session.

    Parameters
    ----------
    session, reading
        The frames and how they are read.
    begin
        Called with the number of frames, if they are looked at.
    frame_done
        Called after each of them.
    correct_gains, correct_tone
        Whether to undo what is found.
    """
    if session.record.source is None:
        return None
    stack = Stack(session, reading)
    pairs = _pairs(stack)
    obstacle = _obstacle(session, pairs)
    if obstacle:
        return Exposures(ExposureRecord(obstacle=obstacle))
    begin(len(stack))
    looked = _looked(stack, session.frames, frame_done)
    if looked is None:
        return Exposures(ExposureRecord(obstacle=TOO_SMALL))
    if _are_extrema(stack, looked):
        return Exposures(ExposureRecord(obstacle=EXTREMA))
    curve = looked.curve(pairs) if _has_curve(session) else None
    bends = curve is not None and curve.convinces and correct_tone
    if curve is not None and bends:
        looked = looked.through(curve.curve)
    found = looked.gains(stack, pairs, correct=correct_gains)
    told = None if curve is None else _told(curve, corrected=bends)
    record = found.record.model_copy(update={"curve": told})
    undone = curve.curve if curve is not None and bends else None
    return Exposures(record, undone, found.gains, found.white, found.black)


@dataclass(frozen=True, slots=True)
class _Looked:
    """Some pixels of every frame, by its step."""

    frames: dict[int, Light]
    whites: tuple[FrameRecord, ...]
    blacks: tuple[FrameRecord, ...]
    tiles: NDArray[np.int64]

    @property
    def references(self) -> tuple[Light, Light]:
        """The first white and the mean of the black frames."""
        blacks = [self.frames[one.step] for one in self.blacks]
        mean = np.mean(np.stack([one.values for one in blacks]), axis=0, dtype=np.float64)
        usable = np.all([one.usable for one in blacks], axis=0)
        return self.frames[self.whites[0].step], Light(np.asarray(mean, np.float32), usable)

    def lights(self, pairs: Sequence[Pair]) -> list[tuple[Light, Light]]:
        """Of both frames of each."""
        return [(self.frames[one.step], self.frames[other.step]) for one, other in pairs]

    def through(self, curve: ToneCurve) -> _Looked:
        """With a curve undone."""
        frames = {step: curve.light(light) for step, light in self.frames.items()}
        return _Looked(frames, self.whites, self.blacks, self.tiles)

    def curve(self, pairs: Sequence[Sequence[Pair]]) -> Evidence | None:
        """From a few pairs of each pitch, one pitch after the other."""
        most = max(1, MOST_PAIRS // len(pairs))
        few = [group[:: -(-len(group) // most)] for group in pairs if group]
        chosen = [one for turn in zip_longest(*few) for one in turn if one is not None]
        return find_curve(self.lights(chosen[:MOST_PAIRS]), self.references, self.tiles)

    def _due_error(self, black: Gain | None) -> NDArray[np.float64] | float:
        """Of white and black light together, in parts of it, for the gain of black."""
        if black is None:
            return 0.0
        white, dark = (one.values.mean(axis=(0, 1), dtype=np.float64) for one in self.references)
        share: NDArray[np.float64] = dark / np.maximum(white + dark, 1e-30)
        return share * black.error / black.value**2

    def gains(self, stack: Stack, groups: Sequence[Sequence[Pair]], *, correct: bool) -> Exposures:
        """Of every frame that can be compared."""
        pairs = [pair for group in groups for pair in group]
        white = self.references[0]
        whites = [single_gain(self.frames[one.step], white, self.tiles) for one in self.whites[1:]]
        known = self.lights([pair for group in groups for pair in group[:2]])
        black = black_gain(known, self.references, self.tiles)
        due, usable = due_of(self.references, 1.0 if black is None else 1 / black.value)
        error = self._due_error(black)
        found = [pair_gains(pair, due, usable, self.tiles, error) for pair in self.lights(pairs)]
        every = [*found, *whites, black]
        differs = any(one is not None and one.differs for one in every)
        corrected = correct and differs
        told = [
            _pair(pair, one, corrected=corrected)
            for pair, one in zip(pairs, found, strict=True)
            if one is not None
        ]
        patterns = sum(len(group.frames) for group in stack.groups)
        record = ExposureRecord(
            differs=differs,
            corrected=corrected,
            pairs=tuple(told),
            white=tuple(
                _frame(frame, gain)
                for frame, gain in zip(self.whites[1:], whites, strict=True)
                if gain is not None
            ),
            black=None if black is None else _frame(self.blacks[0], black),
            unpaired=patterns - 2 * len(told),
        )
        if not corrected:
            return Exposures(record)
        gains = {
            stack.order(frame): tuple(gain.value.tolist())
            for pair, one in zip(pairs, found, strict=True)
            if one is not None and one.fits
            for frame, gain in zip(pair, one.gains, strict=True)
        }
        ones = np.ones(due.shape[-1])
        levels = [ones, *(ones if gain is None else gain.value for gain in whites)]
        dark = None if black is None else black.value
        return Exposures(record, None, gains, np.mean(levels, axis=0), dark)


def _pairs(stack: Stack) -> list[list[Pair]]:
    """Complementary frames of each group."""
    return [
        [(group.frames[one], group.frames[other]) for one, other in pairs]
        for group in stack.groups
        if (pairs := complementary_pairs(group.patterns))
    ]


def _obstacle(session: Session, pairs: Sequence[Sequence[Pair]]) -> str:
    """Why nothing can be found."""
    families = {frame.pattern.family for frame in session.frames}
    for family in (Family.WHITE, Family.BLACK):
        if family not in families:
            return f"there is no {family} frame"
    return "" if pairs else NO_PAIRS


def _looked(
    stack: Stack, frames: Sequence[FrameRecord], frame_done: Callable[[], None]
) -> _Looked | None:
    sites: Sites | None = None
    seen: dict[int, Light] = {}
    wanted = {Family.WHITE, Family.BLACK}
    compared = [
        one for one in frames if one.pattern.family.is_separable or one.pattern.family in wanted
    ]
    for batch in stack.batches([compared]):
        for frame, image in zip(batch.frames, batch.images, strict=True):
            sites = sites or Sites((image.values.shape[0], image.values.shape[1]))
            if not sites.suffice:
                return None
            seen[frame.step] = sites.light(image.values, image.saturated)
            frame_done()
    if sites is None:
        return None
    whites, blacks = (
        tuple(one for one in compared if one.pattern.family is family)
        for family in (Family.WHITE, Family.BLACK)
    )
    return _Looked(seen, whites, blacks, sites.tiles)


def _are_extrema(stack: Stack, looked: _Looked) -> bool:
    """Whether every pitch has two frames of which one is nowhere darker."""
    lights = [[looked.frames[frame.step] for frame in group.frames] for group in stack.groups]
    return all(len(group) == 2 and ordered(group[0].values, group[1].values) for group in lights)


def _has_curve(session: Session) -> bool:
    """Whether the frames are pictures that a camera may have given a curve."""
    source = session.record.source
    if source is None or source.transfer is Transfer.RAW:
        return False
    if not all(frame.media_type in PICTURE_TYPES for frame in session.frames):
        return False
    return not read_header(session.read(session.frames[0])).is_float


def _told(found: Evidence, *, corrected: bool) -> ToneCurveRecord:
    return ToneCurveRecord(
        codes=KNOTS,
        factors=found.curve.factors,
        errors=found.errors,
        without=found.without,
        with_curve=found.with_curve,
        corrected=corrected,
    )


def _pair(pair: Pair, found: PairGains, *, corrected: bool) -> PairRecord:
    first, second = (_frame(frame, gain) for frame, gain in zip(pair, found.gains, strict=True))
    return PairRecord(
        frames=(first, second),
        missed=found.missed,
        left=found.left,
        by_level=found.by_level,
        by_place=found.by_place,
        outlying=found.outlying,
        corrected=corrected and found.fits,
    )


def _frame(frame: FrameRecord, gain: Gain) -> FrameGainRecord:
    return FrameGainRecord(
        step=frame.step,
        pattern=str(frame.pattern),
        gain=tuple(gain.value.tolist()),
        error=tuple(gain.error.tolist()),
    )
