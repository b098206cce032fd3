"""What the proof keeps of a frame: a few thousand places, a window, some counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from acquire.frames import decode_frame
from acquire.proof.file_notes import FileNotes, file_notes
from acquire.session import Transfer

GRID_SIDE = 128
WINDOW_SIDE = 192


@dataclass(frozen=True, slots=True)
class FrameSamples:
    """Light of a frame, mean of the colours.

    Parameters
    ----------
    grid
        float32, (rows, columns), every so many-th pixel each way, at most 128 × 128.
    saturated
        bool, (rows, columns), of the same places.
    slopes
        float32, (4, rows, columns): light of the pixels above, below, left and right, less its own.
    window
        float32, (height, width), the middle of the picture, at most 192 × 192 pixels, all of them.
    saturated_part
        Part of all pixels that are saturated.
    notes
        What the file says of its exposure.
    """

    grid: NDArray[np.float32]
    saturated: NDArray[np.bool_]
    slopes: NDArray[np.float32]
    window: NDArray[np.float32]
    saturated_part: float
    notes: FileNotes


def sample_frame(data: bytes, media_type: str, transfer: Transfer) -> FrameSamples:
    """Sample a frame's file; raises `drivers.errors.DecodeError`."""
    image = decode_frame(data, media_type, transfer)
    height, width = image.saturated.shape
    places = every_other((height, width))
    top, left = max(height - WINDOW_SIDE, 0) // 2, max(width - WINDOW_SIDE, 0) // 2
    window = image.values[top : top + WINDOW_SIDE, left : left + WINDOW_SIDE]
    return FrameSamples(
        grid=image.values[places].mean(axis=2),
        saturated=image.saturated[places].copy(),
        slopes=_slopes(image.values, places[0].step),
        window=window.mean(axis=2),
        saturated_part=float(image.saturated.mean()),
        notes=file_notes(data),
    )


def every_other(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The pixels of a picture, (height, width), whose light is kept."""
    step = -(-max(shape) // GRID_SIDE)
    return np.s_[step // 2 :: step, step // 2 :: step]


def _slopes(values: NDArray[np.float32], step: int) -> NDArray[np.float32]:
    """What the pixels above, below, left and right have more light than every so many-th one."""
    rows, columns = (np.arange(step // 2, size, step) for size in values.shape[:2])
    height, width = values.shape[:2]
    own = values[np.ix_(rows, columns)].mean(axis=2)
    rises = []
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        beside = np.clip(rows + down, 0, height - 1), np.clip(columns + right, 0, width - 1)
        rises.append(values[np.ix_(*beside)].mean(axis=2) - own)
    return np.stack(rises)
