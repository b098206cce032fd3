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

from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

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

    def separate(self, white: Image | None = None, leak: float = 0.0) -> Separation:
        """Direct and global light, from the frames added so far.

        Parameters
        ----------
        white
            float32, (height, width, 3), the scene under full light, black subtracted.
        leak
            b in [0, 1). 0 where the frames had a measured black frame subtracted.
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
        self._n_frames = 0

    def add(self, frame: Image) -> None:
        """Take in one frame, float32, (height, width, 3), black subtracted."""
        _check_image("frame", frame, self._largest.shape)
        if self._n_frames:
            _widen(_flat(frame), self._largest.reshape(-1), self._smallest.reshape(-1))
        else:
            self._largest[:] = self._smallest[:] = frame
        self._n_frames += 1

    def separate(self, white: Image | None = None, leak: float = 0.0) -> Separation:
        """See `Separator.separate`; at least 2 frames are needed."""
        _check_leak(leak)
        if self._n_frames < 2:
            raise ValueError(
                f"max and min need at least 2 frames of a pitch, there are {self._n_frames}"
            )
        if white is None:
            direct = (self._largest - self._smallest) / np.float32(1 - leak)
            shade = self._smallest - np.float32(leak) * self._largest
            return Separation(direct, shade * np.float32(2 / (1 - leak**2)))
        _check_image("white", white, self._largest.shape)
        both = np.float32(1 + leak) * white
        largest = np.maximum(self._largest, both - self._smallest)
        direct = (2 * largest - both) / np.float32(1 - leak)
        return Separation(direct, white - direct)


class SinusoidSeparation:
    """Sums over the shifts of a sinusoid from which its mean and amplitude follow.

    Parameters
    ----------
    shape
        (height, width, 3) of the frames.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._moments = np.zeros((3, *shape), np.float32)
        self._normal = np.zeros((3, 3))
        self._phases: list[float] = []

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
        basis = np.array([1, np.cos(phase), np.sin(phase)])
        _project(_flat(frame), basis.astype(np.float32), self._moments.reshape(3, -1))
        self._normal += np.outer(basis, basis)
        self._phases.append(float(phase) % (2 * np.pi))

    def separate(self, white: Image | None = None, leak: float = 0.0) -> Separation:
        """See `Separator.separate`; at least 3 advances that differ modulo 2π are needed."""
        _check_leak(leak)
        n_phases = _count_distinct(self._phases)
        if n_phases < 3:
            raise ValueError(
                f"a sinusoid needs at least 3 shifts that differ modulo its period; "
                f"{len(self._phases)} frames hold {n_phases}"
            )
        solution = np.linalg.inv(self._normal).astype(np.float32)
        mean, cosine, sine = (np.tensordot(row, self._moments, 1) for row in solution)
        direct = np.hypot(cosine, sine) * np.float32(2 / (1 - leak))
        if white is None:
            return Separation(direct, mean * np.float32(2 / (1 + leak)) - direct)
        _check_image("white", white, self._moments.shape[1:])
        return Separation(direct, white - direct)


def _check_image(name: str, image: Image, shape: tuple[int, ...]) -> None:
    if image.shape != shape:
        raise ValueError(f"{name} has shape {image.shape}, the frames of this pitch {shape}")
    if image.dtype != np.float32:
        raise ValueError(f"{name} must be float32 with black subtracted, not {image.dtype}")


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


def _flat(frame: Image) -> Image:
    return np.ascontiguousarray(frame).reshape(-1)


@numba.njit(parallel=True, cache=True)
def _widen(frame, largest, smallest):  # type: ignore[no-untyped-def]
    """Widen the extrema to hold a frame, in one read; NaN stays NaN."""
    for i in numba.prange(frame.size):
        value = frame[i]
        largest[i] = np.maximum(largest[i], value)
        smallest[i] = np.minimum(smallest[i], value)


@numba.njit(parallel=True, cache=True)
def _project(frame, basis, moments):  # type: ignore[no-untyped-def]
    """Add a frame times (1, cos, sin) to the three moments."""
    for i in numba.prange(frame.size):
        value = frame[i]
        moments[0, i] += basis[0] * value
        moments[1, i] += basis[1] * value
        moments[2, i] += basis[2] * value
