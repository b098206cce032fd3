"""Light that enters a translucent surface and leaves it at some distance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import fft


def diffusion_profile(distance_m: NDArray[np.float64], range_m: float) -> NDArray[np.float64]:
    """Normalised diffusion, R(r) = (e^(−r/d) + e^(−r/3d)) / (8π d r), in 1/m².

    Its integral over the plane is 1 and its mean distance 2.5 d (Christensen and Burley 2015,
    Approximate reflectance profiles for efficient subsurface scattering, Pixar TM 15-04).
    """
    return (np.exp(-distance_m / range_m) + np.exp(-distance_m / (3 * range_m))) / (
        8 * np.pi * range_m * distance_m
    )


@dataclass(frozen=True, slots=True)
class Scatterer:
    """Subsurface transfer on a rectangular grid of texels; light is lost beyond its edge.

    Parameters
    ----------
    spectra
        Transforms of albedo · profile · texel area, zero-padded so that nothing wraps around,
        one for each colour.
    shape, padded
        (rows, columns) of texels, and with the padding.
    """

    spectra: NDArray[np.complex128]
    shape: tuple[int, int]
    padded: tuple[int, int]

    @classmethod
    def of(
        cls,
        albedo: tuple[float, ...],
        range_m: tuple[float, ...],
        shape: tuple[int, int],
        texel_m: tuple[float, float],
    ) -> Self:
        """The transfer of every colour.

        Parameters
        ----------
        albedo
            Fraction of the entering light that leaves again on an unbounded slab.
        range_m
            d of `diffusion_profile` in metres.
        shape
            (rows, columns) of texels.
        texel_m
            (height, width) of a texel in metres.
        """
        rows, columns = shape
        padded = (
            fft.next_fast_len(2 * rows - 1, real=True),
            fft.next_fast_len(2 * columns - 1, real=True),
        )
        kernels = np.zeros((len(albedo), *padded))
        for kernel, strength, range_of_colour_m in zip(kernels, albedo, range_m, strict=True):
            means = (
                strength * texel_m[0] * texel_m[1] * _cell_means(range_of_colour_m, shape, texel_m)
            )
            for row_sign in (1, -1):
                for column_sign in (1, -1):
                    index = np.ix_(row_sign * np.arange(rows), column_sign * np.arange(columns))
                    kernel[index] = means
        return cls(fft.rfft2(kernels), shape, padded)

    def exitance(self, irradiance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Light that leaves each texel, (..., colours, rows, columns).

        Parameters
        ----------
        irradiance
            Light that falls on the texels, (..., colours or 1, rows, columns).
        """
        transformed = fft.rfft2(irradiance, s=self.padded) * self.spectra
        full: NDArray[np.float64] = fft.irfft2(transformed, s=self.padded)
        return full[..., : self.shape[0], : self.shape[1]]


def _cell_means(
    range_m: float, shape: tuple[int, int], texel_m: tuple[float, float]
) -> NDArray[np.float64]:
    """Mean of the profile over each texel of the quadrant, (rows, columns).

    The pole at r = 0 asks for many points where it is near; the texel that holds it is split
    into points around it, whose midpoint error of about 1/(4·points) is below 0.2 %.
    """
    means = np.empty(shape)
    for rows, columns, points in (
        (slice(0, shape[0]), slice(0, shape[1]), 4),
        (slice(0, 3), slice(0, 3), 128),
    ):
        offsets = (np.arange(points) + 0.5) / points - 0.5
        y_m = (np.arange(shape[0])[rows, np.newaxis] + offsets) * texel_m[0]
        x_m = (np.arange(shape[1])[columns, np.newaxis] + offsets) * texel_m[1]
        distance_m = np.hypot(y_m[:, :, np.newaxis, np.newaxis], x_m)
        means[rows, columns] = diffusion_profile(distance_m, range_m).mean(axis=(1, 3))
    return means
