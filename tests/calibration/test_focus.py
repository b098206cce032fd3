from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from calibration.focus import focus_figure


@pytest.mark.parametrize("period_px", [6, 8, 16], ids=lambda p: f"{p} px")
@pytest.mark.parametrize("contrast", [0.2, 0.9])
def test_a_sinusoid_has_the_figure_of_the_formula(period_px: int, contrast: float) -> None:
    k = 2 * np.pi / period_px
    x = np.arange(period_px * 40)
    light = np.tile(1 + contrast * np.cos(k * x), (20, 1))
    inside = np.zeros(light.shape, np.bool_)
    inside[:, period_px * 2 : -period_px * 2] = True
    expected = (contrast * k) ** 2 * np.exp(-(k**2)) / 2
    # The sampled, truncated Gaussian differs from the continuous one by up to 2 %.
    assert focus_figure(light, inside) == pytest.approx(expected, rel=0.02)


def test_the_sharper_the_larger_and_exposure_does_not_enter() -> None:
    rng = np.random.default_rng(5)
    scene = (rng.random((60, 80)) > 0.5).astype(float) + 0.1
    figures = [focus_figure(gaussian_filter(scene, blur_px)) for blur_px in (0.1, 0.7, 1.5, 3.0)]
    assert figures == sorted(figures, reverse=True)
    assert focus_figure(0.03 * scene) == pytest.approx(focus_figure(scene), rel=1e-12)


def test_pixels_that_do_not_count_do_not_count() -> None:
    light = np.ones((20, 40))
    light[:, 20:] = np.arange(20) % 2 * 5.0
    flat = np.zeros(light.shape, np.bool_)
    flat[:, :12] = True
    assert focus_figure(light, flat) == pytest.approx(0, abs=1e-12)
    assert focus_figure(light) > 0.01
    assert np.isnan(focus_figure(light, np.zeros_like(flat)))
    assert np.isnan(focus_figure(np.zeros((4, 4))))


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(2, 9\)"):
        focus_figure(np.ones((2, 9)))
    with pytest.raises(ValueError, match=r"\(3, 3\).*\(4, 4\)"):
        focus_figure(np.ones((4, 4)), np.ones((3, 3), np.bool_))
