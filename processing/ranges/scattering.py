"""Which of two accounts of the light the data bear out, pixel by pixel.

The difference of their χ², summed over the colours and averaged over a neighbourhood, is the
evidence. Only where it is strong is anything called subsurface scattering; elsewhere near-range
light is inter-reflection.

How the light that is not direct divides into the two in a translucent region, single pixels hardly
tell: long paths below a surface look like those of light from near by. Their division is that of
a neighbourhood as far as it scatters from pixel to pixel; how much of the light is direct, and how
much is not, stays the pixel's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.numerics.threads import in_threads
from processing.ranges.account_fit import AccountFit
from processing.ranges.blur import Blur, shorth
from processing.ranges.near_light import NearLight
from processing.ranges.stated_errors import defocus_px2, model_errors, signs

Image = NDArray[np.float32]

# χ² by which the translucent account must be better, on the mean of a neighbourhood; it has
# five more unknowns a colour.
EVIDENCE = 8.0
# What suffices beside pixels of strong evidence, where neighbourhoods reach over the border.
_WEAK_EVIDENCE = 3.0
_NEIGHBOURHOOD_PX = (5, 3)
# Light below this is none.
_DARK = 1e-9
# How many times the usual spread of sharpness is no chance.
_UNSHARP = 4.0
_MOST_PX2 = 1000.0
# Light of short range, relative to white, that is evidence where it comes from all sides alike;
# what comes from one side may be this part of it.
_LEAST_LOST, _MOST_LEAN = 0.06, 0.15


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
        Of the model's error, see `processing.ranges.stated_errors.signs`.
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
            one = self.colour(found, mask, white, colour)
            light.components[..., colour] = one.components
            light.noise_errors[..., colour] = one.noise_errors
            light.model_errors[..., colour] = model_errors(one.signs, defocus_px2(blur[colour]))

        in_threads(choose, range(white.shape[2]))
        return light

    def colour(
        self, found: NDArray[np.bool_], mask: NDArray[np.bool_], white: Image, colour: int
    ) -> ChosenColour:
        """Components of one colour and what tells of their errors; parameters as for `chosen`."""
        lit = white[..., colour]
        accounts = self._direct[..., colour]
        direct = np.minimum(np.where(found, accounts[1], accounts[0]), lit)
        rival = np.minimum(np.where(found, accounts[0], accounts[1]), lit)
        scattered = np.minimum(self._scattered[..., colour], lit - direct)
        subsurface = np.where(found, _shared(scattered, lit - direct, found), np.float32(0))
        parts = np.stack([direct, subsurface, lit - direct - subsurface])
        errors = self._errors[..., colour]
        noise, misfits = np.where(found, errors[1], errors[0]) * lit
        return ChosenColour(parts, noise, signs(misfits, parts, rival, scattered, found, mask))


def _shared(scattered: Image, rest: Image, found: NDArray[np.bool_]) -> Image:
    """Subsurface light, its share of what is not direct freed from scatter between neighbours.

    The mean share over 5 × 5 pixels of the region, and of what the pixel's own differs from it the
    part that is no scatter: 1 − (variance from its neighbours' mean)/(variance), both over 5 × 5
    (J.-S. Lee, Digital image enhancement and noise filtering by use of local statistics, IEEE
    Trans. Pattern Anal. Mach. Intell. 2, 1980, with the noise taken from the neighbours).
    """
    if not found.any():
        return scattered
    weight = np.where(found, rest, 0).astype(np.float64)
    below = np.where(found, scattered, 0).astype(np.float64)
    own = below / np.maximum(weight, _DARK)
    wide = np.maximum(_square_mean(weight, 5), _DARK)
    mean = _square_mean(below, 5) / wide
    variance = _square_mean(weight * (own - mean) ** 2, 5) / wide
    beside = 9 * _square_mean(weight, 3) - weight
    others = np.where(
        beside > _DARK, (9 * _square_mean(below, 3) - below) / np.maximum(beside, _DARK), own
    )
    # A mean of eight scatters, too.
    scatter = 8 / 9 * _square_mean(weight * (own - others) ** 2, 5) / wide
    kept = np.clip(1 - scatter / np.maximum(variance, 1e-12), 0, 1)
    share = np.clip(mean + kept * (own - mean), 0, 1)
    return np.where(found, share * rest, scattered).astype(np.float32)


def _square_mean(values: NDArray[np.float64], side: int) -> NDArray[np.float64]:
    mean: NDArray[np.float64] = ndimage.uniform_filter(values, side, mode="constant")
    return mean


def _relative(error: NDArray[np.floating], light: NDArray[np.floating]) -> NDArray[np.floating]:
    """Errors as parts of white, at most all of it."""
    relative: NDArray[np.floating] = np.minimum(error / np.maximum(light, 1e-9), 1.0)
    return relative


class Signs:
    """`NearLight` of every pixel, and what the capture's blur leaves of χ².

    Parameters
    ----------
    shape
        (height, width).
    told
        `processing.ranges.slopes.told_of_blur` of the capture.
    """

    def __init__(self, shape: tuple[int, int], told: float) -> None:
        self.told = told
        # Relative to white: half precision is more than they are good for.
        self.excess_px2 = np.full(shape, np.nan, np.float16)
        self.lost = np.full((2, *shape), np.nan, np.float16)
        self.lean = np.full((2, *shape), np.nan, np.float16)

    def add(self, lines: slice, chosen: NDArray[np.bool_], found: NearLight) -> None:
        """Take in the pixels of some lines, as for `RivalFits.add`."""
        self.excess_px2[lines][chosen] = np.clip(found.excess_px2, -_MOST_PX2, _MOST_PX2)
        self.lost[:, lines][:, chosen] = np.clip(found.lost, -1, 1)
        self.lean[:, lines][:, chosen] = np.clip(found.lean, -1, 1)

    def unsharp(self, counted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Where the mean over 5 × 5 pixels exceeds the most frequent one by more than chance.

        A lens, and footprints that are not exactly known, make some pixels sharper than the blur
        that all share, and as many less sharp. What scatters is only less sharp.
        """
        known = counted & np.isfinite(self.excess_px2)
        if not known.any():
            return np.ones(counted.shape, bool)
        mean = _local_mean(_held(self.excess_px2, known), known, _NEIGHBOURHOOD_PX[0])
        typical = shorth(mean[known])
        sharper = typical - mean[known & (mean < typical)]
        chance = float(np.sqrt(np.mean(sharper**2))) if sharper.size else 0.0
        found: NDArray[np.bool_] = mean > typical + _UNSHARP * chance
        return found | ~known

    def symmetric(self, counted: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
        """Where light of short range is missing at fine pitches that came from all sides alike.

        Once down to the finest pitch, once to twice that, where no error of the blur is as large.
        """
        known = counted & np.isfinite(self.lost[0])
        side = _NEIGHBOURHOOD_PX[0]
        leans = [_local_mean(_held(one, known), known, side) for one in self.lean]
        lean = np.sqrt(np.mean(np.square(leans), axis=0))
        losses = (_local_mean(_held(one, known), known, side) for one in self.lost)
        return [known & (lost > _LEAST_LOST) & (lean < _MOST_LEAN * lost) for lost in losses]


def _held(values: NDArray[np.float16], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.where(known, values, 0).astype(np.float64)


def translucent_map(
    gain: NDArray[np.float32],
    usable: NDArray[np.bool_],
    least_px: float,
    voting: NDArray[np.bool_] | None = None,
    near: Signs | None = None,
) -> NDArray[np.bool_]:
    """Where the evidence says translucent.

    Along a crease light comes back from a wall whose distance goes to 0: a mixture of ranges as
    peaked as that of diffusion. Creases are thin, so what is thinner than `least_px` is not
    believed, thin translucent things among it.

    Parameters
    ----------
    gain
        float32, (height, width): χ² of the opaque account less that of the translucent one,
        summed over the colours.
    usable
        bool, (height, width): pixels of which there is evidence.
    voting
        bool, (height, width): those whose evidence counts; pixels that see two places have none
        of their own and follow their neighbours. None: all.
    least_px
        Diameter, in camera pixels, of the discs that a translucent region is made of.
    near
        Where it is known: what is called translucent must be less sharp than the picture's pixels
        differ in sharpness by themselves, and missing light of short range that comes from all
        sides is evidence as well.

    Returns
    -------
    bool, (height, width): where the mean over 5 × 5 and over 3 × 3 usable pixels exceed
    `EVIDENCE`, opened by a disc, what borders on it with weaker evidence, and the holes in it:
    shaded parts of a translucent object, and its rim, say little.
    """
    counted = usable if voting is None else usable & voting
    votes = np.where(counted, gain, 0).astype(np.float64)
    wide, narrow = (_local_mean(votes, counted, side) for side in _NEIGHBOURHOOD_PX)
    told = 1.0 if near is None else near.told
    strong = (wide > EVIDENCE * told) & (narrow > EVIDENCE * told)
    weak = narrow > _WEAK_EVIDENCE * told
    if near is not None:
        unsharp = near.unsharp(counted)
        fine, coarse = near.symmetric(counted)
        symmetric = (fine & unsharp) | coarse
        strong = (strong & unsharp) | symmetric
        weak |= symmetric
    found = weak & _opened(strong | ~usable, least_px / 2)
    if found.any():
        found = ndimage.binary_fill_holes(_closed(found, least_px / 2))
    return usable & found


def _local_mean(
    values: NDArray[np.float64], usable: NDArray[np.bool_], side: int
) -> NDArray[np.float64]:
    """Mean over the usable pixels of a square."""
    count = ndimage.uniform_filter(usable.astype(np.float64), side, mode="nearest")
    mean: NDArray[np.float64] = ndimage.uniform_filter(values, side, mode="nearest")
    return mean / np.maximum(count, 1e-9)


def _closed(region: NDArray[np.bool_], radius_px: float) -> NDArray[np.bool_]:
    """With what lies between its parts, less than a disc apart."""
    margin = int(np.ceil(radius_px)) + 1
    padded = np.pad(region, margin)
    wide = ndimage.distance_transform_edt(~padded) <= radius_px
    closed: NDArray[np.bool_] = ndimage.distance_transform_edt(wide) > radius_px
    return (closed | padded)[margin:-margin, margin:-margin]


def _opened(region: NDArray[np.bool_], radius_px: float) -> NDArray[np.bool_]:
    """Union of the discs that fit into a region, half as wide again: their rim is weak.

    The picture's border does not cut discs.
    """
    margin = int(np.ceil(radius_px)) + 1
    padded = np.pad(region, margin, mode="edge")
    if padded.all():
        return region
    core = ndimage.distance_transform_edt(padded) > radius_px
    if not core.any():
        return np.zeros_like(region)
    opened: NDArray[np.bool_] = ndimage.distance_transform_edt(~core) <= 1.5 * radius_px
    return opened[margin:-margin, margin:-margin]
