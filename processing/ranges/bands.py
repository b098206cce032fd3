"""What the usable pixels of a picture see, some lines after the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.frames.gathering import HarmonicsStack, pixels_of
from processing.ranges.blur import Blur
from processing.ranges.correspondence import Correspondence, decode
from processing.ranges.footprints import footprints
from processing.ranges.pixels import PlaceFit
from processing.ranges.place_lattice import PlaceLattice
from processing.ranges.response import ResponseTables

Image = NDArray[np.float32]
Array = NDArray[np.float64]
# Lines beside a block whose places its footprints need.
_HALO = 3


@dataclass(frozen=True, slots=True)
class SceneOptics:
    """What holds for the whole picture, for each colour."""

    blur: tuple[Blur, ...]
    tables: tuple[ResponseTables, ...]
    noise: Array
    noise_gains: Array
    white_gain: float
    fits: tuple[PlaceFit, ...]
    alike: PlaceLattice

    def variance(self, light: Array) -> Array:
        """Of a frame's noise at (n, colours) of white light; 0 where it is unknown."""
        constant, rise = np.nan_to_num(self.noise).T
        variance: Array = constant + rise * np.maximum(light, 0)
        return variance

    def white_variance(self, light: Array) -> Array:
        """Of white at (n, colours) of it: its own frames', and that of one black frame."""
        constant, _ = np.nan_to_num(self.noise).T
        variance: Array = self.white_gain * self.variance(light) + 4 * constant
        return variance

    def gains(self, shapes: Array) -> Array:
        """(n, pitches, 2, colours) for (3, n) footprints."""
        pairs = zip(self.blur, self.tables, strict=True)
        each = [one.gains(table.pitch_px, table.varies, shapes) for one, table in pairs]
        # As they lie in memory: pixel beside pixel.
        return np.moveaxis(np.stack([np.moveaxis(one, 0, -1) for one in each]), (3, 0), (0, 3))

    def blur_deviations(self, shapes: Array) -> tuple[Array, ...]:
        """(n, 2) of each colour for (3, n) footprints."""
        return tuple(one.deviations(shapes) for one in self.blur)


@dataclass(frozen=True, slots=True)
class Located:
    """n pixels of some lines and what they see; gains are (n, pitches, 2, colours)."""

    harmonics: NDArray[np.complex64]
    light: Array
    places: Correspondence
    gains: Array
    blur_deviations: tuple[Array, ...]


class Band:
    """Some lines and those beside them, which are decoded once, from the first to the last."""

    def __init__(
        self,
        stack: HarmonicsStack,
        white: Image,
        mask: NDArray[np.bool_],
        lines: slice,
        optics: SceneOptics,
    ) -> None:
        self._stack, self._white, self._optics = stack, white, optics
        self._first = self._decoded = max(lines.start - _HALO, 0)
        self._end = min(lines.stop + _HALO, len(mask))
        self._mask = mask[self._first : self._end]
        self._places = np.zeros((2, *self._mask.shape, white.shape[2]))
        self._coherence = np.zeros(self._mask.shape)

    def located(self, lines: slice) -> Located:
        """The usable pixels of some lines, which follow on those asked for before."""
        optics, end = self._optics, min(lines.stop + _HALO, self._end)
        # Lines without usable pixels may have been passed over.
        self._decoded = max(self._decoded, lines.start - _HALO)
        first = min(self._decoded, lines.start)
        harmonics = self._stack.harmonics(self._white, slice(first, end))
        self._decode(harmonics[:, :, self._decoded - first :], end)
        inside = slice(max(lines.start - _HALO, self._first), end)
        around = self._within(inside)
        wide = self._mask[around]
        shapes = footprints(self._places[:, around].mean(axis=-1), wide, alike=optics.alike)
        chosen, mine = self._mask[self._within(lines)], self._within(lines)
        shapes = shapes[:, lines.start - inside.start :][:, : len(chosen)][:, chosen]
        seen = harmonics[:, :, lines.start - first : lines.stop - first]
        return Located(
            pixels_of(seen, chosen),
            self._white[lines][chosen].astype(np.float64),
            Correspondence(self._places[:, mine][:, chosen], self._coherence[mine][chosen]),
            optics.gains(shapes),
            optics.blur_deviations(shapes),
        )

    def _within(self, lines: slice) -> slice:
        return slice(lines.start - self._first, lines.stop - self._first)

    def _decode(self, harmonics: NDArray[np.complex64], end: int) -> None:
        """Lines from where it was left to `end`."""
        lines = self._within(slice(self._decoded, end))
        usable = self._mask[lines]
        self._decoded = end
        if usable.any():
            seen, stack = pixels_of(harmonics, usable), self._stack
            found = decode(seen, stack.designs, self._optics.tables, stack.projector_px)
            self._places[:, lines][:, usable] = found.place_px
            self._coherence[lines][usable] = found.coherence
