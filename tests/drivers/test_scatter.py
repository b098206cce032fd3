from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from drivers.sim.scatter import Scatterer, diffusion_profile

RANGE_M = 0.004
TEXEL_M = 0.002


def scatterer(side: int = 121, albedo: float = 0.8) -> Scatterer:
    return Scatterer.of((albedo,), (RANGE_M,), (side, side), (TEXEL_M, TEXEL_M))


@pytest.mark.parametrize(
    ("power", "expected"),
    [pytest.param(0, 1.0, id="energy"), pytest.param(1, 2.5 * RANGE_M, id="mean-distance")],
)
def test_moments_of_the_profile(power: int, expected: float) -> None:
    def ring(r_m: float) -> float:
        return 2 * np.pi * r_m ** (power + 1) * float(diffusion_profile(np.array(r_m), RANGE_M))

    moment, error = quad(ring, 1e-12, 60 * RANGE_M)
    assert moment == pytest.approx(expected, abs=10 * error + 1e-6 * expected)


def test_uniform_light_leaves_the_middle_of_a_large_tile_dimmed_by_the_albedo_alone() -> None:
    leaving = scatterer().exitance(np.ones((1, 121, 121)))[0]
    assert leaving[60, 60] == pytest.approx(0.8, rel=4e-3)
    assert leaving[0, 0] < 0.5 * leaving[60, 60]


def test_light_takes_the_same_way_back() -> None:
    tile = scatterer(side=20)
    there, back = np.zeros((1, 20, 20)), np.zeros((1, 20, 20))
    there[0, 3, 4], back[0, 15, 9] = 1, 1
    assert tile.exitance(there)[0, 15, 9] == pytest.approx(tile.exitance(back)[0, 3, 4])


def test_no_more_leaves_than_entered_and_none_of_it_is_negative() -> None:
    rng = np.random.default_rng(1)
    entering = rng.random((1, 40, 40))
    leaving = scatterer(side=40).exitance(entering)
    assert leaving.sum() < 0.8 * entering.sum()
    assert leaving.min() > 0


@pytest.mark.parametrize("period_texels", [12, 24, 40])
def test_a_sinusoid_is_damped_as_the_transform_of_the_profile_says(period_texels: int) -> None:
    wave_per_m = 2 * np.pi / (period_texels * TEXEL_M)
    wave = np.cos(2 * np.pi * (np.arange(241) - 120) / period_texels)
    leaving = scatterer(side=241, albedo=1.0).exitance(np.tile(1 + wave, (241, 1))[np.newaxis])[0]
    plain = scatterer(side=241, albedo=1.0).exitance(np.ones((1, 241, 241)))[0]
    # Hankel transform of (e^(−r/d) + e^(−r/3d))/(8π d r).
    near = 0.25 / np.hypot(1, RANGE_M * wave_per_m)
    far = 0.75 / np.hypot(1, 3 * RANGE_M * wave_per_m)
    half_texel = np.sinc(1 / period_texels)
    assert leaving[120, 120] - plain[120, 120] == pytest.approx((near + far) * half_texel, rel=0.02)
