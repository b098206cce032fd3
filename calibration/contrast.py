"""Modulation against pitch on a flat matte board: what projector, lens and pixels leave of it.

A board has neither subsurface scattering nor inter-reflection, so that whatever contrast a
checker loses there is lost to the optics. With the square waves' fundamentals at half a cycle a
pitch P, a checker's harmonic along one diagonal falls to

    M(P) = exp(−π² s²/P²),

s² the variance a side of everything that blurs, in projector pixels squared (both axes give
exp(−π² s²/(2P²)) each; a box of width w counts with w²/12 in second order).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import UnsupportedError

Array = NDArray[np.float64]
Image = NDArray[np.float32]

USABLE = 0.3
_MOST_MODULATION = 1.03
_LEAST_COARSE = 0.7
_LEAST_FIT = 0.15
# A checker of two square waves of amplitude ½ has (4/π)²/4 of white in each diagonal harmonic.
_IDEAL = (4 / np.pi) ** 2 / 4


def parts_of(
    shape: tuple[int, ...], count: int
) -> list[tuple[tuple[int, int], tuple[slice, slice]]]:
    """So many parts of a picture down and right: the place of each among them, its pixels."""
    rows, columns = (np.linspace(0, size, count + 1).astype(int) for size in shape)
    return [
        ((i, j), (slice(rows[i], rows[i + 1]), slice(columns[j], columns[j + 1])))
        for i in range(count)
        for j in range(count)
    ]


class CheckerContrast:
    """Harmonics along both diagonals, and largest and smallest value, of one pitch's frames.

    Parameters
    ----------
    pitch_px
        Of the checker, in projector pixels.
    shape
        (height, width, colours) of the frames.
    """

    def __init__(self, pitch_px: int, shape: tuple[int, int, int]) -> None:
        self.pitch_px = pitch_px
        self._waves = np.zeros((2, *shape), np.complex64)
        self._largest = np.full(shape, -np.inf, np.float32)
        self._smallest = np.full(shape, np.inf, np.float32)
        self._n_frames = 0

    def add(self, frame: Image, shift_px: tuple[int, int]) -> None:
        """One frame, black taken off, and its shift (down, right)."""
        down, right = (np.pi * shift / self.pitch_px for shift in shift_px)
        self._waves[0] += frame * np.complex64(np.exp(1j * (down + right)))
        self._waves[1] += frame * np.complex64(np.exp(1j * (down - right)))
        np.maximum(self._largest, frame, out=self._largest)
        np.minimum(self._smallest, frame, out=self._smallest)
        self._n_frames += 1

    def modulation(self, white: Image, usable: NDArray[np.bool_]) -> Array:
        """(2, colours): fundamental along (y + x) and (y − x) over that of a perfect checker.

        The sums over the pixels are divided, so that dark pixels, whose ratios are noise, weigh
        little.
        """
        size = np.abs(self._waves[:, usable]).sum(axis=1, dtype=np.float64) / self._n_frames
        whole = white[usable].sum(axis=0, dtype=np.float64)
        # f = ½W(1 + s s'), whose harmonic over the shifts is ½W·(4/π)²/4 a diagonal.
        return _without_aliases(size / (0.5 * whole * _IDEAL))

    def extremes(self, white: Image, usable: NDArray[np.bool_]) -> Array:
        """(colours,): largest less smallest value over white, what max/min takes for direct."""
        gap = (self._largest - self._smallest)[usable].sum(axis=0, dtype=np.float64)
        return np.asarray(gap / white[usable].sum(axis=0, dtype=np.float64), np.float64)

    def blocks(self, white: Image, usable: NDArray[np.bool_], count: int) -> Array:
        """(count, count): modulation, mean of diagonals and colours, over parts of the picture."""
        mean = np.abs(self._waves).mean(axis=0) / self._n_frames / np.float32(0.5 * _IDEAL)
        found = np.full((count, count), np.nan)
        for place, part in parts_of(usable.shape, count):
            if usable[part].any():
                whole = white[part][usable[part]].sum(dtype=np.float64)
                found[place] = mean[part][usable[part]].sum(dtype=np.float64) / whole
        return found


@dataclass(frozen=True, slots=True)
class Contrast:
    """Contrast against pitch.

    Parameters
    ----------
    pitch_px
        (pitches,), rising.
    modulation
        (pitches, 2, colours): fundamental along both diagonals over a perfect checker's.
    extremes
        (pitches, colours): what max/min reads as direct fraction.
    side_px2, skew_px2
        (colours,): variance a side and covariance of the Gaussian that comes nearest, in
        projector pixels squared.
    side_deviation_px2
        (colours,): standard error, from the misfit.
    misfit
        (pitches, colours): mean modulation less that Gaussian's.
    finest_px
        Finest pitch at which every colour keeps 0.3 of its modulation, by that Gaussian.
    """

    pitch_px: Array
    modulation: Array
    extremes: Array
    side_px2: Array
    skew_px2: Array
    side_deviation_px2: Array
    misfit: Array
    finest_px: float


def fit_contrast(pitch_px: Array, modulation: Array, extremes: Array) -> Contrast:
    """Gaussian blur of each colour from its modulation, least squares in log modulation.

    Raises
    ------
    UnsupportedError
        More contrast than there can be, little even at the coarsest pitch, or no pitch resolved.
    """
    n_colours = modulation.shape[2]
    if modulation.shape != (len(pitch_px), 2, n_colours) or extremes.shape != (
        len(pitch_px),
        n_colours,
    ):
        raise ValueError(
            f"{len(pitch_px)} pitches, modulation {modulation.shape}, extremes {extremes.shape}"
        )
    _check(pitch_px, modulation)
    rate = (np.pi / pitch_px) ** 2
    sides, skews, errors = np.zeros((3, n_colours))
    for colour in range(n_colours):
        usable = modulation[:, :, colour].min(axis=1) > _LEAST_FIT
        if usable.sum() < 2:
            raise UnsupportedError(
                "fewer than two pitches are resolved: focus projector and camera, or add coarser "
                "pitches"
            )
        logs = -np.log(modulation[usable, :, colour])
        # Errors of the modulation are about equal, those of its logarithm grow as it falls.
        weight = modulation[usable, :, colour]
        both = np.array(
            [
                np.sum(weight[:, d] ** 2 * rate[usable] * logs[:, d])
                / np.sum((weight[:, d] * rate[usable]) ** 2)
                for d in range(2)
            ]
        )
        sides[colour], skews[colour] = both.mean(), (both[0] - both[1]) / 2
        rest = weight * (logs - rate[usable, np.newaxis] * both)
        degrees = max(rest.size - 2, 1)
        errors[colour] = np.sqrt(
            np.sum(rest**2) / degrees / np.sum((weight * rate[usable, np.newaxis]) ** 2)
        )
    sides = np.maximum(sides, 0)
    fitted = np.exp(-rate[:, np.newaxis] * sides)
    return Contrast(
        pitch_px=pitch_px,
        modulation=modulation,
        extremes=extremes,
        side_px2=sides,
        skew_px2=np.clip(skews, -sides, sides),
        side_deviation_px2=errors,
        misfit=modulation.mean(axis=1) - fitted,
        finest_px=float(np.pi * np.sqrt(sides.max() / -np.log(USABLE))),
    )


def _without_aliases(measured: Array) -> Array:
    """Modulation freed from the harmonics that eight shifts a period cannot tell apart.

    Harmonics m = 7, 9, 15, 17 … of either square wave fold onto the fundamental with a phase that
    differs from pixel to pixel. Of amplitude r_m = exp(−(m² − 1) π² s²/(2P²))/m beside it they
    raise the mean magnitude by Σ r_m²/4 an axis; s² is what the modulation itself says.
    """
    orders = np.array([m for k in range(1, 9) for m in (8 * k - 1, 8 * k + 1)], np.float64)
    freed = measured
    for _ in range(3):
        faded = -np.log(np.clip(freed, 1e-3, 1))[..., np.newaxis] / 2
        relative = np.exp(-(orders**2 - 1) * faded) / orders
        freed = measured / (1 + np.sum(relative**2, axis=-1) / 4) ** 2
    return freed


def _check(pitch_px: Array, modulation: Array) -> None:
    mean = modulation.mean(axis=1)
    if mean.max() > _MOST_MODULATION:
        raise UnsupportedError(
            f"the board shows {mean.max():.0%} of the contrast that there is: frames saturate, "
            "black was not subtracted, or lamp or exposure changed between white and the patterns"
        )
    coarsest = mean[int(np.argmax(pitch_px))].min()
    if coarsest < _LEAST_COARSE:
        raise UnsupportedError(
            f"even at a pitch of {pitch_px.max():g} px the board keeps only {coarsest:.0%} of the "
            "contrast: it scatters or is lit by its surroundings, the room is bright, or the "
            "focus is far off. Use a flat matte board that fills the picture, focus, and darken "
            "the room"
        )
