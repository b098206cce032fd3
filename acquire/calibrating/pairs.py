"""Complementary pairs among any binary frames, and the contrast that they tell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from acquire.calibrating.light import References, Viewer
from acquire.errors import ProfileError
from acquire.session import FrameRecord
from calibration.pair_contrast import PairContrast, checker_modulation
from processing.patterns import Family, Pattern

Array: TypeAlias = NDArray[np.float64]
Pair: TypeAlias = tuple[FrameRecord, FrameRecord]

LEAST_PITCHES = 2
STRIPES = (Family.STRIPES_ROWS, Family.STRIPES_COLUMNS)


@dataclass(frozen=True, slots=True)
class Paired:
    """Contrast by pairs.

    Parameters
    ----------
    ways
        Families that were used: checkers, or stripes of one direction or both.
    pitch_px
        (pitches,), rising: those that every family has.
    modulation
        (pitches, 2, colours): a checker's of the same blur; of stripes down the rows' blur in
        both directions, then that along the columns, or twice the one that there is.
    extremes
        (pitches, colours): what max/min reads as direct fraction, mean of the families.
    blocks
        (pitches, parts, parts): modulation over parts of the picture.
    gains
        Sum of each pair over white, the darkest and the brightest.
    """

    ways: tuple[Family, ...]
    pitch_px: Array
    modulation: Array
    extremes: Array
    blocks: Array
    gains: tuple[float, float]


def paired(viewer: Viewer, seen: References, blocks: int) -> Paired:
    """Read all pairs of a session, one pitch after the other.

    Raises
    ------
    ProfileError
        Fewer than two pitches have complementary pairs.
    """
    pairs = _pairs(viewer.session.frames)
    ways, pitches = _chosen(pairs)
    if len(pitches) < LEAST_PITCHES:
        raise ProfileError(
            f"{viewer.session.folder} holds no two pitches of checkers or stripes with their "
            "complements: contrast cannot be told. `lumisplit calibrate board --bench …` captures "
            "what is needed; of other frames each needs the one shifted by one pitch."
        )
    n_whites = len(viewer.all_of(Family.WHITE))
    modulation = np.zeros((len(ways), len(pitches), seen.light.shape[2]))
    extremes = np.zeros_like(modulation)
    parts = np.zeros((len(ways), len(pitches), blocks, blocks))
    gains: list[float] = []
    for w, way in enumerate(ways):
        directions = way.varies_down + way.varies_right
        for k, pitch_px in enumerate(pitches):
            contrast = PairContrast(seen.light, seen.usable, n_whites, blocks)
            for one, other in _images(viewer, pairs[way, pitch_px]):
                contrast.add(one - seen.black, other - seen.black)
            modulation[w, k] = checker_modulation(contrast.mean_square(), directions)
            extremes[w, k] = contrast.extremes()
            parts[w, k] = checker_modulation(contrast.blocks(), directions)
            gains += contrast.gains
    return Paired(
        ways=ways,
        pitch_px=np.array(pitches, np.float64),
        modulation=np.stack([modulation[0], modulation[-1]], axis=1),
        extremes=extremes.mean(axis=0),
        blocks=parts.mean(axis=0),
        gains=(min(gains), max(gains)),
    )


def _images(
    viewer: Viewer, pairs: Iterable[Pair]
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    frames = [frame for pair in pairs for frame in pair]
    images = (image.values for _, image in viewer.images(frames))
    return zip(images, images, strict=True)


def _chosen(pairs: dict[tuple[Family, int], list[Pair]]) -> tuple[tuple[Family, ...], list[int]]:
    """Checkers if they tell enough, which see both directions at once; else stripes."""
    of = {way: {pitch for family, pitch in pairs if family is way} for way in Family}
    if len(of[Family.CHECKER]) >= LEAST_PITCHES:
        return (Family.CHECKER,), sorted(of[Family.CHECKER])
    both = of[STRIPES[0]] & of[STRIPES[1]]
    if len(both) >= LEAST_PITCHES:
        return STRIPES, sorted(both)
    most = max(STRIPES, key=lambda way: len(of[way]))
    return (most,), sorted(of[most])


def _pairs(frames: Sequence[FrameRecord]) -> dict[tuple[Family, int], list[Pair]]:
    """Each frame with its complement, once, by family and pitch."""
    places = {_place(frame.pattern): frame for frame in frames if frame.pattern.pitch_px}
    found: dict[tuple[Family, int], list[Pair]] = {}
    for (family, pitch_px, down, right), frame in places.items():
        if not family.is_binary or down >= pitch_px or (right >= pitch_px):
            continue
        turned = (down + pitch_px, right) if family.varies_down else (down, right + pitch_px)
        other = places.get((family, pitch_px, *turned))
        if other is not None:
            found.setdefault((family, pitch_px), []).append((frame, other))
    return found


def _place(pattern: Pattern) -> tuple[Family, int, int, int]:
    """Family, pitch and shift, alike for patterns that look alike.

    A checker that is shifted by a pitch both ways is itself: its shift right is below a pitch.
    """
    period = max(2 * pattern.pitch_px, 1)
    down, right = pattern.shift_y_px % period, pattern.shift_x_px % period
    if pattern.family is Family.CHECKER and right >= pattern.pitch_px:
        down, right = (down + pattern.pitch_px) % period, right - pattern.pitch_px
    return pattern.family, pattern.pitch_px, down, right
