"""What a frame should look like, from what was captured before it.

The prediction is the proof's (`processing.proof.prediction`): a frame is the mean of white and
black plus what the frames of its own pitch say about it by the covariance of their codes. With the
complement it is exact whatever the scene is; with a few neighbours in shift only a known part of
its contrast is. Before any of them a geometry profile tells which projector pixel each camera pixel
sees: then direct light is drawn and all other light is left out.

Everything is done on pictures reduced by averaging, which commutes with prediction.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from acquire.plan import Plan
from acquire.proof.units import Unit, units_of
from acquire.session import FrameRecord
from processing.patterns import Family
from processing.proof.prediction import COMPLEMENT, pattern_covariance, weights_for

SIDE_PX = 512
MOST_HELD = 48
MOST_PREDICTORS = 4
# τ of the weights: some percent of noise, so that few neighbours are not asked for too much.
NUGGET = 1e-2
# Below this part of the contrast the geometry, where it is known, says more than the neighbours.
WEAK, NOTHING = 0.9, 0.2

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]
Places = tuple[NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True, slots=True)
class Small:
    """A picture reduced to at most `SIDE_PX` a side.

    Parameters
    ----------
    values
        float32, (height, width, 3), linear, fraction of the sensor's range.
    usable
        bool, (height, width): nothing in it is saturated.
    whole_px
        (height, width) before it was reduced.
    """

    values: Image
    usable: Mask
    whole_px: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Expected:
    """What a frame should show.

    Parameters
    ----------
    how
        What it was predicted from, in words.
    prediction
        The frame as predicted; None where nothing predicts it.
    holds
        Part of the pattern's contrast that the prediction holds, in [0, 1]; None where that is
        not known.
    white
        Level of white less black, 99th percentile of the picture; None without both.
    light, expected_light
        Mean of the frame less black over white less black, and what it were if all light were
        direct.
    """

    how: str
    prediction: Small | None = None
    holds: float | None = None
    white: float | None = None
    light: float | None = None
    expected_light: float = 0.0


def reduced(values: Image, saturated: Mask, side_px: int = SIDE_PX) -> Small:
    """Reduce a picture by a whole or broken factor, the same on both sides.

    Parameters
    ----------
    values
        float32, (height, width, 3), linear.
    saturated
        bool, (height, width).
    side_px
        What the longer side may have.
    """
    height, width = saturated.shape
    factor = max(height, width) / side_px
    if factor <= 1:
        return Small(values, ~saturated, (height, width))
    size = max(round(width / factor), 1), max(round(height / factor), 1)
    share = cv2.resize(saturated.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    smaller = cv2.resize(values, size, interpolation=cv2.INTER_AREA)
    return Small(np.asarray(smaller, np.float32), share == 0, (height, width))


class Expectation:
    """Predicts the frames of one session; holds some of the last, reduced.

    Parameters
    ----------
    plan
        What is captured.
    projector_px
        (height, width) of the projector.
    frames
        The line that counts for each step so far; grows while the session does.
    develop
        Decodes the file of a line, and reduces it.
    places
        Columns and rows of the projector that the camera's pixels see, (height, width) each, NaN
        where none is known; None without a geometry profile.
    """

    def __init__(
        self,
        plan: Plan,
        projector_px: tuple[int, int],
        frames: dict[int, FrameRecord],
        develop: Callable[[FrameRecord], Small],
        places: Places | None = None,
    ) -> None:
        self._plan, self._projector_px, self._frames = plan, projector_px, frames
        self._develop, self._places = develop, places
        self._held: OrderedDict[str, Small] = OrderedDict()
        self._units = {
            step: unit for unit in units_of(plan) if not unit.are_references for step in unit.steps
        }

    def of(self, record: FrameRecord, picture: Small) -> Expected:
        """What the frame of a line should show, whatever it does show."""
        self._hold(record, picture)
        white, black = self._reference(Family.WHITE, record), self._reference(Family.BLACK, record)
        found = self._predicted(record, white, black)
        if white is None or black is None:
            return found
        light, dark = self._small(white), self._small(black)
        span = light.values - dark.values
        mean = float(span.mean(dtype=np.float64))
        own = float((self._small(record).values - dark.values).mean(dtype=np.float64))
        return Expected(
            found.how,
            found.prediction,
            found.holds,
            float(np.percentile(span.mean(axis=2), 99)),
            own / mean if mean > 0 else None,
            float(record.pattern.code((256, 256)).mean()),
        )

    def _predicted(
        self, record: FrameRecord, white: FrameRecord | None, black: FrameRecord | None
    ) -> Expected:
        family = record.pattern.family
        if family.is_reference:
            return self._like_the_first(record, white if family is Family.WHITE else black)
        unit = self._units.get(record.step)
        if unit is None:
            return Expected("patterns of this kind are not predicted: only the raster is known")
        if white is None or black is None:
            return Expected("no white and black of this exposure yet: only the raster is known")
        known = self._from_its_kind(record, unit, white, black)
        if known is not None and (known.holds or 0) >= WEAK:
            return known
        drawn = self._drawn(record, white, black)
        nothing = "the first of its pitch, nothing predicts it yet: only the raster is known"
        return drawn or known or Expected(nothing)

    def _like_the_first(self, record: FrameRecord, first: FrameRecord | None) -> Expected:
        if first is None or first == record:
            return Expected(
                f"the first {record.pattern}, nothing predicts it: only the raster is known"
            )
        return Expected(f"like step {first.step}, the first {record.pattern}", self._small(first))

    def _from_its_kind(
        self, record: FrameRecord, unit: Unit, white: FrameRecord, black: FrameRecord
    ) -> Expected | None:
        steps = [
            step
            for step in unit.steps
            if step in self._frames and step != record.step and self._like(step, record)
        ]
        patterns = [self._plan.patterns[step] for step in (record.step, *steps)]
        covariance = pattern_covariance(patterns, self._projector_px)
        others = np.ones(len(steps) + 1, bool)
        others[0] = False
        weights, _ = weights_for(0, covariance, others, NUGGET)
        scale = np.sqrt(np.diag(covariance))
        correlation = covariance[0] / (scale[0] * scale)
        chosen = np.argsort(-np.abs(weights), kind="stable")[:MOST_PREDICTORS]
        exact = bool(correlation.min() < COMPLEMENT)
        if exact:
            chosen = np.array([int(correlation.argmin())])
        others[:] = False
        others[chosen[chosen > 0]] = True
        weights, holds = weights_for(0, covariance, others, 1e-6 if exact else NUGGET)
        if holds < NOTHING:
            return None
        light, dark = self._small(white), self._small(black)
        middle = (light.values + dark.values) / 2
        values: Image = middle.astype(np.float32)
        usable: Mask = light.usable & dark.usable
        used = np.flatnonzero(others)
        for k in used:
            other = self._small(self._frames[steps[k - 1]])
            values += np.float32(weights[k]) * (other.values - middle)
            usable &= other.usable
        named = ", ".join(str(step) for step in sorted(steps[k - 1] for k in used))
        many = "steps" if len(used) > 1 else "step"
        what = f"its complement, step {named}" if exact else f"its like, {many} {named}"
        return Expected(f"white, black and {what}", Small(values, usable, light.whole_px), holds)

    def _drawn(
        self, record: FrameRecord, white: FrameRecord, black: FrameRecord
    ) -> Expected | None:
        """Direct light only, sharp, by the geometry; None where that does not fit the camera."""
        light, dark = self._small(white), self._small(black)
        if self._places is None or self._places[0].shape != light.whole_px:
            return None
        code = _seen(record.pattern.code(self._projector_px), *self._places)
        height, width = light.usable.shape
        reduced = cv2.resize(code, (width, height), interpolation=cv2.INTER_AREA)
        lit = np.nan_to_num(reduced)[..., np.newaxis].astype(np.float32)
        usable = light.usable & dark.usable & np.isfinite(reduced)
        values = dark.values + lit * (light.values - dark.values)
        values[~np.isfinite(reduced)] = 0
        return Expected(
            "white, black and the geometry profile: as if all light were direct",
            Small(np.asarray(values, np.float32), usable, light.whole_px),
        )

    def _reference(self, family: Family, like: FrameRecord) -> FrameRecord | None:
        """The first frame of white or black that was exposed like another."""
        steps = (
            step
            for step in sorted(self._frames)
            if self._plan.patterns[step].family is family and self._like(step, like)
        )
        first = next(steps, None)
        return None if first is None else self._frames[first]

    def _like(self, step: int, record: FrameRecord) -> bool:
        return self._frames[step].settings == record.settings

    def _small(self, record: FrameRecord) -> Small:
        if record.file not in self._held:
            self._hold(record, self._develop(record))
        self._held.move_to_end(record.file)
        return self._held[record.file]

    def _hold(self, record: FrameRecord, picture: Small) -> None:
        self._held[record.file] = picture
        if len(self._held) > MOST_HELD:
            self._held.popitem(last=False)


def _seen(
    code: NDArray[np.float64], column: NDArray[np.float32], row: NDArray[np.float32]
) -> NDArray[np.float32]:
    """The code at places, NaN where a place is unknown or beside the raster."""
    seen = cv2.remap(
        code.astype(np.float32),
        np.nan_to_num(column, nan=-9).astype(np.float32),
        np.nan_to_num(row, nan=-9).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )
    return np.asarray(seen, np.float32)
