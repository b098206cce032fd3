"""How sure blind separation is of α: the unmixing found anew without each part of the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.auxiva import auxiva
from processing.jackknife import half_width
from processing.unmixing import scaled_mixing

Array = NDArray[np.float64]
_PARTS = 10
# More say no more about the spread between parts.
_MOST_SAMPLES = 1 << 18


def alpha_half_width(
    samples: NDArray[np.float32],
    white_filter: Array,
    vectors: Array,
    order: NDArray[np.int64],
    n_iterations: int,
) -> Array:
    """Half of the 95 % confidence interval of α, given the principal components.

    Parameters
    ----------
    samples
        float32, (colours, n, n_samples): whitened gradients, all to the right in raster order,
        then all down.
    white_filter
        (colours, n, n), what whitened them.
    vectors
        (m, n), the principal directions.
    order
        int, (n,), of the components, see `processing.unmixing.Unmixing`.
    n_iterations
        Of AuxIVA.

    Returns
    -------
    (colours, m, n); 0 for white, NaN where a part less leaves nothing to separate.
    """
    # Bands across the picture, the same for both directions.
    thin = samples[..., :: max(1, -(-samples.shape[2] // _MOST_SAMPLES))]
    n_samples = thin.shape[2]
    band = (2 * _PARTS * np.arange(n_samples) // max(n_samples, 1)) % _PARTS
    sizes = np.bincount(band, minlength=_PARTS).astype(np.float64)
    without = []
    for part in range(_PARTS):
        try:
            found = auxiva(np.ascontiguousarray(thin[..., band != part]), n_iterations)
            without.append(scaled_mixing(found.unmixing @ white_filter, vectors)[..., order])
        except (ValueError, np.linalg.LinAlgError):
            shape = (len(samples), len(vectors), len(order))
            return np.full(shape, np.nan)
    return half_width(np.stack(without), sizes)
