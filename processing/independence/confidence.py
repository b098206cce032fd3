"""How sure blind separation is of α: the unmixing found anew without each part of the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.auxiva import auxiva
from processing.independence.unmixing import scaled_mixing
from processing.numerics.jackknife import half_width
from processing.numerics.linear_algebra import product
from processing.numerics.threads import in_threads

Array = NDArray[np.float64]
_PARTS = 10
# More say no more about the spread between parts.
_MOST_SAMPLES = 1 << 17


def alpha_half_width(
    samples: NDArray[np.float32],
    white_filter: Array,
    vectors: Array,
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
    n_iterations
        Of AuxIVA.

    Returns
    -------
    (colours, m, n); 0 for white, NaN where a part less leaves nothing to separate.
    """
    thin = samples[..., :: max(1, -(-samples.shape[2] // _MOST_SAMPLES))]
    # Bands across the picture, the same for both directions.
    edges = -(-thin.shape[2] * np.arange(2 * _PARTS + 1) // (2 * _PARTS))
    lengths = np.diff(edges).astype(np.float64)
    sizes = lengths[:_PARTS] + lengths[_PARTS:]

    def without(part: int) -> Array:
        ends = edges[[0, part, part + 1, part + _PARTS, part + _PARTS + 1, -1]]
        kept = [thin[..., ends[k] : ends[k + 1]] for k in (0, 2, 4)]
        rest = np.concatenate(kept, axis=-1)
        found = auxiva(rest, n_iterations, n_threads=1)
        return scaled_mixing(product(found.unmixing, white_filter), vectors)

    try:
        return half_width(np.stack(in_threads(without, range(_PARTS))), sizes)
    except (ValueError, np.linalg.LinAlgError):
        return np.full((len(samples), *vectors.shape), np.nan)
