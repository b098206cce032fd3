"""Blur of projector, lens and pixel, read off the scene itself.

Blur of variance s² a side lowers the harmonic of pitch P along one diagonal by exp(−π² s²/P²),
wherever the light came from. Spreads of 8 pixels and more have died out at the finest pitches, so
that in opaque parts of a scene the ratio of the slopes at two of them tells s², pixel by pixel.
Where light scatters below the surface it reads too large; the most frequent value (the mean of
the shortest half of all) is taken, which is right as long as most of the scene is opaque. The
variances along both diagonals may differ, as those of the two green pixels of a mosaic do: these
lie half a pixel apart on a diagonal, which is no blur of the lens, and colours are measured apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.numerics.elementary import exp, hypot, log
from processing.numerics.linear_algebra import least_squares, product
from processing.remarks import Remark

# Contrast below this fraction of white is no basis for a ratio.
_LEAST_CONTRAST = 0.08
# Two pairs of pitches must agree on the variance within this.
_AGREEMENT_PX2 = 1.0
# However small a footprint, this share of the typical variance is left.
_LEAST_SHARE = 0.1
# A uniform pixel's variance a side.
PIXEL_PX2 = 1 / 12
# Modes of bins are good to this; the camera's part is within this of a pixel's where nothing else
# is known.
_MODE_ERROR_PX2 = 0.05
_CAMERA_ERROR_PX2 = 0.5
# A blur is right to this part of it, and a pixel's footprint, texture within it, to that.
_BLUR_ERROR, _FOOTPRINT_ERROR = 0.02, 0.06
_BINS = 12
_LEAST_BIN = 200
_REWEIGHTED = 10
_PARTS = 6


BLUR_UNSURE = Remark(
    what="The blur of projector and camera could not be told from scattering: pitches that should "
    "show the same blur disagree, or too few are resolved.",
    meaning="Direct light and subsurface scattering are estimates: blur that was not recognised "
    "is counted as light that travelled, and the other way round.",
    remedy="Measure the blur on a board (`lumisplit calibrate board`) and process with its "
    "profile.",
)


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Blur:
    """Blur of one colour, in projector pixels squared.

    Parameters
    ----------
    side_px2
        Variance along the rows and columns of the projector, ≥ 0.
    skew_px2
        Covariance between them: the variance of (y + x)/√2 is side + skew, of (y − x)/√2 side −
        skew.
    box_px
        Width of a camera pixel on the projector: as far as the variance allows, the blur is
        uniform over that width. 0 where it is unknown.
    camera_px2, footprint_px2
        The part of the variance that is the camera's, in camera pixels squared, and the size
        (mean of the diagonal of J Jᵀ, `processing.ranges.footprints`) at which `side_px2` holds.
        Where a footprint is larger, so is the blur.
    deviations_px2
        Standard errors, from noise, of `side_px2` and `skew_px2`.
    camera_deviation_px2
        That of `camera_px2`.
    """

    side_px2: float
    skew_px2: float = 0.0
    box_px: float = 0.0
    camera_px2: float = 0.0
    footprint_px2: float = 1.0
    deviations_px2: tuple[float, float] = (0.0, 0.0)
    camera_deviation_px2: float = 0.0

    @property
    def error_px2(self) -> float:
        """Standard error of the variance at a single pixel: its footprint is seen by the camera."""
        camera_px2 = self.camera_px2 * self.footprint_px2
        parts = np.array([_BLUR_ERROR * self.side_px2, _FOOTPRINT_ERROR * camera_px2])
        return float(np.sqrt(np.sum(parts**2)))

    def deviations(self, footprint: Array) -> Array:
        """Standard errors of `side_px2` and `skew_px2`, (n, 2), at (3, n) footprints."""
        side_px2, skew_px2 = self.deviations_px2
        beyond = 0.5 * (footprint[0] + footprint[1]) - self.footprint_px2
        side = hypot(side_px2, self.camera_deviation_px2 * beyond)
        skew = hypot(skew_px2, self.camera_deviation_px2 * footprint[2])
        return np.stack([side, skew], axis=1)

    def gains(self, tables_pitch_px: Array, varies: Array, footprint: Array) -> Array:
        """Factors of Z⁺ and Z⁻ where the footprint is not the typical one, (n, pitches, 2).

        Parameters
        ----------
        tables_pitch_px
            (pitches,).
        varies
            (pitches, 2): 1 where a pattern varies down or to the right, else 0.
        footprint
            (3, n), see `processing.ranges.footprints`.
        """
        rates2 = (np.pi / tables_pitch_px) ** 2
        down, right = varies.T
        least = _LEAST_SHARE * self.side_px2 - self.side_px2
        excess = np.maximum(self.camera_px2 * (footprint[:2] - self.footprint_px2), least)
        skew = self.skew_px2 + self.camera_px2 * footprint[2]
        along = 0.5 * (np.outer(rates2 * down, excess[0]) + np.outer(rates2 * right, excess[1]))
        across = np.outer(rates2 * down * right, skew)
        # Pixels lie side by side in memory, as compiled loops go over them.
        gains: Array = exp(-np.stack([along + across, along - across], axis=1))
        return np.moveaxis(gains, -1, 0)


def adjusted(
    blur: Blur, slopes: Array, pitch_px: Array, white: Array, footprint: Array
) -> tuple[Blur, bool]:
    """The blur that makes the slopes at the finest usable pitches agree, and whether it is sure.

    Parameters
    ----------
    blur
        What the slopes were corrected for.
    slopes
        (n, pitches, 2), of sample pixels along both diagonals.
    pitch_px
        (pitches,), not decreasing; families of one pitch are averaged.
    white
        (n,), of the same pixels.
    footprint
        (3, n), of the same pixels.

    Returns
    -------
    The blur, unchanged where no two pitches can be compared, and whether a third pitch confirms it.
    """
    pitch_px, member = np.unique(pitch_px, return_inverse=True)
    slopes = np.stack([slopes[:, member == k].mean(axis=1) for k in range(len(pitch_px))], axis=1)
    usable = np.flatnonzero(_contrast(blur, slopes, pitch_px, white) > _LEAST_CONTRAST)[:3]
    if len(usable) < 2:
        return blur, False
    rates = (np.pi / pitch_px[usable]) ** 2
    compared = np.maximum(slopes[:, usable], 1e-9)
    ratios = -np.diff(log(compared), axis=1) / np.diff(rates)[:, np.newaxis]
    modes = np.array([[shorth(ratios[:, k, d]) for d in range(2)] for k in range(len(rates) - 1)])
    confirmed = len(modes) > 1 and bool(np.all(np.abs(modes[1] - modes[0]) < _AGREEMENT_PX2))
    size = 0.5 * (footprint[0] + footprint[1])
    along = np.stack([size + footprint[2], size - footprint[2]], axis=1)
    beyond = along - blur.footprint_px2
    rise, leverage = _rise(beyond.ravel(), ratios[:, 0].ravel(), blur)
    typical = ratios[:, 0] - rise * beyond
    level = float(np.mean([shorth(typical[:, d]) for d in range(2)]))
    side_px2 = max(blur.side_px2 + level, 0.0)
    camera_px2 = min(max(blur.camera_px2 + rise, 0.0), side_px2 / blur.footprint_px2)
    skew_px2 = blur.skew_px2 + float(modes[0, 0] - modes[0, 1]) / 2
    skew_px2 = min(max(skew_px2, -side_px2), side_px2)
    deviations = _deviations(typical)
    found = replace(
        blur,
        side_px2=side_px2,
        skew_px2=skew_px2,
        camera_px2=camera_px2,
        deviations_px2=deviations,
        camera_deviation_px2=leverage * deviations[0],
    )
    return found, confirmed


def _contrast(blur: Blur, slopes: Array, pitch_px: Array, white: Array) -> Array:
    """Typical contrast that the camera saw, (pitches,).

    Slopes are freed from blur: where that has left nothing, they are noise raised without bounds.
    """
    left = exp(-blur.side_px2 * (np.pi / pitch_px) ** 2)
    typical: Array = left * np.median(slopes.mean(axis=2) / white[:, np.newaxis], axis=0)
    return typical


def _deviations(typical: Array) -> tuple[float, float]:
    """Standard errors of the most frequent variance and skew: the spread of parts of the pixels.

    The error of a shorth falls as the third root of their number at best (Rousseeuw and Leroy,
    Robust Regression and Outlier Detection, 1987, section 4.4), and here, where the middle of the
    values is flat, hardly at all: over repeats the whole varied by 1.0 to 1.2 times what six parts
    of it do.

    Parameters
    ----------
    typical
        (n, 2), variances along both diagonals.
    """
    parts = [typical[k::_PARTS] for k in range(min(_PARTS, len(typical)))]
    if len(parts) < 2:
        return 0.0, 0.0
    modes = np.array([[shorth(part[:, d]) for d in range(2)] for part in parts])
    both = np.stack([modes[:, 0] + modes[:, 1], modes[:, 0] - modes[:, 1]]) / 2
    side_px2, skew_px2 = np.std(both, axis=1, ddof=1)
    return float(side_px2), float(skew_px2)


def _rise(sizes: Array, variances: Array, blur: Blur) -> tuple[float, float]:
    """How the most frequent variance rises with the footprint, and its error by that of them all.

    A line through the modes of bins of equal count; where footprints are all alike, a camera that
    is no blurrier than its pixel is assumed.
    """
    order = np.array_split(
        np.argsort(sizes, kind="stable"), min(_BINS, max(len(sizes) // _LEAST_BIN, 1))
    )
    at = np.array([np.median(sizes[part]) for part in order])
    found = np.array([shorth(variances[part]) for part in order])
    expected = min(PIXEL_PX2, blur.side_px2 / blur.footprint_px2) - blur.camera_px2
    design = np.stack([np.ones_like(at), at], axis=1) / _MODE_ERROR_PX2
    rows = np.vstack([design, [0.0, 1 / _CAMERA_ERROR_PX2]])
    values = np.append(found / _MODE_ERROR_PX2, expected / _CAMERA_ERROR_PX2)
    # Bins in which much light scatters read too large: they count little.
    weights = np.ones(len(rows))
    for _ in range(_REWEIGHTED):
        solution = least_squares(rows * weights[:, None], values * weights)
        weights = 1 / np.sqrt(1 + np.abs(product(rows, solution) - values))
        weights[-1] = 1
    # A bin's error is larger than that of all values, by the third root of their numbers.
    scatter = float(np.std(at) * np.sqrt(len(at)))
    third_root = float(exp(log(len(at)) / 3))
    return float(solution[1]), third_root / scatter if scatter > 0 else 0.0


def shorth(values: NDArray[np.float64]) -> float:
    """Mean of the shortest interval that holds half of the values."""
    ordered = np.sort(values)
    half = max(len(ordered) // 2, 1)
    widths = ordered[half:] - ordered[: len(ordered) - half]
    start = int(np.argmin(widths)) if len(widths) else 0
    return float(ordered[start : start + half].mean())
