"""Frames of a calibration as light: means, pairs and which pixels count."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.errors import ProfileError
from acquire.frames import Frames
from acquire.session import FrameRecord, Session
from calibration.errors import UnsupportedError
from drivers.image import LinearImage
from processing.patterns import Family

Image = NDArray[np.float32]
LIT_FRACTION = 0.1
BRIGHT_PERCENTILE = 99.5
STEADY = 0.01
LEAST_CHANGE = 5e-4


@dataclass(frozen=True, slots=True)
class References:
    """Mean white and black of a session, and what can be measured by them.

    Parameters
    ----------
    white, black
        float32, (height, width, colours), fraction of the sensor's range.
    usable
        bool, (height, width): unsaturated in every white, and lit by a tenth of the brightest
        and more.
    white_levels
        (frames, colours): mean of every white frame over the usable pixels.
    """

    white: Image
    black: Image
    usable: NDArray[np.bool_]
    white_levels: NDArray[np.float64]

    @property
    def light(self) -> Image:
        """White less black."""
        return self.white - self.black


class Viewer:
    """Reads a calibration's frames one after the other and tells of progress.

    Equal frames that follow one another must show equal light, unless `steady` is False.
    """

    def __init__(
        self, session: Session, frame_done: Callable[[], None], *, steady: bool = True
    ) -> None:
        self.session = session
        self._steady = steady
        self._frames = Frames(session)
        self._frame_done = frame_done

    def all_of(self, family: Family) -> list[FrameRecord]:
        """Frames of a family, in order; refuses a session that has none."""
        found = [frame for frame in self.session.frames if frame.pattern.family is family]
        if not found:
            raise ProfileError(
                f"{self.session.folder} holds no {family} frame; it was captured for something "
                "else. Name the session of this calibration."
            )
        return found

    def images(self, frames: Iterable[FrameRecord]) -> Iterator[tuple[FrameRecord, LinearImage]]:
        """Decoded, in order."""
        before: tuple[FrameRecord, float] | None = None
        brightest = 0.0
        for frame, image in self._frames.images(frames):
            level = float(image.values.mean(dtype=np.float64))
            brightest = max(brightest, level)
            if self._steady and before is not None and self._equal(before[0], frame):
                self._check_steady(frame, before[1] - level, brightest)
            before = frame, level
            yield frame, image
            self._frame_done()

    def _equal(self, first: FrameRecord, second: FrameRecord) -> bool:
        steps = self.session.plan.step(first.step), self.session.plan.step(second.step)
        alike = (steps[0].pattern, steps[0].settings) == (steps[1].pattern, steps[1].settings)
        return alike and second.step == first.step + 1

    def _check_steady(self, frame: FrameRecord, change: float, brightest: float) -> None:
        if abs(change) > max(STEADY * brightest, LEAST_CHANGE):
            raise UnsupportedError(
                f"steps {frame.step - 1} and {frame.step} show the same {frame.pattern}, yet their "
                f"light differs by {abs(change) / brightest:.1%} of the brightest frame: the first "
                "was taken before the pattern stood (settle_s is too short: `lumisplit calibrate "
                "latency`), the lamp flickers (`lumisplit calibrate exposure`), or the room's "
                "light changed"
            )

    def mean(self, frames: list[FrameRecord]) -> tuple[Image, NDArray[np.bool_]]:
        """Mean of the frames, and the pixels that are saturated in any of them."""
        total: Image | None = None
        saturated: NDArray[np.bool_] | None = None
        for _, image in self.images(frames):
            total = image.values.copy() if total is None else np.add(total, image.values, out=total)
            saturated = image.saturated if saturated is None else saturated | image.saturated
        if total is None or saturated is None:
            raise ProfileError(f"{self.session.folder} holds no frame to average.")
        return total / np.float32(len(frames)), saturated

    def references(self) -> References:
        """Mean white and black; refuses what is dark or saturated all over."""
        black, _ = self.mean(self.all_of(Family.BLACK))
        whites = self.all_of(Family.WHITE)
        white, saturated = self.mean(whites)
        usable = lit_pixels(white - black, saturated)
        levels = [image.values[usable].mean(axis=0) for _, image in self.images(whites)]
        return References(white, black, usable, np.array(levels, np.float64))


def lit_pixels(light: Image, saturated: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Unsaturated and in some colour a tenth as bright as the brightest and more."""
    brightness = light.max(axis=-1)
    if not np.any(~saturated):
        raise ProfileError(
            "Every pixel is saturated under white: shorten the exposure, stop the lens down or "
            "lower the ISO (`lumisplit calibrate exposure` advises)."
        )
    bright = float(np.percentile(brightness[~saturated], BRIGHT_PERCENTILE))
    usable: NDArray[np.bool_] = ~saturated & (brightness > LIT_FRACTION * max(bright, 1e-6))
    if bright < 0.01 or not usable.any():
        raise ProfileError(
            f"White is only {100 * bright:.2f} % of the sensor's range brighter than black: the "
            "projector does not light the scene, or the exposure is far too short."
        )
    return usable
