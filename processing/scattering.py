"""Which of two accounts of the light the data bear out, pixel by pixel.

The difference of their χ², summed over the colours and averaged over a neighbourhood, is the
evidence. Only where it is strong is anything called subsurface scattering; elsewhere near-range
light is inter-reflection.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.range_fit import AccountFit

Image = NDArray[np.float32]

# χ² by which the translucent account must be better, on the mean of a neighbourhood; it has
# five more unknowns a colour.
EVIDENCE = 20.0
_NEIGHBOURHOOD_PX = (5, 3)


class RivalFits:
    """Both accounts of every pixel, until the evidence chooses.

    Parameters
    ----------
    shape
        (height, width, colours).
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        # Account, quantity: direct, subsurface, and the standard errors of all three.
        self._parts = np.zeros((2, 5, *shape), np.float32)
        self.gain = np.zeros(shape[:2], np.float32)

    def add(
        self,
        lines: slice,
        chosen: NDArray[np.bool_],
        fits: Sequence[tuple[AccountFit, AccountFit]],
    ) -> None:
        """Take in the fits, opaque and translucent, of each colour.

        Parameters
        ----------
        lines
            Which lines of the picture.
        chosen
            bool, (lines, width): their pixels that were fitted, n of them.
        fits
            One pair a colour.
        """
        for colour, pair in enumerate(fits):
            for account, fit in enumerate(pair):
                values = np.column_stack([fit.direct_light, fit.subsurface, fit.deviations])
                self._parts[account][:, lines, :, colour][:, chosen] = values.T
            self.gain[lines][chosen] += (pair[0].chi2 - pair[1].chi2).astype(np.float32)

    def components(self, found: NDArray[np.bool_], white: Image) -> tuple[Image, Image]:
        """Direct, subsurface, inter-reflection and their standard errors, (3, h, w, c) each.

        Parameters
        ----------
        found
            bool, (height, width): where the translucent account holds.
        white
            float32, (height, width, colours), what the components add up to, ≥ 0.
        """
        parts = np.where(found[..., np.newaxis], self._parts[1], self._parts[0])
        direct = np.minimum(parts[0], white)
        subsurface = np.minimum(parts[1], white - direct)
        return np.stack([direct, subsurface, white - direct - subsurface]), parts[2:]


def translucent_map(gain: NDArray[np.float32], usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where the evidence says translucent.

    Parameters
    ----------
    gain
        float32, (height, width): χ² of the opaque account less that of the translucent one,
        summed over the colours.
    usable
        bool, (height, width): pixels that may vote.

    Returns
    -------
    bool, (height, width): the mean over 5 × 5 and over 3 × 3 usable pixels exceed `EVIDENCE`.
    """
    votes = np.where(usable, gain, 0).astype(np.float64)
    found = usable.copy()
    for side in _NEIGHBOURHOOD_PX:
        count = ndimage.uniform_filter(usable.astype(np.float64), side, mode="constant")
        mean = ndimage.uniform_filter(votes, side, mode="constant") / np.maximum(count, 1e-9)
        found &= mean > EVIDENCE
    return found
