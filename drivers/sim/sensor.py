"""The simulated sensor: from light on the photosites to the counts in the file."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.errors import SettingsError
from drivers.protocols import CameraSettings
from drivers.sim.dng import BLACK_LEVEL, WHITE_LEVEL

# At these settings the brightest photosite under white reaches this fraction of the range.
REFERENCE = CameraSettings(exposure_s=0.1, aperture=8.0, iso=200)
REFERENCE_LEVEL = 0.8


def exposure_gain(settings: CameraSettings) -> float:
    """Fraction of the sensor's range that the brightest photosite under white reaches, noise-free.

    0.8 · (exposure / 0.1 s) · (8 / aperture)² · iso / 200; what is None counts as the reference.
    """
    aperture, iso = settings.aperture, settings.iso
    area = 1.0 if aperture is None else (8.0 / aperture) ** 2
    speed = 1.0 if iso is None else iso / 200
    return REFERENCE_LEVEL * (settings.exposure_s / REFERENCE.exposure_s) * area * speed


def check_settings(settings: CameraSettings) -> None:
    """Raise SettingsError for what the simulated camera does not have."""
    allowed = {
        "exposure_s": (settings.exposure_s, 1e-5, 3600.0),
        "aperture": (settings.aperture, 0.7, 64.0),
        "iso": (settings.iso, 25, 51200),
    }
    for name, (value, low, high) in allowed.items():
        if value is not None and not low <= value <= high:
            raise SettingsError(
                f"the simulated camera takes {name} from {low} to {high}, not {value}; "
                "change it in the plan"
            )


def expose(
    signal: NDArray[np.float64],
    iso: int | None,
    full_well_e: float | None,
    read_noise_e: float,
    rng: np.random.Generator,
) -> NDArray[np.uint16]:
    """Counts of every photosite: shot noise, read noise, 14 bits, clipped at both ends.

    Parameters
    ----------
    signal
        (height, width), expected light as a fraction of the sensor's range, ≥ 0.
    iso
        Speed; the white level stands for `full_well_e`·200/iso electrons.
    full_well_e
        Electrons at the white level at ISO 200; None for no shot noise.
    read_noise_e
        Standard deviation of the read-out in electrons.
    rng
        Source of all randomness in the frame.

    Returns
    -------
    uint16, black level 512, white level 16383.
    """
    fraction = signal
    if full_well_e is not None:
        range_e = full_well_e * (1.0 if iso is None else 200 / iso)
        electrons = rng.poisson(signal * range_e).astype(np.float64)
        if read_noise_e > 0:
            electrons += read_noise_e * rng.standard_normal(signal.shape)
        fraction = electrons / range_e
    counts = np.rint(BLACK_LEVEL + (WHITE_LEVEL - BLACK_LEVEL) * fraction)
    return np.clip(counts, 0, WHITE_LEVEL).astype(np.uint16)
