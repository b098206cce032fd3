"""How much to smooth images before their gradients are unmixed.

Noise is white and gradients of smooth images are small, so noise drowns first what the weakest
component has to say. The unmixing is the same at every scale, so a coarser one may be chosen for
estimating it; too coarse a one forgets the edges that tell components apart. Measured on
synthetic mixtures and on a rendered corner: the least smoothing at which the gradients of the
weakest component hold 12 times the power of noise is best or next to it, from no noise (σ = 0)
over 0.1 % of full scale (0 to 1 px) and 0.5 % (1 to 1.5 px) to 1 % (2 px).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.independence.gradients import gradient_samples
from processing.numerics.strata import sample_stride

CHOICES_PX = (0.0, 1.0, 1.5, 2.0, 3.0)
_ENOUGH = 12.0
# They give the power of gradients to 1 % and better.
_JUDGED_PIXELS = 1 << 17


def choose_smoothing(
    weakest: NDArray[np.float32], mask: NDArray[np.bool_], noise: float
) -> tuple[float, bool]:
    """Least smoothing at which noise no longer rules the gradients of the weakest component.

    Parameters
    ----------
    weakest
        float32, (height, width, colours), the last principal image that is kept.
    mask
        bool, (height, width), True where a pixel is usable.
    noise
        Standard deviation of the noise of `weakest`, ≥ 0, in its unit.

    Returns
    -------
    smoothing_px, enough
        One of `CHOICES_PX`; False where not even the largest is enough.
    """
    stride_px = sample_stride(mask, enough=_JUDGED_PIXELS)
    for smoothing_px in CHOICES_PX:
        samples = gradient_samples(weakest[np.newaxis], mask, smoothing_px, stride_px)
        power = float(np.mean(np.square(samples, dtype=np.float64)))
        if power >= _ENOUGH * noise**2 * _noise_power_gain(smoothing_px):
            return smoothing_px, True
    return CHOICES_PX[-1], False


def _noise_power_gain(smoothing_px: float) -> float:
    """Variance of a gradient of smoothed white noise of variance 1."""
    reach = int(4 * smoothing_px) + 2
    impulse = np.zeros((1, 2 * reach + 1, 2 * reach + 1, 1), np.float32)
    impulse[0, reach, reach, 0] = 1
    response = gradient_samples(impulse, np.ones(impulse.shape[1:3], bool), smoothing_px)
    # The samples hold both directions, each with the same response.
    return float(np.sum(np.square(response, dtype=np.float64)) / 2)
