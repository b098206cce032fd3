"""Scenes in which D = A X holds exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

HEIGHT, WIDTH = 128, 144


@dataclass(frozen=True, slots=True)
class Mixture:
    """Components, their α against pitch, and the direct images that they make.

    Parameters
    ----------
    components
        float32, (3, height, width, 3): direct, subsurface, interreflection.
    mixing
        (m, 3), the last row, white, is 1.
    rows
        float32, (m, height, width, 3).
    pitch_px
        (m,), the last infinite.
    """

    components: NDArray[np.float32]
    mixing: NDArray[np.float64]
    rows: NDArray[np.float32]
    pitch_px: NDArray[np.float64]


def patches(rng: np.random.Generator, n_discs: int = 150) -> NDArray[np.float64]:
    """Discs of random colour, one over the other: sparse gradients, as scenes have."""
    image = np.full((HEIGHT, WIDTH, 3), 0.5)
    down, right = np.mgrid[:HEIGHT, :WIDTH]
    for _ in range(n_discs):
        radius = 0.03 * HEIGHT / np.sqrt(rng.uniform(0.03, 1))
        center = rng.uniform(0, HEIGHT), rng.uniform(0, WIDTH)
        inside = (down - center[0]) ** 2 + (right - center[1]) ** 2 < radius**2
        image[inside] = rng.uniform(0.05, 0.95, 3)
    return image


@pytest.fixture(scope="session")
def mixture() -> Mixture:
    rng = np.random.default_rng(0)
    near = ndimage.gaussian_filter(patches(rng), (2, 2, 0))
    far = ndimage.gaussian_filter(patches(rng, 40), (4, 4, 0))
    components = np.stack([0.6 * patches(rng), 0.25 * near, 0.2 * far]).astype(np.float32)
    pitch_px = np.arange(8, 100, 8.0)
    mixing = np.ones((len(pitch_px) + 1, 3))
    mixing[:-1, 1] = 1 - np.exp(-((pitch_px / 18) ** 1.5))
    mixing[:-1, 2] = 0.05 + 0.3 * (pitch_px / 96) ** 2
    rows = np.tensordot(mixing, components, 1).astype(np.float32)
    return Mixture(components, mixing, rows, np.append(pitch_px, np.inf))
