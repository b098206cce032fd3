"""Light transport components of a scene from its direct images at several pitches.

The method of Subpa-asa, Zheng, Ono and Sato, with the white image as one more row (the pitch
beyond all ranges): uncentred PCA of D, independent vector analysis of the principal images'
gradients, and the unmixing applied at full resolution. Few numbers are to be found: of larger
pictures about half a million pixels tell them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.independence.components import Independence, independent
from processing.independence.pca import ROUNDING, PrincipalComponents, principal_components
from processing.numerics.rows import Rows, combine
from processing.numerics.strata import sample_stride
from processing.remarks import Remark


@dataclass(frozen=True, slots=True)
class Decomposition:
    """Components of light and how they were found.

    Parameters
    ----------
    components
        float32, (n, height, width, colours), linear, in the unit of the rows, signed. In every
        pixel they add up to its white value, as far as n principal components reproduce it.
        Pixels outside the mask are unmixed too, but their values mean nothing.
    names
        One for each component, see `processing.independence.unmixing`.
    pitch_px
        (m,), as given; the last, white, is infinite.
    mixing
        float64, (colours, m, n), α against pitch.
    mixing_half_width
        float64, the same shape: half of its 95 % confidence interval, see
        `processing.independence.confidence`.
    shares
        float64, (m,), of the principal components of D.
    significant
        How many principal components of D stand above its noise.
    cost
        float64, (n_iterations + 1,), of AuxIVA, per sample.
    smoothing_px
        Standard deviation of the Gaussian before gradients were taken.
    noise
        Standard deviation of the noise of the weakest principal image kept, a fraction of full
        scale (the 99.9th percentile of white).
    warnings
        What a reader must know.
    """

    components: NDArray[np.float32]
    names: tuple[str, ...]
    pitch_px: NDArray[np.float64]
    mixing: NDArray[np.float64]
    mixing_half_width: NDArray[np.float64]
    shares: NDArray[np.float64]
    significant: int
    cost: NDArray[np.float64]
    smoothing_px: float
    noise: float
    warnings: tuple[Remark, ...]


def decompose_iva(
    rows: Rows,
    pitch_px: Sequence[float] | NDArray[np.float64],
    mask: NDArray[np.bool_],
    *,
    n_components: int = 3,
    n_iterations: int = 10,
    smoothing_px: float | None = None,
    out: NDArray[np.float32] | None = None,
    progress: Callable[[float], object] = lambda _done: None,
) -> Decomposition:
    """Take D = A X apart by independent vector analysis.

    Parameters
    ----------
    rows
        m images, float32, (height, width, colours), or an array of them: direct light at each
        pitch, the white image last. They may be mapped from files: they are read in blocks,
        once, some lines twice, and never copied.
    pitch_px
        (m,), the pitch of each row, not decreasing, in projector pixels; the last, white, infinite.
    mask
        bool, (height, width), True where a pixel is usable; others estimate nothing.
    n_components
        2 to m.
    n_iterations
        Of AuxIVA, ≥ 0.
    smoothing_px
        Standard deviation of the Gaussian before gradients are taken; chosen from the measured
        noise where it is not given.
    out
        float32, (n, height, width, colours), where to write the components; may be mapped from
        a file.
    progress
        Told the part of the work that is done, rising to 1.
    """
    pitch_px = np.asarray(pitch_px, np.float64)
    _check(rows, pitch_px, n_components)
    images, principal = _principal_images(rows, mask, n_components, out)
    progress(0.4)
    found = independent(images, mask, principal, pitch_px[:-1], n_iterations, smoothing_px)
    progress(0.95)
    combine(found.unmixing.matrix, images, images)
    progress(1.0)
    return Decomposition(
        components=images,
        names=found.unmixing.names,
        pitch_px=pitch_px,
        mixing=found.unmixing.mixing,
        mixing_half_width=found.mixing_half_width,
        shares=principal.shares,
        significant=int(np.sum(principal.shares >= _least_share(principal, found.noise))),
        cost=found.cost,
        smoothing_px=found.smoothing_px,
        noise=found.noise / _full_scale(rows[-1], mask),
        warnings=_warnings(principal, found),
    )


_DROWNED = Remark(
    what="The noise drowns the gradients of the weakest component at every scale.",
    meaning="Independence says nothing about it: that component, and what the others lack, are "
    "accidents of the noise.",
    remedy="Ask for fewer components (`--components`), or expose longer and capture again.",
)


def _principal_images(
    rows: Rows, mask: NDArray[np.bool_], n_components: int, out: NDArray[np.float32] | None
) -> tuple[NDArray[np.float32], PrincipalComponents]:
    """The strongest principal images, (n, height, width, colours), and where they come from."""
    shape = (n_components, *rows[0].shape)
    images = np.empty(shape, np.float32) if out is None else out
    if images.shape != shape:
        raise ValueError(f"out has shape {images.shape}, the components {shape}")
    principal = principal_components(rows, mask, sample_stride(mask, axes=1))
    combine(principal.vectors[:, :n_components].T, rows, images)
    return images, principal


def _full_scale(white: NDArray[np.float32], mask: NDArray[np.bool_]) -> float:
    every = (slice(None, None, sample_stride(mask)),) * 2
    usable = white[every][mask[every]]
    return float(np.percentile(usable if usable.size else white[mask], 99.9))


def _warnings(principal: PrincipalComponents, found: Independence) -> tuple[Remark, ...]:
    drowned = (_DROWNED,) if found.drowned else ()
    n_components = len(found.unmixing.names)
    insignificant = _insignificant(principal, n_components, found.noise)
    return (*insignificant, *drowned, *found.unmixing.warnings)


def _check(rows: Rows, pitch_px: NDArray[np.float64], n_components: int) -> None:
    if pitch_px.shape != (len(rows),):
        raise ValueError(
            "one pitch is needed for each row, infinite for white; "
            f"there are {len(rows)} rows of shape {rows[0].shape}, pitch_px is {pitch_px.shape}"
        )
    if pitch_px[0] <= 0 or np.any(np.diff(pitch_px) < 0) or np.isfinite(pitch_px[-1]):
        raise ValueError(
            f"pitches must be positive, not decrease and end with infinity (white), not {pitch_px}"
        )
    if not 2 <= n_components <= len(rows):
        raise ValueError(
            f"{n_components} components cannot come from {len(rows)} rows of shape "
            f"{rows[0].shape}; ask for 2 to {len(rows)}"
        )


def _insignificant(
    principal: PrincipalComponents, n_components: int, noise: float
) -> tuple[Remark, ...]:
    """Warn of principal components that hold little more than noise alone would."""
    least_share = _least_share(principal, noise)
    return tuple(
        Remark(
            what=f"Principal component {k + 1} is not significant: its share is {share:.1e}, that "
            f"of noise alone {least_share / 2:.1e}.",
            meaning="One of the components is made of noise, and the others may have lost light "
            "to it.",
            remedy="Ask for fewer components (`--components`).",
        )
        for k, share in enumerate(principal.shares[:n_components])
        if share < least_share
    )


def _least_share(principal: PrincipalComponents, noise: float) -> float:
    """Share of a component that is significant: twice that of noise, or of rounding, alone."""
    of_noise = noise**2 / (principal.mean_square * len(principal.shares))
    return 2 * max(of_noise, ROUNDING)
