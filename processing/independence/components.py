"""Independent components of principal images: the unmixing, and how sure it is.

The gradients of a picture's components are nearly independent. They are taken of images smoothed as
the noise demands, whitened in each colour, and unmixed by AuxIVA; sign, scale and order follow from
the white row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.auxiva import auxiva
from processing.frames.noise import noise_deviation
from processing.independence.confidence import alpha_half_width
from processing.independence.gradients import gradient_samples
from processing.independence.pca import PrincipalComponents
from processing.independence.smoothing import choose_smoothing
from processing.independence.unmixing import Unmixing, resolve
from processing.independence.whitening import whitening
from processing.numerics.linear_algebra import product
from processing.numerics.rows import means
from processing.numerics.strata import sample_stride
from processing.numerics.threads import in_threads

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Independence:
    """What independence says of principal images.

    Parameters
    ----------
    unmixing
        Their components.
    mixing_half_width
        float64, (colours, m, n), see `processing.independence.confidence`.
    cost
        float64, (n_iterations + 1,), of AuxIVA, per sample.
    smoothing_px
        Standard deviation of the Gaussian before gradients were taken.
    noise
        Standard deviation of the noise of the weakest image.
    drowned
        Whether noise rules its gradients at every scale.
    """

    unmixing: Unmixing
    mixing_half_width: Array
    cost: Array
    smoothing_px: float
    noise: float
    drowned: bool


def independent(
    images: NDArray[np.float32],
    mask: NDArray[np.bool_],
    principal: PrincipalComponents,
    pitch_px: Array,
    n_iterations: int,
    smoothing_px: float | None,
) -> Independence:
    """Find the independent components of principal images.

    Parameters
    ----------
    images
        float32, (n, height, width, colours), the strongest first.
    mask
        bool, (height, width), True where a pixel is usable.
    principal
        Their directions among the rows of D, of which the last belongs to white.
    pitch_px
        (m − 1,), pitches of the other rows.
    n_iterations
        Of AuxIVA, ≥ 0.
    smoothing_px
        Of the Gaussian before gradients are taken; None to choose it from the noise.
    """
    light, vectors = means(images, mask), principal.vectors[:, : len(images)]
    if not np.all(np.isfinite(light)):
        raise ValueError("usable pixels hold values that are not finite; mask them")
    noise, enough = noise_deviation(images[-1], mask), True
    if smoothing_px is None:
        smoothing_px, enough = choose_smoothing(images[-1], mask, noise)
    samples = gradient_samples(images, mask, smoothing_px, sample_stride(mask))
    # What is rounding alone stays what it is.
    held = min(principal.rank, len(images))
    white_filter = np.tile(np.eye(len(images)), (len(samples), 1, 1))
    white_filter[:, :held, :held] = _whiten(samples[:, :held])
    found = auxiva(samples[:, :held], n_iterations)
    matrix = white_filter.copy()
    matrix[:, :held, :held] = product(found.unmixing, white_filter[:, :held, :held])
    unmixing = resolve(matrix, vectors, pitch_px, light)
    half_width = alpha_half_width(samples, white_filter, vectors, n_iterations)
    return Independence(unmixing, half_width, found.cost, smoothing_px, noise, not enough)


def _whiten(samples: NDArray[np.float32]) -> Array:
    """Whiten each colour's samples in place; return the filters, (colours, n, n)."""
    filters = whitening(samples)

    def whiten(color: int) -> None:
        samples[color] = product(filters[color].astype(np.float32), samples[color])

    in_threads(whiten, range(len(samples)))
    return filters
