"""Which of two accounts of the light the data bear out, pixel by pixel.

`processing.ranges.regions` says where it is the translucent one. There single pixels hardly tell
how the light divides: what left near where it entered looks like direct light, long paths below a
surface like light from near by. The division is that of a neighbourhood as far as it scatters from
pixel to pixel (`processing.ranges.shares`); elsewhere it is the pixel's own as far as the camera is
in focus.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.threads import in_threads
from processing.ranges.account_fit import AccountFit
from processing.ranges.blur import Blur
from processing.ranges.shares import smoothed, unsharpness
from processing.ranges.stated_errors import defocus_px2, model_errors, signs

Image = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class ChosenLight:
    """What the evidence chose, float32, (3, height, width, colours) each.

    Parameters
    ----------
    components
        Direct, subsurface, inter-reflection.
    noise_errors, model_errors
        Standard errors of each.
    """

    components: Image
    noise_errors: Image
    model_errors: Image


@dataclass(frozen=True, slots=True)
class ChosenColour:
    """One colour of what the evidence chose.

    Parameters
    ----------
    components, noise_errors
        float32, (3, height, width), as in `ChosenLight`.
    signs
        Of the model's error, see `processing.ranges.stated_errors.signs`: of each pixel's own
        light, before its shares are freed from scatter.
    """

    components: Image
    noise_errors: Image
    signs: tuple[Image, Image, Image, Image, Image]


class RivalFits:
    """Both accounts of every pixel, until the evidence chooses.

    Parameters
    ----------
    shape
        (height, width, colours).
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._direct = np.zeros((2, *shape), np.float32)
        self._scattered = np.zeros(shape, np.float32)
        # Account, noise or misfit, component; relative to white, for half precision holds few
        # decades.
        self._errors = np.zeros((2, 2, 3, *shape), np.float16)
        self.gain = np.zeros(shape[:2], np.float32)

    def add(
        self,
        lines: slice,
        chosen: NDArray[np.bool_],
        light: NDArray[np.floating],
        fits: Sequence[tuple[AccountFit, AccountFit]],
    ) -> None:
        """Take in the fits, opaque and translucent, of each colour.

        Parameters
        ----------
        lines
            Which lines of the picture.
        chosen
            bool, (lines, width): their pixels that were fitted, n of them.
        light
            (n, colours): white of these.
        fits
            One pair a colour.
        """
        for colour, pair in enumerate(fits):
            for account, fit in enumerate(pair):
                self._direct[account][lines, :, colour][chosen] = fit.direct_light
                for kind, errors in enumerate((fit.noise_errors, fit.misfits)):
                    for component, error in enumerate(errors.T):
                        held = self._errors[account, kind, component]
                        held[lines, :, colour][chosen] = _relative(error, light[:, colour])
            self._scattered[lines, :, colour][chosen] = pair[1].subsurface
            self.gain[lines][chosen] += (pair[0].chi2 - pair[1].chi2).astype(np.float32)

    def correct(
        self, pixels: NDArray[np.int64], light: Image, direct: Image, deviations: Image
    ) -> None:
        """Put in direct light that another account found; such pixels have no vote.

        Parameters
        ----------
        pixels
            (2, n): rows and columns.
        light, direct, deviations
            (n, colours): white, direct light and its standard error, which is that of the rest
            as well.
        """
        rows, columns = pixels
        relative = _relative(deviations, light)
        for account in range(2):
            self._direct[account, rows, columns] = direct
            misfits = self._errors[account, 1]
            misfits[0, rows, columns] = relative
            misfits[2, rows, columns] = np.maximum(misfits[2, rows, columns], relative)
        self.gain[rows, columns] = 0

    def chosen(
        self,
        found: NDArray[np.bool_],
        mask: NDArray[np.bool_],
        white: Image,
        blur: Sequence[Blur],
    ) -> ChosenLight:
        """Components and their errors.

        Parameters
        ----------
        found
            bool, (height, width): where the translucent account holds.
        mask
            bool, (height, width): what was fitted.
        white
            float32, (height, width, colours), what the components add up to, ≥ 0.
        blur
            Of each colour.
        """
        light = ChosenLight(*(np.zeros((3, *white.shape), np.float32) for _ in range(3)))

        def choose(colour: int) -> None:
            one = self.colour(found, mask, white, colour, unsharpness(blur[colour]))
            light.components[..., colour] = one.components
            light.noise_errors[..., colour] = one.noise_errors
            light.model_errors[..., colour] = model_errors(one.signs, defocus_px2(blur[colour]))

        in_threads(choose, range(white.shape[2]))
        return light

    def colour(
        self,
        found: NDArray[np.bool_],
        mask: NDArray[np.bool_],
        white: Image,
        colour: int,
        unsharp: float = 0.0,
    ) -> ChosenColour:
        """Components of one colour and what tells of their errors.

        Parameters as for `chosen`; `unsharp` is `processing.ranges.shares.unsharpness`.
        """
        lit = white[..., colour]
        accounts = self._direct[..., colour]
        direct = np.minimum(np.where(found, accounts[1], accounts[0]), lit)
        rival = np.minimum(np.where(found, accounts[0], accounts[1]), lit)
        scattered = np.minimum(self._scattered[..., colour], lit - direct)
        errors = self._errors[..., colour]
        noise, misfits = np.where(found, errors[1], errors[0]) * lit
        own = _parts(direct, scattered, lit, found)
        told = signs(misfits, own, rival, scattered, found, mask)
        # Coats and highlights have edges as far as the camera sees any; what scatters has none.
        shared = smoothed(direct, lit, found, edges=1 - unsharp)
        shared = smoothed(shared, lit, mask & ~found, edges=1 - unsharp, freed=unsharp)
        below = smoothed(scattered, lit - direct, found, of=lit - shared)
        return ChosenColour(_parts(shared, below, lit, found), noise, told)


def _parts(direct: Image, below: Image, lit: Image, found: NDArray[np.bool_]) -> Image:
    """All three; nothing is below the surface outside of what was found."""
    subsurface = np.where(found, below, np.float32(0))
    return np.stack([direct, subsurface, lit - direct - subsurface])


def _relative(error: NDArray[np.floating], light: NDArray[np.floating]) -> NDArray[np.floating]:
    """Errors as parts of white, at most all of it."""
    relative: NDArray[np.floating] = np.minimum(error / np.maximum(light, 1e-9), 1.0)
    return relative
