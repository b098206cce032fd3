"""Direct and global light at one pitch, from frames that are streamed one at a time.

Frames are linear, black already subtracted. For binary patterns (Nayar et al., SIGGRAPH 2006)
with L⁺ and L⁻ the largest and smallest value of a pixel over the shifts, and b the fraction of
its light that an "off" projector pixel still emits,

    direct = (L⁺ − L⁻)/(1 − b),    global = 2 (L⁻ − b L⁺)/(1 − b²),

and their sum (L⁺ + L⁻)/(1 + b) is the scene under full light. A frame and that of the
complementary pattern add up to (1 + b) white. With the white frame known every frame therefore
counts twice: L⁺ = max(max f, (1 + b) white − min f) and L⁻ = (1 + b) white − L⁺, so that
direct + global = white.

For sinusoids ½(1 + cos φ), f = mean + amplitude · cos(φ + advance) is fitted over the shifts:

    direct = 2 amplitude/(1 − b),    global = 2 mean/(1 + b) − direct,

or white − direct where the white frame is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import cos, hypot, sin
from processing.numerics.linear_algebra import inverse

Image: TypeAlias = NDArray[np.float32]

# Advances nearer than this, in radians, are the same shift: a thousandth of the finest step.
_SAME_PHASE = 1e-5


@dataclass(frozen=True, slots=True)
class Separation:
    """Light of one pitch taken apart.

    Parameters
    ----------
    direct_light, global_light
        float32, (height, width, 3), linear, in the unit of the frames; noise may take them
        below 0.
    """

    direct_light: Image
    global_light: Image


class Separator(Protocol):
    """What has been learnt from the frames of one pitch so far."""

    def separate(
        self, white: Image | None = None, leak: float = 0.0, room: Separation | None = None
    ) -> Separation:
        """Direct and global light, from the frames added so far.

        Parameters
        ----------
        white
            float32, (height, width, 3), the scene under full light, black subtracted.
        leak
            b in [0, 1). 0 where the frames had a measured black frame subtracted.
        room
            One of the frames' shape that is no longer needed: it is written over and returned.
        """
        ...


class ExtremaSeparation:
    """Largest and smallest value of every pixel over the shifts of a binary pattern.

    Nothing but these two images is held, whatever the number of frames.

    Parameters
    ----------
    shape
        (height, width, 3) of the frames.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._largest = np.empty(shape, np.float32)
        self._smallest = np.empty(shape, np.float32)
        self._n_frames = np.zeros(shape[0], np.int64)
        self.clear()

    def clear(self) -> None:
        """Begin anew: another pitch, in the memory of the one before."""
        self._largest.fill(-np.inf)
        self._smallest.fill(np.inf)
        self._n_frames.fill(0)

    def add(self, frame: Image) -> None:
        """Take in one frame, float32, (height, width, 3), black subtracted."""
        _check_image("frame", frame, self._largest.shape)
        self.add_lines(frame[np.newaxis], slice(0, len(frame)))

    def add_lines(self, frames: Image, lines: slice) -> None:
        """Take in some lines of several frames, which must get all of their lines in the end.

        Parameters
        ----------
        frames
            float32, (frames, lines, width, 3), black subtracted.
        lines
            Which ones.
        """
        largest, smallest = self._largest[lines], self._smallest[lines]
        _check_lines(frames, largest)
        _widen(_flat(frames), largest.reshape(-1), smallest.reshape(-1))
        self._n_frames[lines] += len(frames)

    def separate(
        self, white: Image | None = None, leak: float = 0.0, room: Separation | None = None
    ) -> Separation:
        """See `Separator.separate`; at least 2 frames are needed."""
        _check_leak(leak)
        n_frames = _of_all_lines(self._n_frames)
        if n_frames < 2:
            raise ValueError(f"max and min need at least 2 frames of a pitch, there are {n_frames}")
        room = room or _room(self._largest.shape)
        direct, rest = room.direct_light, room.global_light
        if white is None:
            np.subtract(self._largest, self._smallest, out=direct)
            direct /= np.float32(1 - leak)
            np.multiply(np.float32(leak), self._largest, out=rest)
            np.subtract(self._smallest, rest, out=rest)
            rest *= np.float32(2 / (1 - leak**2))
            return room
        _check_image("white", white, self._largest.shape)
        both = np.multiply(np.float32(1 + leak), white, out=rest)
        np.subtract(both, self._smallest, out=direct)
        np.maximum(self._largest, direct, out=direct)
        direct *= 2
        direct -= both
        direct /= np.float32(1 - leak)
        np.subtract(white, direct, out=rest)
        return room


class SinusoidSeparation:
    """Sums over the shifts of a sinusoid from which its mean and amplitude follow.

    Parameters
    ----------
    shape
        (height, width, 3) of the frames.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._moments = np.zeros((3, *shape), np.float32)
        self._n_frames: dict[float, NDArray[np.int64]] = {}

    def clear(self) -> None:
        """Begin anew: another pitch, in the memory of the one before."""
        self._moments.fill(0)
        self._n_frames.clear()

    def add(self, frame: Image, phase: float) -> None:
        """Take in one frame.

        Parameters
        ----------
        frame
            float32, (height, width, 3), black subtracted.
        phase
            Advance of the sinusoid through its shift, in radians.
        """
        _check_image("frame", frame, self._moments.shape[1:])
        self.add_lines(frame[np.newaxis], [phase], slice(0, len(frame)))

    def add_lines(self, frames: Image, phases: Sequence[float], lines: slice) -> None:
        """Take in some lines of several frames, which must get all of their lines in the end.

        Parameters
        ----------
        frames
            float32, (frames, lines, width, 3), black subtracted.
        phases
            Of each frame, see `add`.
        lines
            Which ones.
        """
        moments = self._moments[:, lines]
        _check_lines(frames, moments[0])
        bases = np.array([_basis(phase) for phase in phases], np.float32)
        _project(_flat(frames), bases, *(moment.reshape(-1) for moment in moments))
        for phase in phases:
            counts = self._n_frames.setdefault(
                float(phase), np.zeros(self._moments.shape[1], np.int64)
            )
            counts[lines] += 1

    def separate(
        self, white: Image | None = None, leak: float = 0.0, room: Separation | None = None
    ) -> Separation:
        """See `Separator.separate`; at least 3 advances that differ modulo 2π are needed."""
        _check_leak(leak)
        n_frames = {phase: _of_all_lines(counts) for phase, counts in self._n_frames.items()}
        n_phases = _count_distinct([phase % (2 * np.pi) for phase in n_frames])
        if n_phases < 3:
            raise ValueError(
                f"a sinusoid needs at least 3 shifts that differ modulo its period; "
                f"{sum(n_frames.values())} frames hold {n_phases}"
            )
        normal = np.zeros((3, 3))
        for phase, count in n_frames.items():
            normal += count * np.outer(_basis(phase), _basis(phase))
        solution = inverse(normal).astype(np.float32)
        first, second, third = self._moments
        mean, cosine, sine = (a * first + b * second + c * third for a, b, c in solution)
        room = room or _room(mean.shape)
        direct = room.direct_light
        np.multiply(hypot(cosine, sine), np.float32(2 / (1 - leak)), out=direct)
        if white is None:
            mean *= np.float32(2 / (1 + leak))
            white = mean
        else:
            _check_image("white", white, mean.shape)
        np.subtract(white, direct, out=room.global_light)
        return room


def _room(shape: tuple[int, ...]) -> Separation:
    return Separation(np.empty(shape, np.float32), np.empty(shape, np.float32))


def _check_image(name: str, image: Image, shape: tuple[int, ...]) -> None:
    if image.shape != shape:
        raise ValueError(f"{name} has shape {image.shape}, the frames of this pitch {shape}")
    if image.dtype != np.float32:
        raise ValueError(f"{name} must be float32 with black subtracted, not {image.dtype}")


def _check_lines(frames: Image, sums: Image) -> None:
    if frames.shape[1:] != sums.shape:
        raise ValueError(f"frames have shape {frames.shape}, the lines of this pitch {sums.shape}")
    if not sums.flags.c_contiguous:
        raise ValueError("only lines that follow one another are added at once")
    if frames.dtype != np.float32:
        raise ValueError(f"frames must be float32 with black subtracted, not {frames.dtype}")


def _of_all_lines(n_frames: NDArray[np.int64]) -> int:
    """How many frames there are; refuses to have more of one line than of another."""
    least, most = int(n_frames.min()), int(n_frames.max())
    if least != most:
        raise ValueError(f"some lines were added of {least} frames, others of {most}")
    return most


def _basis(phase: float) -> NDArray[np.float64]:
    return np.array([1.0, float(cos(phase)), float(sin(phase))])


def _check_leak(leak: float) -> None:
    if not 0 <= leak < 1:
        raise ValueError(f"leak is a fraction of white in [0, 1), not {leak}")


def _count_distinct(phases: list[float]) -> int:
    """Number of different angles on the circle."""
    if not phases:
        return 0
    around = np.sort(phases)
    gaps = np.diff(around, append=around[0] + 2 * np.pi)
    return max(1, int(np.count_nonzero(gaps > _SAME_PHASE)))


def _flat(frames: Image) -> Image:
    return np.ascontiguousarray(frames).reshape(len(frames), -1)


# Pieces of this length stay in the first-level cache while all frames go over them.
_PIECE = 1024


@numba.njit(nogil=True, cache=True)
def _widen(frames, largest, smallest):  # type: ignore[no-untyped-def]
    """Widen the extrema to hold all frames, (frames, values); NaN stays NaN."""
    for start in range(0, largest.size, _PIECE):
        stop = min(start + _PIECE, largest.size)
        high, low = largest[start:stop], smallest[start:stop]
        for k in range(len(frames)):
            values = frames[k, start:stop]
            for i in range(values.size):
                high[i] = np.maximum(high[i], values[i])
                low[i] = np.minimum(low[i], values[i])


@numba.njit(nogil=True, cache=True)
def _project(frames, bases, constant, cosine, sine):  # type: ignore[no-untyped-def]
    """Add all frames times (1, cos, sin) to the three moments."""
    for start in range(0, constant.size, _PIECE):
        stop = min(start + _PIECE, constant.size)
        first, second, third = constant[start:stop], cosine[start:stop], sine[start:stop]
        for k in range(len(frames)):
            values = frames[k, start:stop]
            for i in range(values.size):
                first[i] += bases[k, 0] * values[i]
                second[i] += bases[k, 1] * values[i]
                third[i] += bases[k, 2] * values[i]
