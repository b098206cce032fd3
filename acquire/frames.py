"""The frames of a session as linear light, one at a time."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from acquire.errors import StackError
from acquire.session import FrameRecord, Session, Transfer
from drivers.errors import DecodeError
from drivers.image import Demosaic, LinearImage
from drivers.media import PICTURE_TYPES
from drivers.picture import decode_picture
from drivers.raw import decode_raw
from processing.frames.tone_curve import ToneCurve

# Threads that decode: one a core, up to so many that what they hold stays below half a gigabyte.
DECODERS = min(os.cpu_count() or 1, 6)
# Frames decoded ahead where each takes new memory.
_AHEAD = 2
# So many frames are taken in at a time, and fewer where they have more values than this together.
_BATCH_FRAMES = 4
_BATCH_VALUES = 100_000_000


@dataclass(frozen=True, slots=True)
class Batch:
    """Some frames of a group and what they hold, until the next batch is asked for.

    Parameters
    ----------
    group
        Place of the group among all.
    is_last
        No more frames of the group come.
    frames, images
        One image a frame.
    """

    group: int
    is_last: bool
    frames: tuple[FrameRecord, ...]
    images: tuple[LinearImage, ...]


@dataclass(frozen=True, slots=True)
class _Part:
    """Some frames of a group."""

    group: int
    is_last: bool
    frames: tuple[FrameRecord, ...]


@dataclass(frozen=True, slots=True)
class _Decoding:
    """A batch that is being decoded, into memory that is used again."""

    part: _Part
    rooms: Sequence[LinearImage | None]
    decoding: Sequence[Future[LinearImage]]


@dataclass(frozen=True, slots=True)
class Reading:
    """How raw frames become pixels, and what is undone in pictures, which have theirs already.

    Parameters
    ----------
    demosaic
        How photosites become pixels.
    black
        Level of each colour without light, over the black level that the files state, fraction
        of the sensor's range.
    curve
        That a camera gave its pictures beyond the one that is undone anyway.
    """

    demosaic: Demosaic = Demosaic.SUPERPIXEL
    black: tuple[float, ...] | None = None
    curve: ToneCurve | None = None


class Frames:
    """Decodes a session lazily, as `reading` says.

    `saturated`, (height, width), collects the pixels that reached the white level in any frame
    decoded so far.
    """

    def __init__(self, session: Session, reading: Reading | None = None) -> None:
        self._session = session
        self.reading = reading or Reading()
        self._hot: NDArray[np.bool_] | None = None
        self._transfer = session.record.source.transfer if session.record.source else Transfer.RAW
        self.saturated: NDArray[np.bool_] | None = None

    @property
    def has_mosaics(self) -> bool:
        """Whether any frame is a raw file, which `demosaic` makes pixels of."""
        return not all(self._is_picture(frame) for frame in self._session.frames)

    def __len__(self) -> int:
        return len(self._session.frames)

    def images(self, frames: Iterable[FrameRecord]) -> Iterator[tuple[FrameRecord, LinearImage]]:
        """Decode frames in order, the next ones already while one is in use."""
        waiting: deque[tuple[FrameRecord, Future[LinearImage]]] = deque()
        with ThreadPoolExecutor(_AHEAD, thread_name_prefix="decode") as decoders:
            for frame in frames:
                waiting.append((frame, decoders.submit(self._decode, frame)))
                if len(waiting) > _AHEAD:
                    yield self._note(*waiting.popleft())
            while waiting:
                yield self._note(*waiting.popleft())

    def batches(self, groups: Iterable[Sequence[FrameRecord]]) -> Generator[Batch, None, None]:
        """Decode frames in order, a few of one group at a time, the next ones while these are used.

        As `images`, for those who keep no image: the memory of a batch is used again.
        """
        used: list[LinearImage] = []
        waiting: deque[_Decoding] = deque()
        decoders = ThreadPoolExecutor(DECODERS, thread_name_prefix="decode")
        try:
            for part in self._parts(groups):
                rooms = [used.pop() if used else self._room() for _ in part.frames]
                decoding = [
                    decoders.submit(self._decode, frame, room)
                    for frame, room in zip(part.frames, rooms, strict=True)
                ]
                waiting.append(_Decoding(part, rooms, decoding))
                if len(waiting) > 1:
                    yield self._decoded(waiting[0])
                    used.extend(room for room in waiting.popleft().rooms if room is not None)
            while waiting:
                yield self._decoded(waiting.popleft())
        finally:
            decoders.shutdown(cancel_futures=True)

    def _parts(self, groups: Iterable[Sequence[FrameRecord]]) -> Iterator[_Part]:
        """One frame at a time until it is known how large they are."""
        for number, group in enumerate(groups):
            start = 0
            while start < len(group):
                values = _BATCH_VALUES if self.saturated is None else 3 * self.saturated.size
                stop = start + min(max(_BATCH_VALUES // values, 1), _BATCH_FRAMES)
                yield _Part(number, stop >= len(group), tuple(group[start:stop]))
                start = stop

    def _room(self) -> LinearImage | None:
        """Memory for an image, once it is known how large it is.

        Not taken by the threads that decode: what lies long among their own memory keeps that from
        being used again, and new memory costs a fifth of the time of decoding.
        """
        if self.saturated is None:
            return None
        shape = self.saturated.shape
        return LinearImage(np.empty((*shape, 3), np.float32), np.empty(shape, np.bool_))

    def _decoded(self, batch: _Decoding) -> Batch:
        part = batch.part
        pairs = [self._note(*pair) for pair in zip(part.frames, batch.decoding, strict=True)]
        return Batch(part.group, part.is_last, part.frames, tuple(image for _, image in pairs))

    def leave_out(self, superpixels: NDArray[np.bool_]) -> None:
        """Count superpixels, (height, width), as saturated from the start: hot ones.

        Of demosaiced frames, these are all pixels that one of the four photosites went into.
        """
        self._hot = superpixels

    def _decode(self, frame: FrameRecord, room: LinearImage | None = None) -> LinearImage:
        data = self._session.read(frame)
        try:
            demosaic = self.reading.demosaic
            image = decode_frame(data, frame.media_type, self._transfer, demosaic, room)
        except DecodeError as error:
            raise StackError(f"{self._session.folder / frame.file}: {error}") from error
        if self.reading.black is not None and not self._is_picture(frame):
            lines = image.values.reshape(len(image.values), -1)
            lines -= np.tile(np.array(self.reading.black, np.float32), image.values.shape[1])
        if self.reading.curve is not None and self._is_picture(frame):
            self.reading.curve.apply(image.values)
        return image

    def _is_picture(self, frame: FrameRecord) -> bool:
        return _is_picture(frame.media_type, self._transfer)

    def _note(
        self, frame: FrameRecord, decoding: Future[LinearImage]
    ) -> tuple[FrameRecord, LinearImage]:
        image = decoding.result()
        if self.saturated is None:
            self.saturated = self._left_out(frame, image.saturated.shape)
        if image.saturated.shape != self.saturated.shape:
            raise StackError(
                f"{self._session.folder / frame.file} is {image.saturated.shape}, the frames "
                f"before it {self.saturated.shape} (height, width): they cannot be compared."
            )
        self.saturated |= image.saturated
        return frame, image

    def _left_out(self, frame: FrameRecord, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """Hot pixels of an image."""
        if self._hot is None:
            return np.zeros(shape, np.bool_)
        if self.reading.demosaic is Demosaic.SUPERPIXEL or self._is_picture(frame):
            return self._hot.copy()
        photosites = np.repeat(np.repeat(self._hot, 2, axis=0), 2, axis=1)
        missing = [side - have for side, have in zip(shape, photosites.shape, strict=True)]
        if not all(0 <= one <= 1 for one in missing):
            return photosites
        padded = np.pad(photosites, [(0, one) for one in missing])
        return np.asarray(binary_dilation(padded, np.ones((3, 3), np.bool_)), np.bool_)


def decode_frame(
    data: bytes,
    media_type: str,
    transfer: Transfer,
    demosaic: Demosaic = Demosaic.SUPERPIXEL,
    room: LinearImage | None = None,
) -> LinearImage:
    """Linear light of a frame's file, in `room` where it fits a raw one.

    Raises `drivers.errors.DecodeError`.
    """
    if _is_picture(media_type, transfer):
        return decode_picture(data, "srgb" if transfer is Transfer.SRGB else "linear")
    return decode_raw(data, demosaic, room)


def _is_picture(media_type: str, transfer: Transfer) -> bool:
    return transfer is not Transfer.RAW and media_type in PICTURE_TYPES
