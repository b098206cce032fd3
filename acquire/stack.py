"""The frames of a session by pitch, and its references."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.frames import Frames, Reading
from acquire.session import FrameRecord, Session
from processing.frames.drift import Level
from processing.frames.frame_noise import lattice
from processing.patterns import Family, Pattern, balanced


@dataclass(frozen=True, slots=True)
class PitchGroup:
    """The frames of one family of patterns at one pitch."""

    family: Family
    pitch_px: int
    frames: tuple[FrameRecord, ...]

    @property
    def patterns(self) -> list[Pattern]:
        """What each frame shows."""
        return [frame.pattern for frame in self.frames]

    @property
    def is_balanced(self) -> bool:
        """The mean over the frames is half of white."""
        return balanced(self.patterns)


@dataclass(frozen=True, slots=True)
class Reference:
    """Mean of the white or of the black frames.

    Parameters
    ----------
    image
        float32, (height, width, 3), fraction of the sensor's range.
    spread
        Largest difference between the mean level of any one frame and of all, relative to the
        latter: 0 for a single frame.
    levels
        A lattice of pixels of each, in the order of the plan.
    """

    image: NDArray[np.float32]
    spread: float
    levels: tuple[Level, ...]

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self.levels)


class Stack(Frames):
    """Decodes a session lazily; knows which frames belong together."""

    def __init__(self, session: Session, reading: Reading | None = None) -> None:
        super().__init__(session, reading)
        self.groups = _groups(session.frames)
        if not self.groups:
            raise StackError(
                f"{session.folder} holds no pattern frames yet; there is nothing to separate."
            )

    def reference(self, family: Family, frame_done: Callable[[], None]) -> Reference | None:
        """White or black; None when the session has none. Calls `frame_done` after each frame."""
        frames = [frame for frame in self._session.frames if frame.pattern.family is family]
        if not frames:
            return None
        total: NDArray[np.float32] | None = None
        means, levels = list[float](), list[Level]()
        for batch in self.batches([frames]):
            for frame, image in zip(batch.frames, batch.images, strict=True):
                values = image.values
                total = values.copy() if total is None else np.add(total, values, out=total)
                means.append(float(values.mean(dtype=np.float64)))
                sample = values[lattice(values.shape[:2])].copy()
                levels.append(Level(self.order(frame), sample))
                frame_done()
        if total is None:
            return None
        mean_level = float(np.mean(means))
        spread = float(np.ptp(means)) / 2 / max(abs(mean_level), 1e-6)
        total /= np.float32(len(frames))
        return Reference(total, spread, tuple(levels))

    def order(self, frame: FrameRecord) -> int:
        """Place of a frame among all exposures, those included that were taken again."""
        return self._session.order(frame)


def _groups(frames: Iterable[FrameRecord]) -> tuple[PitchGroup, ...]:
    members: dict[tuple[Family, int], list[FrameRecord]] = {}
    for frame in frames:
        if frame.pattern.family.is_separable:
            key = frame.pattern.family, frame.pattern.pitch_px
            members.setdefault(key, []).append(frame)
    return tuple(
        PitchGroup(family, pitch_px, tuple(members[family, pitch_px]))
        for family, pitch_px in sorted(members, key=lambda key: (key[1], key[0]))
    )
