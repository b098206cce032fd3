"""Sign, scale, order and names of blind components, fixed from physics.

Independent vector analysis leaves each component an unknown factor in each colour and no order.
Under full light every kind of light counts in full: α = 1 in the white row. That fixes sign and
scale, and makes the components of a pixel add up to its white value (as far as the principal
components kept reproduce it). Direct light is direct at every pitch, its α is flat; light that
travels appears as direct once the pitch exceeds its range, so the other α rise, later for longer
ranges. Components are ordered by the mean of |α − 1| over pitches: direct, near, far.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.numerics.linear_algebra import inverse, product
from processing.remarks import Remark

# α of direct light at the finest pitch: below 1 by blur, but clearly above every other.
_DIRECT_AT_LEAST = 0.5
_DIRECT_LEAD = 0.25
# α of light lies in [0, 1]; this much beyond is laid to noise and to the model.
_TOLERANCE = 0.25
_LEAST_WHITE = 0.1

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Unmixing:
    """Blind components with sign, scale, order and names.

    Parameters
    ----------
    matrix
        float64, (colours, n, n): components of a colour from its principal images.
    mixing
        float64, (colours, m, n): α against pitch, the finest first; the last row, white, is 1.
    order
        int, (n,): which row of the given unmixing each component is.
    names
        ``direct``, ``subsurface``, ``interreflection``, or ``component-1`` and so on by place.
    warnings
        What is unphysical.
    """

    matrix: NDArray[np.float64]
    mixing: NDArray[np.float64]
    order: NDArray[np.int64]
    names: tuple[str, ...]
    warnings: tuple[Remark, ...]


def resolve(
    unmixing: NDArray[np.float64],
    vectors: NDArray[np.float64],
    pitch_px: NDArray[np.float64],
    principal_means: NDArray[np.float64],
) -> Unmixing:
    """Fix what independence cannot tell.

    Parameters
    ----------
    unmixing
        (colours, n, n), components of each colour from its principal images, any scale.
    vectors
        (m, n), the principal directions of D that were kept; the last row belongs to white.
    pitch_px
        (m − 1,), pitches of the other rows, increasing.
    principal_means
        (colours, n), means of the principal images over usable pixels.
    """
    alpha, scale, strongest = _scaled(unmixing, vectors)
    order = _order(alpha)
    matrix = (unmixing * scale[:, :, np.newaxis])[:, order]
    alpha = alpha[:, :, order]
    names = component_names(np.median(alpha, axis=0)[:-1], pitch_px)
    means = product(matrix, principal_means[..., np.newaxis])[..., 0]
    absent = (np.abs(scale) < _LEAST_WHITE * strongest)[:, order]
    warnings = (*_unphysical(np.median(alpha, axis=0)), *_warnings(names, means, absent))
    return Unmixing(matrix, alpha, order, names, warnings)


def scaled_mixing(unmixing: NDArray[np.float64], vectors: NDArray[np.float64]) -> Array:
    """α, (colours, m, n), of an unmixing, scaled and ordered as by `resolve`."""
    alpha = _scaled(unmixing, vectors)[0]
    return alpha[:, :, _order(alpha)]


def _order(alpha: Array) -> NDArray[np.int64]:
    """Components by the mean of |α − 1| over the pitches, (n,)."""
    return np.argsort(np.abs(np.mean(alpha[:, :-1], axis=0) - 1).mean(axis=0), kind="stable")


def _scaled(
    unmixing: NDArray[np.float64], vectors: NDArray[np.float64]
) -> tuple[Array, Array, Array]:
    """α, and what it was divided by and the strongest row of it, (colours, n) each."""
    mixing = product(vectors, inverse(unmixing))
    white = mixing[:, -1]
    strongest = np.abs(mixing).max(axis=1)
    # A component that is absent from white has no scale; it gets one that keeps it finite.
    least = 1e-6 * strongest
    scale = np.where(np.abs(white) < least, np.copysign(least, white), white)
    return mixing / scale[:, np.newaxis], scale, strongest


def component_names(alpha: NDArray[np.float64], pitch_px: NDArray[np.float64]) -> tuple[str, ...]:
    """Name components whose α says what they are.

    - ``direct``: the first, where its α at the finest pitch is at least 0.5 and exceeds that of
      every other by 0.25.
    - ``interreflection``: α stays below ½ up to the middle pitch, the geometric mean of the
      finest and the coarsest.
    - ``subsurface``: α is below ½ at the finest pitch and from the middle pitch on above it.
    - No name where two components claim it, and none at all where there is no direct light or
      where any α leaves [−0.25, 1.25]: the components share the white image, so what one of
      them takes wrongly the others lack.

    Parameters
    ----------
    alpha
        (m − 1, n), over the pitches, in the order of the components.
    pitch_px
        (m − 1,), increasing.
    """
    claims = [""] * alpha.shape[1]
    finest = alpha[0]
    found = finest[0] >= max(_DIRECT_AT_LEAST, finest[1:].max() + _DIRECT_LEAD)
    if found and _is_light(alpha):
        claims = ["direct", *(_travelled(alpha[:, k], pitch_px) for k in range(1, len(claims)))]
    return tuple(
        claim if claim and claims.count(claim) == 1 else f"component-{k + 1}"
        for k, claim in enumerate(claims)
    )


def _travelled(alpha: NDArray[np.float64], pitch_px: NDArray[np.float64]) -> str:
    middle_px = np.sqrt(pitch_px[0] * pitch_px[-1])
    if len(pitch_px) < 3:
        return ""
    if np.all(alpha[pitch_px <= middle_px] < 0.5):
        return "interreflection"
    if alpha[0] < 0.5 and np.all(alpha[pitch_px >= middle_px] > 0.5):
        return "subsurface"
    return ""


def _is_light(alpha: NDArray[np.float64]) -> bool:
    return bool(np.all(alpha >= -_TOLERANCE) and np.all(alpha <= 1 + _TOLERANCE))


def _unphysical(alpha: NDArray[np.float64]) -> tuple[Remark, ...]:
    if _is_light(alpha):
        return ()
    return (
        Remark(
            what=f"Blind separation failed here: α runs from {alpha.min():.2g} to "
            f"{alpha.max():.2g} where light stays between 0 and 1.",
            meaning="No component is named, and none should be read as light.",
            remedy="The direct and global images of the finest resolved pitch are the better "
            "answer, or `--method ranges` where the session allows it.",
        ),
    )


def _warnings(
    names: tuple[str, ...], means: NDArray[np.float64], absent: NDArray[np.bool_]
) -> tuple[Remark, ...]:
    remarks = []
    for k, name in enumerate(names):
        if absent[:, k].any():
            remarks.append(
                Remark(
                    what=f"The component {name} is nearly absent from the white image.",
                    meaning="Its scale is uncertain, and it is no kind of light by itself.",
                    remedy="Ask for fewer components (`--components`).",
                )
            )
        if (means[:, k] < 0).any():
            remarks.append(
                Remark(
                    what=f"The component {name} is negative on average in "
                    f"{np.count_nonzero(means[:, k] < 0)} of {means.shape[0]} colours.",
                    meaning="No light is negative: do not read it as light, nor what the others "
                    "hold too much in its place.",
                    remedy="Ask for fewer components (`--components`), or take `--method ranges`.",
                )
            )
    return tuple(remarks)
