"""Which parts of a picture scatter light below their surface.

The evidence is the difference of χ² of both accounts, summed over the colours and averaged over a
neighbourhood, and light of short range that is missing at fine pitches and came from all sides
(`processing.ranges.near_light`). Only where it is strong is anything called subsurface scattering;
elsewhere near-range light is inter-reflection.

A camera out of focus mixes what neighbours see, and its footprints are known to some per cent: χ²
and sharpness then tell footprints more than light. Missing light of twice the finest pitch, which
no such error explains, decides alone there, and reaches as far as it goes on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.ranges.blur import shorth
from processing.ranges.near_light import NearLight

# χ² by which the translucent account must be better, on the mean of a neighbourhood; it has
# five more unknowns a colour.
EVIDENCE = 8.0
# What suffices beside pixels of strong evidence, where neighbourhoods reach over the border.
_WEAK_EVIDENCE = 3.0
_NEIGHBOURHOOD_PX = (5, 3)
# How many times the usual spread of sharpness is no chance.
_UNSHARP = 4.0
_MOST_PX2 = 1000.0
# Light of short range, relative to white, that is evidence where it comes from all sides alike;
# what comes from one side may be this part of it, and beside such light that.
_LEAST_LOST, _MOST_LEAN, _BESIDE_LEAN = 0.06, 0.15, 0.3
# Sharpness that varies by itself as much as this many times the least loss would change it tells
# nothing.
_BLUNT = 2.0

Array = NDArray[np.float64]


class Signs:
    """`NearLight` of every pixel, and what the capture's blur leaves of χ².

    Parameters
    ----------
    shape
        (height, width).
    told
        `processing.ranges.slopes.told_of_blur` of the capture.
    finest_px
        Its finest pitch.
    """

    def __init__(self, shape: tuple[int, int], told: float, finest_px: float) -> None:
        self.told = told
        self._blunt_px2 = _BLUNT * _LEAST_LOST * (finest_px / np.pi) ** 2
        # Relative to white: half precision is more than they are good for.
        self.excess_px2 = np.full(shape, np.nan, np.float16)
        self.lost = np.full((2, *shape), np.nan, np.float16)
        self.lean = np.full((2, *shape), np.nan, np.float16)

    def add(self, lines: slice, chosen: NDArray[np.bool_], found: NearLight) -> None:
        """Take in the pixels of some lines, as for `RivalFits.add`."""
        self.excess_px2[lines][chosen] = np.clip(found.excess_px2, -_MOST_PX2, _MOST_PX2)
        self.lost[:, lines][:, chosen] = np.clip(found.lost, -1, 1)
        self.lean[:, lines][:, chosen] = np.clip(found.lean, -1, 1)

    def unsharp(self, counted: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], bool]:
        """Where the mean over 5 × 5 pixels exceeds the most frequent one by more than chance.

        A lens, and footprints that are not exactly known, make some pixels sharper than the blur
        that all share, and as many less sharp. What scatters is only less sharp.

        Returns
        -------
        bool, (height, width), and whether chance is so large that sharpness tells nothing.
        """
        known = counted & np.isfinite(self.excess_px2)
        if not known.any():
            return np.ones(counted.shape, bool), False
        mean = _local_mean(_held(self.excess_px2, known), known, _NEIGHBOURHOOD_PX[0])
        typical = shorth(mean[known])
        sharper = typical - mean[known & (mean < typical)]
        chance = float(np.sqrt(np.mean(sharper**2))) if sharper.size else 0.0
        found: NDArray[np.bool_] = mean > typical + _UNSHARP * chance
        return found | ~known, _UNSHARP * chance > self._blunt_px2

    def lost_light(self, counted: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Array, Array]:
        """Light of short range that is missing at fine pitches, and what of it came from one side.

        Returns
        -------
        Where it is known; (2, height, width), what is missing down to the finest pitch and to twice
        that, where no error of the blur is as large; (height, width), what leans.
        """
        known = counted & np.isfinite(self.lost[0])
        side = _NEIGHBOURHOOD_PX[0]
        leans = [_local_mean(_held(one, known), known, side) for one in self.lean]
        losses = [_local_mean(_held(one, known), known, side) for one in self.lost]
        return known, np.stack(losses), np.sqrt(np.mean(np.square(leans), axis=0))


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
    beside = np.zeros_like(usable)
    if near is not None:
        unsharp, is_blunt = near.unsharp(counted)
        known, (fine, coarse), lean = near.lost_light(counted)
        where = usable if is_blunt else known
        symmetric = where & _from_all_sides(coarse, lean, _MOST_LEAN)
        symmetric |= where & unsharp & _from_all_sides(fine, lean, _MOST_LEAN)
        strong = (strong & unsharp) | symmetric
        weak |= symmetric
        if is_blunt:
            beside = known & _from_all_sides(coarse, lean, _BESIDE_LEAN)
    found = weak & _opened(strong | ~usable, least_px / 2)
    if beside.any():
        found |= _going_on(found, beside, ~usable, least_px / 2)
    if found.any():
        found = ndimage.binary_fill_holes(_closed(found, least_px / 2))
    return usable & found


def _from_all_sides(lost: Array, lean: Array, most_lean: float) -> NDArray[np.bool_]:
    """Where enough is missing and little enough of it came from one side."""
    enough: NDArray[np.bool_] = (lost > _LEAST_LOST) & (lean < most_lean * lost)
    return enough


def _going_on(
    region: NDArray[np.bool_],
    beside: NDArray[np.bool_],
    unknown: NDArray[np.bool_],
    radius_px: float,
) -> NDArray[np.bool_]:
    """What hangs together with a region, as wide as it must be."""
    wide = region | beside
    wide &= _opened(wide | unknown, radius_px) | region
    parts, _ = ndimage.label(wide)
    return np.isin(parts, np.unique(parts[region]))


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
