"""Two accounts of a pixel's light: which ranges it can have travelled.

Opaque: what is not direct came from other surfaces. Its spreads are Gaussian, from a few pixels
(beside a crease) to infinity. Translucent: light scattered below the surface, too. Its profile is
peaked and long-tailed as diffusion makes it (`processing.ranges.spectrum.diffusion_mixture`), which
no sum of Gaussian spreads of 8 pixels and more can imitate, nor the other way round.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.ranges.spectrum import diffusion_mixture

# Half-octaves from a quarter of the finest pitch: mixtures of neighbours imitate every spread
# between them within 0.5 %.
_HALF_OCTAVES = 17
_TRANSLUCENT_FAR = 4.0


@dataclass(frozen=True, slots=True)
class Account:
    """A dictionary of ranges.

    Parameters
    ----------
    mixtures
        float64, (spreads, n): each range as a mixture of `spread_grid`; the first is direct
        light. Light of infinite range, to which no pattern responds, stands beside them.
    subsurface
        (first, end) of the ranges that are subsurface scattering.
    """

    mixtures: NDArray[np.float64]
    subsurface: tuple[int, int]

    def roles(self, members: NDArray[np.int64]) -> NDArray[np.int64]:
        """0 of direct light, 1 of subsurface scattering, 2 of the rest.

        Parameters
        ----------
        members
            (n,): where each range of the account stands, direct light first and infinity last.
        """
        roles = np.full(len(members), 2)
        first, end = self.subsurface
        roles[members[0]], roles[members[first:end]] = 0, 1
        return roles


def spread_grid(pitch_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviations in projector pixels, 0 first, that suit a set of pitches."""
    return np.concatenate([[0.0], pitch_px.min() / 8 * _half_octaves(0, _HALF_OCTAVES)])


def opaque(pitch_px: NDArray[np.float64]) -> Account:
    """Direct light and inter-reflection.

    Spreads of 1, 2, 4 … times the finest pitch; those wider than three quarters of the coarsest
    look like infinite ones.
    """
    grid = spread_grid(pitch_px)
    ranges = _octaves(1.0, pitch_px)
    return Account(np.stack([_single(grid, one) for one in (0.0, *ranges)], axis=1), (1, 1))


def translucent(pitch_px: NDArray[np.float64]) -> Account:
    """Direct light, diffusion over ¼ to 4 times the finest pitch, inter-reflection from afar."""
    grid = spread_grid(pitch_px)
    diffuse = [diffusion_mixture(grid, one) for one in pitch_px.min() * _half_octaves(-4, 5)]
    far = [_single(grid, one) for one in _octaves(_TRANSLUCENT_FAR, pitch_px)]
    mixtures = np.stack([_single(grid, 0.0), *diffuse, *far], axis=1)
    return Account(mixtures, (1, 1 + len(diffuse)))


def _half_octaves(first: int, end: int) -> NDArray[np.float64]:
    """2 to the power k/2 for k from `first` to before `end`, without a power's last bits."""
    octaves, odd = np.divmod(np.arange(first, end), 2)
    return np.ldexp(np.where(odd == 1, np.sqrt(2.0), 1.0), octaves)


def _octaves(first: float, pitch_px: NDArray[np.float64]) -> list[float]:
    """Ranges from a multiple of the finest pitch, each twice the last, that the grid holds."""
    finest, coarsest = float(pitch_px.min()), float(pitch_px.max())
    ranges = [finest * first * 2.0**k for k in range(5)]
    return [one for one in ranges if one <= min(0.75 * coarsest, 16 * finest)]


def _single(grid: NDArray[np.float64], spread_px: float) -> NDArray[np.float64]:
    nearest = np.argmin(np.abs(grid - spread_px))
    mixture: NDArray[np.float64] = (np.arange(len(grid)) == nearest).astype(np.float64)
    return mixture
