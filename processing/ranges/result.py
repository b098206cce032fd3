"""The result of a decomposition by range, and how it is put together from fitted pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import hypot
from processing.numerics.jackknife import tiles
from processing.ranges.account_fit import AccountFit
from processing.ranges.accounts import Account
from processing.ranges.blur import Blur
from processing.ranges.mean_mixing import mean_mixing
from processing.ranges.scattering import RivalFits
from processing.remarks import Remark

Image = NDArray[np.float32]
Array = NDArray[np.float64]
Fits = list[tuple[AccountFit, AccountFit]]

NAMES = ("direct", "subsurface", "interreflection")
_SAMPLED_PIXELS = 1 << 15
_BLOCK_PIXELS = 1 << 15


@dataclass(frozen=True, slots=True)
class RangeDecomposition:
    """Components of light, their errors, and how they were found.

    Parameters
    ----------
    components
        float32, (n, height, width, colours), linear, in the unit of the frames, ≥ 0. They add
        up to `white`; 0 outside the mask.
    noise_errors
        float32, the same shape: standard error of each component from the noise of the frames.
        Where two places were fitted it is that of one.
    model_errors
        float32, the same shape: from what the model leaves out, see
        `processing.ranges.stated_errors`.
    names
        ``direct`` and ``interreflection``, with ``subsurface`` between them where there is any.
    pitch_px
        (m,), the last, white, infinite.
    mixing
        float64, (colours, m, n): mean response of each component against pitch, freed from
        blur; the last row, white, is 1.
    mixing_half_width
        float64, the same shape: half of the 95 % confidence interval of that mean over the scene,
        see `processing.numerics.jackknife`; 0 where it is 1 by definition, NaN where it cannot be
        had.
    white
        float32, (height, width, colours): the scene under full light.
    translucent
        bool, (height, width): where there is evidence of subsurface scattering.
    blur
        Of each colour.
    noise
        (colours,), standard deviation of a frame under half of the brightest white; NaN where
        it is unknown.
    warnings
        What a reader must know.
    """

    components: Image
    noise_errors: Image
    model_errors: Image
    names: tuple[str, ...]
    pitch_px: Array
    mixing: Array
    mixing_half_width: Array
    white: Image
    translucent: NDArray[np.bool_]
    blur: tuple[Blur, ...]
    noise: Array
    warnings: tuple[Remark, ...]

    @property
    def deviations(self) -> Image:
        """Standard errors in all, √(noise² + model²), float32, in the shape of `components`."""
        return hypot(self.noise_errors, self.model_errors)


@dataclass(frozen=True, slots=True)
class Capture:
    """What is known of the whole capture.

    Parameters
    ----------
    white
        float32, (height, width, colours).
    mask
        bool, (height, width).
    pitch_px
        (m,), without white.
    accounts
        Opaque and translucent.
    responses
        (m, spreads) for each colour: mean response.
    blur
        Of each colour.
    noise
        (colours,), see `RangeDecomposition`.
    """

    white: Image
    mask: NDArray[np.bool_]
    pitch_px: Array
    accounts: tuple[Account, Account]
    responses: tuple[Array, ...]
    blur: tuple[Blur, ...]
    noise: Array


def assemble(
    capture: Capture,
    fits: RivalFits,
    found: NDArray[np.bool_],
    sample: Fits,
    warnings: tuple[Remark, ...],
) -> RangeDecomposition:
    """Components, names and mean responses.

    Parameters
    ----------
    capture
        The capture.
    fits
        Of all pixels.
    found
        bool, (height, width): where the translucent account holds.
    sample
        Fits of the pixels of `lattice` that are usable, with all their ranges.
    warnings
        Of what went before.
    """
    mask = capture.mask
    lit = np.where(mask[..., np.newaxis], np.maximum(capture.white, 0), 0)
    light = fits.chosen(found, mask, lit, capture.blur)
    # A step makes views where a list of indices would copy.
    step = 1 if found.any() else 2
    spaced = lattice(mask.shape)
    usable = mask[spaced]
    mean = mean_mixing(
        capture.responses, capture.accounts, sample, found[spaced][usable], tiles(usable)
    )
    return RangeDecomposition(
        components=light.components[::step],
        noise_errors=light.noise_errors[::step],
        model_errors=light.model_errors[::step],
        names=NAMES[::step],
        pitch_px=np.append(capture.pitch_px, np.inf),
        mixing=mean.alpha[..., ::step],
        mixing_half_width=mean.half_width[..., ::step],
        white=capture.white,
        translucent=found,
        blur=capture.blur,
        noise=capture.noise,
        warnings=warnings,
    )


def lattice(shape: tuple[int, int]) -> tuple[slice, slice]:
    """Some 32 000 pixels evenly spread over the picture."""
    stride = int(np.ceil(np.sqrt(shape[0] * shape[1] / _SAMPLED_PIXELS)))
    return slice(None, None, stride), slice(None, None, stride)


def blocks_with(chosen: NDArray[np.bool_]) -> list[slice]:
    """Lines of a picture, some 32 000 pixels at a time, that hold chosen pixels."""
    height, width = chosen.shape
    lines = max(_BLOCK_PIXELS // width, 1)
    every = (slice(first, first + lines) for first in range(0, height, lines))
    return [block for block in every if chosen[block].any()]
