"""Which projector pixel lights what a camera pixel sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.errors import UnsupportedError

LEAST_DECODED = 0.2
MOST_DEVIATION_PX = 0.5


@dataclass(frozen=True, slots=True)
class Correspondence:
    """Projector places of the camera's pixels.

    Parameters
    ----------
    column, row
        float32 (height, width), projector pixels, 0 at the centre of the first; NaN where there
        is none.
    deviation_px
        float32 (height, width): standard error of a place from noise, the larger of the two.
    valid
        bool (height, width).
    decoded
        Part of the lit camera pixels that have a place.
    coverage
        Part of the projector's picture that the valid pixels see.
    camera_px_per_projector_px
        How many camera pixels see one projector pixel, median; below 1 the projector is finer.
    """

    column: NDArray[np.float32]
    row: NDArray[np.float32]
    deviation_px: NDArray[np.float32]
    valid: NDArray[np.bool_]
    decoded: float
    coverage: float
    camera_px_per_projector_px: float


def correspondence(
    places: tuple[NDArray[np.float64], NDArray[np.float64]],
    trusted: NDArray[np.bool_],
    deviation_px: NDArray[np.float64],
    lit: NDArray[np.bool_],
    resolution: tuple[int, int],
) -> Correspondence:
    """Join columns and rows, and measure how much of either device is covered.

    Parameters
    ----------
    places
        Columns and rows, (height, width) each.
    trusted
        Where both may be used.
    deviation_px
        Standard error of a place.
    lit
        Pixels that the projector lights and the sensor does not saturate at.
    resolution
        (height, width) of the projector.

    Raises
    ------
    UnsupportedError
        Fewer than a fifth of the lit pixels have a place.
    """
    shapes = {one.shape for one in (*places, trusted, deviation_px, lit)}
    if len(shapes) != 1:
        raise ValueError(f"places, masks and errors must have one shape, not {sorted(shapes)}")
    valid = trusted & (deviation_px < MOST_DEVIATION_PX)
    decoded = float((valid & lit).sum() / max(int(lit.sum()), 1))
    if decoded < LEAST_DECODED:
        noisy = float((deviation_px[lit] >= MOST_DEVIATION_PX).mean()) if lit.any() else 1.0
        why = (
            "the noise is too strong for them: expose longer"
            if noisy > 0.5
            else "the stripes blur into each other, or light from elsewhere in the scene outweighs "
            "them: focus camera and projector, settle longer, or use a matte board"
        )
        raise UnsupportedError(
            f"only {decoded:.0%} of the lit pixels can tell their projector pixel; {why}"
        )
    column, row = (np.where(valid, one, np.nan).astype(np.float32) for one in places)
    area = _jacobian(column, row)
    known = np.isfinite(area) & (area > 0)
    coverage = float(area[known].sum() / (resolution[0] * resolution[1]))
    density = float(1 / np.median(area[known])) if known.any() else float("nan")
    deviation = np.where(valid, deviation_px, np.nan).astype(np.float32)
    return Correspondence(column, row, deviation, valid, decoded, min(coverage, 1.0), density)


def _jacobian(column: NDArray[np.float32], row: NDArray[np.float32]) -> NDArray[np.float64]:
    """Projector pixels that one camera pixel covers, (height, width); NaN beside gaps."""
    down = [np.gradient(one.astype(np.float64), axis=0) for one in (column, row)]
    right = [np.gradient(one.astype(np.float64), axis=1) for one in (column, row)]
    area: NDArray[np.float64] = np.abs(right[0] * down[1] - right[1] * down[0])
    return area
