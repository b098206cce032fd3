"""The frames of a session as linear light, one at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
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

DECODERS = 2


@dataclass(frozen=True, slots=True)
class Reading:
    """How raw frames become pixels; pictures have theirs already.

    Parameters
    ----------
    demosaic
        How photosites become pixels.
    black
        Level of each colour without light, over the black level that the files state, fraction
        of the sensor's range.
    """

    demosaic: Demosaic = Demosaic.SUPERPIXEL
    black: tuple[float, ...] | None = None


class Frames:
    """Decodes a session lazily, as `reading` says.

    `saturated`, (height, width), collects the pixels that reached the white level in any frame
    decoded so far.
    """

    def __init__(self, session: Session, reading: Reading | None = None) -> None:
        self._session = session
        self._reading = reading or Reading()
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
        with ThreadPoolExecutor(DECODERS, thread_name_prefix="decode") as decoders:
            for frame in frames:
                waiting.append((frame, decoders.submit(self._decode, frame)))
                if len(waiting) > DECODERS:
                    yield self._note(*waiting.popleft())
            while waiting:
                yield self._note(*waiting.popleft())

    def leave_out(self, superpixels: NDArray[np.bool_]) -> None:
        """Count superpixels, (height, width), as saturated from the start: hot ones.

        Of demosaiced frames, these are all pixels that one of the four photosites went into.
        """
        self._hot = superpixels

    def _decode(self, frame: FrameRecord) -> LinearImage:
        data = self._session.read(frame)
        try:
            demosaic = self._reading.demosaic
            image = decode_frame(data, frame.media_type, self._transfer, demosaic)
        except DecodeError as error:
            raise StackError(f"{self._session.folder / frame.file}: {error}") from error
        if self._reading.black is not None and not self._is_picture(frame):
            level = np.array(self._reading.black, np.float32)
            np.subtract(image.values, level, out=image.values)
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
        if self._reading.demosaic is Demosaic.SUPERPIXEL or self._is_picture(frame):
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
) -> LinearImage:
    """Linear light of a frame's file; raises `drivers.errors.DecodeError`."""
    if _is_picture(media_type, transfer):
        return decode_picture(data, "srgb" if transfer is Transfer.SRGB else "linear")
    return decode_raw(data, demosaic)


def _is_picture(media_type: str, transfer: Transfer) -> bool:
    return transfer is not Transfer.RAW and media_type in PICTURE_TYPES
