"""The frames of a session as linear light, one at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.session import FrameRecord, Session, Transfer
from drivers.errors import DecodeError
from drivers.image import Demosaic, LinearImage
from drivers.media import PICTURE_TYPES
from drivers.picture import decode_picture
from drivers.raw import decode_raw
from processing.patterns import Family

DECODERS = 2


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
    """

    image: NDArray[np.float32]
    spread: float


class Stack:
    """Decodes a session lazily; knows which frames belong together.

    Raw frames become pixels as `demosaic` says; pictures have theirs already.
    `saturated`, (height, width), collects the pixels that reached the white level in any frame
    decoded so far.
    """

    def __init__(self, session: Session, demosaic: Demosaic = Demosaic.SUPERPIXEL) -> None:
        self._session = session
        self._demosaic = demosaic
        self._transfer = session.record.source.transfer if session.record.source else Transfer.RAW
        self.groups = _groups(session.frames)
        if not self.groups:
            raise StackError(
                f"{session.folder} holds no pattern frames yet; there is nothing to separate."
            )
        self.saturated: NDArray[np.bool_] | None = None

    @property
    def has_mosaics(self) -> bool:
        """Whether any frame is a raw file, which `demosaic` makes pixels of."""
        return not all(self._is_picture(frame) for frame in self._session.frames)

    def __len__(self) -> int:
        return len(self._session.frames)

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
        return Reference(total / np.float32(len(frames)), spread)

    def images(self, frames: Iterable[FrameRecord]) -> Iterator[tuple[FrameRecord, LinearImage]]:
        """Decode frames in order, the next ones already while one is in use."""
        waiting: deque[tuple[FrameRecord, Future[LinearImage]]] = deque()
        with ThreadPoolExecutor(DECODERS, thread_name_prefix="decode") as decoders:
            for frame in frames:
                waiting.append((frame, decoders.submit(self._decode, frame)))
                if len(waiting) > DECODERS:
                    yield self._note(*waiting.popleft())
            while waiting:
                yield self._note(*waiting.popleft())

    def _decode(self, frame: FrameRecord) -> LinearImage:
        data = self._session.read(frame)
        try:
            if self._is_picture(frame):
                return decode_picture(data, "srgb" if self._transfer is Transfer.SRGB else "linear")
            return decode_raw(data, self._demosaic)
        except DecodeError as error:
            raise StackError(f"{self._session.folder / frame.file}: {error}") from error

    def _is_picture(self, frame: FrameRecord) -> bool:
        return self._transfer is not Transfer.RAW and frame.media_type in PICTURE_TYPES

    def _note(
        self, frame: FrameRecord, decoding: Future[LinearImage]
    ) -> tuple[FrameRecord, LinearImage]:
        image = decoding.result()
        if self.saturated is None:
            self.saturated = np.zeros_like(image.saturated)
        if image.saturated.shape != self.saturated.shape:
            raise StackError(
                f"{self._session.folder / frame.file} is {image.saturated.shape}, the frames "
                f"before it {self.saturated.shape} (height, width): they cannot be compared."
            )
        self.saturated |= image.saturated
        return frame, image


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
