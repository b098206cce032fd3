"""The code of a session of pairs, and its blur, measured on some parts of the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from processing.frames.gathering import HarmonicsStack
from processing.ranges.blur import BLUR_UNSURE, Blur, adjusted
from processing.ranges.footprints import footprints
from processing.ranges.optics import BOX_MARGIN
from processing.ranges.two_positions.binary_code import (
    LEAST_PITCHES,
    BinaryCode,
    binary_codes,
    relative_to,
)
from processing.ranges.two_positions.code_waves import CodeWaves, first_waves
from processing.remarks import Remark

Image = NDArray[np.float32]
Array = NDArray[np.float64]

_BLUR_ROUNDS = 4
# Pixels that tell which code it is.
_LOOKED_AT = 8000
# The code leaves less than this part of what another one would.
_CLEAR = 0.8
_SHARP_PX2 = 0.3
_BRIGHT_FRACTION = 0.05
# Squares of the picture that are looked at, their side, and lines between them.
_TILES, _TILE_PX, _GAP_PX = 24, 96, 4
# A contrast is told where the mean square of the wave around a pixel is at least this.
_LEAST_POWER, _NEIGHBOURHOOD_PX = 0.1, 7


@dataclass(frozen=True, slots=True)
class MeasuredCode:
    """Codes down and right, the pitches that they hold, and the blur of each colour.

    `half_on` as in `CodeWaves.of`.
    """

    codes: tuple[BinaryCode | None, BinaryCode | None]
    chosen: NDArray[np.int64]
    blur: tuple[Blur, ...]
    half_on: bool
    warnings: tuple[Remark, ...]


@dataclass(frozen=True, slots=True)
class _Tiles:
    """Parts of the picture, one below the other with unusable lines between them."""

    differences: Image
    white: Image
    mask: NDArray[np.bool_]


def measured_code(
    stack: HarmonicsStack,
    white: Image,
    mask: NDArray[np.bool_],
    noise: Array,
    blur: Sequence[Blur] | None,
) -> MeasuredCode:
    """Which pitches are resolved, and through what blur they are seen.

    Parameters
    ----------
    stack, white, mask
        The capture.
    noise
        (colours, 2), see `processing.frames.noise_lines`.
    blur
        Where it is known.
    """
    tiles = _tiles(stack, white, mask)
    found = [Blur(_SHARP_PX2) for _ in range(white.shape[2])] if blur is None else list(blur)
    unsure = False
    half_on, told = _stands_half_on(stack, tiles, found)
    codes, chosen = _codes(stack, tiles, found, half_on=half_on)
    if blur is None:
        for _ in range(_BLUR_ROUNDS):
            found, unsure = _sharpened(stack, tiles, noise, found, codes, chosen, half_on=half_on)
            codes, chosen = _codes(stack, tiles, found, half_on=half_on)
    warnings: tuple[Remark, ...] = (BLUR_UNSURE,) if unsure else ()
    lost = [design for k, design in enumerate(stack.designs) if k not in set(chosen.tolist())]
    if lost:
        warnings += (_unresolved([f"{one.family}:{one.pitch_px}" for one in lost]),)
    if half_on:
        warnings += (_GRAY,)
    if not told:
        warnings += (_UNCLEAR,)
    return MeasuredCode(codes, chosen, tuple(found), half_on, warnings)


def decoded_places(
    codes: tuple[BinaryCode | None, BinaryCode | None],
    chosen: NDArray[np.int64],
    differences: Image,
    white: Image,
    mask: NDArray[np.bool_],
    noise: Array,
) -> Image:
    """Places of each colour, float32, (2, lines, columns, colours); 0 along an axis without code.

    Parameters
    ----------
    codes, chosen
        Of `MeasuredCode`.
    differences
        float32, (chosen, lines, columns, colours).
    white
        float32, (lines, columns, colours).
    mask
        bool, (lines, columns).
    noise
        (colours, 2), see `processing.frames.noise_lines`.
    """
    constant, rise = np.nan_to_num(noise).T
    light = np.where(mask, white.sum(axis=-1), 0)
    lit = np.maximum(light, 1e-9)
    power = 2 * (constant.sum() + (np.maximum(white, 0) * rise).sum(axis=-1))
    variance = (power / lit**2).astype(np.float32)
    together = relative_to(light, differences.sum(axis=-1))
    colours = white.shape[-1]
    places = np.zeros((2, *white.shape), np.float32)
    for axis, code in enumerate(codes):
        if code is None:
            continue
        members = np.searchsorted(chosen, code.chosen)
        found = code.decoded(together[members], mask, variance)
        for colour in range(colours):
            places[axis, ..., colour] = found.places_px
            if colours > 1:
                one = np.where(mask, white[..., colour], 0)
                own = relative_to(one, differences[members, ..., colour])
                noisy = 2 * (constant[colour] + rise[colour] * np.maximum(one, 0))
                spread = (noisy / np.maximum(one, 1e-9) ** 2).astype(np.float32)
                places[axis, ..., colour] += code.beside(own, found, mask, spread)
    return places


def _tiles(stack: HarmonicsStack, white: Image, mask: NDArray[np.bool_]) -> _Tiles:
    """The parts with most light that can be used, evenly chosen among them."""
    height, width = mask.shape
    if mask.size <= _TILES * _TILE_PX**2:
        return _Tiles(stack.differences(slice(0, height)), white, mask)
    corners = [(y, x) for y in range(0, height, _TILE_PX) for x in range(0, width, _TILE_PX)]
    filled = np.array([mask[y : y + _TILE_PX, x : x + _TILE_PX].sum() for y, x in corners])
    good = np.flatnonzero(filled >= 0.5 * filled.max())
    picked = good[np.linspace(0, len(good) - 1, min(_TILES, len(good))).astype(int)]
    side = _TILE_PX + _GAP_PX
    colours = white.shape[2]
    lines = side * len(picked)
    differences = np.zeros((len(stack.designs), lines, _TILE_PX, colours), np.float32)
    light = np.zeros((lines, _TILE_PX, colours), np.float32)
    usable = np.zeros((lines, _TILE_PX), bool)
    for k, (y, x) in enumerate(corners[one] for one in picked):
        part = (slice(y, min(y + _TILE_PX, height)), slice(x, min(x + _TILE_PX, width)))
        rows = slice(k * side, k * side + part[0].stop - y)
        columns = slice(0, part[1].stop - x)
        differences[:, rows, columns] = stack.differences(part[0])[:, :, part[1]]
        light[rows, columns], usable[rows, columns] = white[part], mask[part]
    return _Tiles(differences, light, usable)


def _stands_half_on(
    stack: HarmonicsStack, tiles: _Tiles, blur: Sequence[Blur]
) -> tuple[bool, bool]:
    """Whether the patterns stand half a pitch from where they are said to, and if that is clear.

    Where they are the bits of a Gray code, that leaves less of the differences unexplained than
    patterns that stand as they are said to.
    """
    relative = _together(tiles)
    relative = relative[:, :: max(relative.shape[1] // _LOOKED_AT, 1)]
    misfits = []
    for half_on in (False, True):
        codes, _ = _codes(stack, tiles, blur, half_on=half_on)
        each = [one.misfit(relative[one.chosen]) for one in codes if one is not None]
        misfits.append(float(np.mean(each)))
    return misfits[1] < misfits[0], min(misfits) < _CLEAR * max(misfits)


def _together(tiles: _Tiles) -> Image:
    """Differences over white, all colours together, (pitches, n)."""
    light = np.where(tiles.mask, tiles.white.sum(axis=-1), 0)
    return relative_to(light, tiles.differences.sum(axis=-1))[:, tiles.mask]


def _codes(
    stack: HarmonicsStack, tiles: _Tiles, blur: Sequence[Blur], *, half_on: bool
) -> tuple[tuple[BinaryCode | None, BinaryCode | None], NDArray[np.int64]]:
    middle = blur[len(blur) // 2]
    waves = CodeWaves.of(
        stack.designs, np.zeros(1), middle.side_px2, middle.box_px, half_on=half_on
    )
    codes = binary_codes(waves, _together(tiles), stack.projector_px)
    members = [code.chosen for code in codes if code is not None]
    if not members:
        raise ValueError(
            "two positions a pitch are a code of which fewer than "
            f"{LEAST_PITCHES} pitches are resolved in any direction"
        )
    return codes, np.sort(np.concatenate(members))


def _sharpened(
    stack: HarmonicsStack,
    tiles: _Tiles,
    noise: Array,
    blur: Sequence[Blur],
    codes: tuple[BinaryCode | None, BinaryCode | None],
    chosen: NDArray[np.int64],
    *,
    half_on: bool,
) -> tuple[list[Blur], bool]:
    """The blur at which contrast depends on pitch as little as it does in most pixels."""
    designs = [stack.designs[k] for k in chosen]
    differences = tiles.differences[chosen]
    places = decoded_places(codes, chosen, differences, tiles.white, tiles.mask, noise)
    shapes = footprints(places.mean(axis=-1), tiles.mask)
    typical_px2 = float(np.median(shapes[:2][:, tiles.mask].sum(axis=0))) / max(
        sum(code is not None for code in codes), 1
    )
    bright = tiles.white > _BRIGHT_FRACTION * np.percentile(tiles.white[tiles.mask], 99.5)
    found, unsure = [], False
    for colour, one in enumerate(blur):
        located = replace(
            one, footprint_px2=typical_px2, box_px=BOX_MARGIN * float(np.sqrt(typical_px2))
        )
        waves = CodeWaves.of(
            designs, np.zeros(1), located.side_px2, located.box_px, half_on=half_on
        )
        light = np.where(tiles.mask, tiles.white[..., colour], 0)
        relative = relative_to(light, differences[..., colour])
        slopes, told = _slopes(waves, relative, places[..., colour], tiles.mask)
        lit = tiles.mask & bright[..., colour] & told
        if not lit.any():
            found.append(located)
            unsure = True
            continue
        varies = np.stack([waves.axis == 0, waves.axis == 1], axis=1).astype(np.float64)
        gains = located.gains(waves.pitch_px, varies, shapes[:, lit])
        measured = slopes[:, lit].T[..., np.newaxis] / gains * light[lit][:, None, None]
        sharper, confirmed = adjusted(
            located, measured, waves.pitch_px, light[lit].astype(np.float64), shapes[:, lit]
        )
        found.append(replace(sharper, skew_px2=0.0))
        unsure |= not confirmed
    return found, unsure


def _slopes(
    waves: CodeWaves, relative: Image, places: Image, mask: NDArray[np.bool_]
) -> tuple[Array, NDArray[np.bool_]]:
    """Contrast of each pitch around each pixel, (pitches, lines, columns), and where it is told."""
    slopes = np.zeros(relative.shape)
    told = np.ones(mask.shape, bool)
    for k in range(len(waves.pitch_px)):
        one = waves.only(np.array([k]))
        wave = first_waves(one, places[waves.axis[k]].astype(np.float64).reshape(-1))[0]
        wave = np.where(mask, wave.reshape(mask.shape), 0)
        along = ndimage.uniform_filter(wave * relative[k], _NEIGHBOURHOOD_PX)
        power = ndimage.uniform_filter(wave * wave, _NEIGHBOURHOOD_PX)
        fine = waves.pitch_px[k] <= 4 * waves.pitch_px.min()
        if fine:
            told &= power > _LEAST_POWER * np.median(power[mask])
        slopes[k] = along / np.maximum(power, 1e-9)
    return slopes, told


_GRAY = Remark(
    what="The stripes stand half of their pitch from where the session says, all of them: the bits "
    "of a Gray code, not of the binary number.",
    meaning="They were decoded as a Gray code. Single pitches do not depend on it.",
    remedy="Correct the shifts by half a pitch before they are used for anything else.",
)


_UNCLEAR = Remark(
    what="Stripes that stand where the session says explain the frames hardly better or worse than "
    "a Gray code would.",
    meaning="The frames may show other patterns than is said; then places are wrong, and with them "
    "all components.",
    remedy="Compare the shifts that the session has with what was shown; light, focus and contrast "
    "decide how clear it is.",
)


def _unresolved(names: list[str]) -> Remark:
    return Remark(
        what=f"{', '.join(names)}: less than a tenth of the contrast is left, so these pitches are "
        "left out.",
        meaning="Light is told apart by the others; ranges below what these resolve count as "
        "direct.",
        remedy="A sharper focus, or a camera nearer to the scene, resolves finer pitches.",
    )
