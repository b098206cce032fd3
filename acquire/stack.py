"""The frames of a session by pitch, and its references."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.frames import Frames
from acquire.session import FrameRecord, Session
from drivers.image import Demosaic
from processing.patterns import Family


@dataclass(frozen=True, slots=True)
class PitchGroup:
    """The frames of one family of patterns at one pitch."""

    family: Family
    pitch_px: int
    frames: tuple[FrameRecord, ...]


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
    frames
        How many there are.
    """

    image: NDArray[np.float32]
    spread: float
    frames: int


class Stack(Frames):
    """Decodes a session lazily; knows which frames belong together."""

    def __init__(self, session: Session, demosaic: Demosaic = Demosaic.SUPERPIXEL) -> None:
        super().__init__(session, demosaic)
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
        levels = []
        for _, image in self.images(frames):
            total = image.values.copy() if total is None else np.add(total, image.values, out=total)
            levels.append(float(image.values.mean(dtype=np.float64)))
            frame_done()
        if total is None:
            return None
        mean_level = float(np.mean(levels))
        spread = float(np.ptp(levels)) / 2 / max(abs(mean_level), 1e-6)
        return Reference(total / np.float32(len(frames)), spread, len(frames))


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
