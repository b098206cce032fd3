"""How sharp a picture is: a figure that grows as a lens is brought into focus."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

SCALE_PX = 1.0


def focus_figure(light: NDArray[np.floating], usable: NDArray[np.bool_] | None = None) -> float:
    """Energy of the fine detail relative to the light, dimensionless and ≥ 0.

    F = σ² ⟨|∇ (G_σ * L)|²⟩ / ⟨L⟩² with σ = 1 px: the gradient energy of Tenenbaum (Accommodation
    in computer vision, Stanford 1970), smoothed against noise and divided by the light, so that
    exposure does not enter. A sinusoid of contrast c and k radians a pixel has
    F = (c k σ)² exp(−k² σ²)/2. Noise adds to it: compare pictures of the same scene under the same
    light and exposure only.

    Parameters
    ----------
    light
        Linear light, (height, width), any unit; at least 3 pixels a side.
    usable
        (height, width), False where a pixel does not count (saturated); None for all.

    Returns
    -------
    NaN where no pixel is usable or there is no light.
    """
    if light.ndim != 2 or min(light.shape) < 3:
        raise ValueError(f"light is (height, width), at least 3 × 3, not {light.shape}")
    if usable is not None and usable.shape != light.shape:
        raise ValueError(f"usable {usable.shape} does not fit light {light.shape}")
    values = np.asarray(light, np.float64)
    down = gaussian_filter(values, SCALE_PX, order=(1, 0), mode="nearest")
    right = gaussian_filter(values, SCALE_PX, order=(0, 1), mode="nearest")
    energy = down * down + right * right
    chosen = np.ones(light.shape, np.bool_) if usable is None else usable
    if not chosen.any():
        return float("nan")
    mean = float(values[chosen].mean())
    if not mean > 0:
        return float("nan")
    return SCALE_PX**2 * float(energy[chosen].mean()) / mean**2
