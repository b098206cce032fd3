"""The frames of a session as linear light, one at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from acquire.errors import StackError
from acquire.session import FrameRecord, Session, Transfer
from drivers.errors import DecodeError
from drivers.image import Demosaic, LinearImage
from drivers.media import PICTURE_TYPES
from drivers.picture import decode_picture
from drivers.raw import decode_raw

DECODERS = 2


class Frames:
    """Decodes a session lazily.

    Raw frames become pixels as `demosaic` says; pictures have theirs already.
    `saturated`, (height, width), collects the pixels that reached the white level in any frame
    decoded so far.
    """

    def __init__(self, session: Session, demosaic: Demosaic = Demosaic.SUPERPIXEL) -> None:
        self._session = session
        self._demosaic = demosaic
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

    def leave_out(self, pixels: NDArray[np.bool_]) -> None:
        """Count pixels, (height, width), as saturated from the start: hot ones."""
        self.saturated = pixels.copy()

    def _decode(self, frame: FrameRecord) -> LinearImage:
        data = self._session.read(frame)
        try:
            return decode_frame(data, frame.media_type, self._transfer, self._demosaic)
        except DecodeError as error:
            raise StackError(f"{self._session.folder / frame.file}: {error}") from error

    def _is_picture(self, frame: FrameRecord) -> bool:
        return _is_picture(frame.media_type, self._transfer)

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
