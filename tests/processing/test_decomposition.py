"""From rows of direct light to named components, where the truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from processing.independence.decomposition import decompose_iva
from processing.metrics import best_assignment, relative_error
from tests.processing.conftest import Mixture

EVERYWHERE = np.ones((128, 144), bool)
NAMES = ("direct", "subsurface", "interreflection")


def noisy(rows: NDArray[np.float32], deviation: float) -> NDArray[np.float32]:
    noise = np.random.default_rng(9).normal(0, deviation, rows.shape)
    return (rows + noise).astype(np.float32)


def test_components_their_names_and_curves_are_recovered(mixture: Mixture) -> None:
    found = decompose_iva(mixture.rows, mixture.pitch_px, EVERYWHERE)
    assert found.names == NAMES
    for name, component, truth in zip(NAMES, found.components, mixture.components, strict=True):
        assert relative_error(component, truth, EVERYWHERE) < 0.02, name
    np.testing.assert_allclose(found.mixing, np.tile(mixture.mixing, (3, 1, 1)), atol=0.05)
    assert np.all(np.diff(found.cost) <= 1e-9)
    assert found.shares.sum() == pytest.approx(1)
    assert found.smoothing_px == 0
    assert found.warnings == ()


@pytest.mark.parametrize(
    ("deviation", "bounds"),
    [
        pytest.param(0.001, (0.01, 0.05, 0.05), id="0.1%"),
        pytest.param(0.005, (0.03, 0.10, 0.15), id="0.5%"),
    ],
)
def test_noise_is_smoothed_away_before_unmixing(
    mixture: Mixture, deviation: float, bounds: tuple[float, ...]
) -> None:
    """With gains, as a little noise in the white row moves the scale of the weak ones."""
    rows = noisy(mixture.rows, deviation)
    found = decompose_iva(rows, mixture.pitch_px, EVERYWHERE)
    errors = best_assignment(found.components, mixture.components, EVERYWHERE).errors
    assert found.smoothing_px > 0
    assert found.noise == pytest.approx(deviation / np.percentile(rows[-1], 99.9), rel=0.3)
    assert np.all(np.array(errors) < bounds), errors
    plain = decompose_iva(rows, mixture.pitch_px, EVERYWHERE, smoothing_px=0.0)
    unsmoothed = best_assignment(plain.components, mixture.components, EVERYWHERE).errors
    assert max(errors) < max(unsmoothed)


@pytest.mark.parametrize("n_components", [2, 3, 4])
@pytest.mark.parametrize("n_colors", [1, 3], ids=["one-color", "three-colors"])
def test_components_add_up_to_white(mixture: Mixture, n_colors: int, n_components: int) -> None:
    """Four principal components and more reproduce white to its noise, three and two nearly."""
    rows = noisy(mixture.rows, 0.002)[..., :n_colors]
    found = decompose_iva(rows, mixture.pitch_px, EVERYWHERE, n_components=n_components)
    assert found.components.shape == (n_components, 128, 144, n_colors)
    np.testing.assert_allclose(found.mixing[:, -1], 1, rtol=1e-9)
    assert len(set(found.names)) == n_components
    total = found.components.sum(axis=0)
    assert relative_error(total, rows[-1], EVERYWHERE) < {2: 0.1, 3: 0.01, 4: 0.01}[n_components]


def test_masked_pixels_estimate_nothing(mixture: Mixture) -> None:
    mask = EVERYWHERE.copy()
    mask[40:60, 30:50] = False
    mask[::17, ::13] = False
    dark = np.where(mask[..., np.newaxis], mixture.rows, 0).astype(np.float32)
    wild = np.where(mask[..., np.newaxis], mixture.rows, np.nan).astype(np.float32)
    one = decompose_iva(dark, mixture.pitch_px, mask)
    other = decompose_iva(wild, mixture.pitch_px, mask)
    np.testing.assert_array_equal(one.components[:, mask], other.components[:, mask])
    np.testing.assert_array_equal(one.mixing, other.mixing)
    for component, truth in zip(one.components, mixture.components, strict=True):
        assert relative_error(component, truth, mask) < 0.02


def test_a_larger_picture_is_sampled_and_any_number_of_threads_finds_the_same(
    mixture: Mixture,
) -> None:
    """Six by eight tiles of the picture are 0.9 megapixels, of which one in four is sampled."""
    rows, truths = (np.tile(one, (1, 6, 8, 1)) for one in (mixture.rows, mixture.components))
    mask = np.ones(rows.shape[1:3], bool)
    found = decompose_iva(rows, mixture.pitch_px, mask)
    assert found.names == NAMES
    for component, truth in zip(found.components, truths, strict=True):
        assert relative_error(component, truth, mask) < 0.02
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = decompose_iva(rows, mixture.pitch_px, mask)
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(found.components, alone.components)
    np.testing.assert_array_equal(found.mixing_half_width, alone.mixing_half_width)


def test_a_single_usable_value_that_is_not_finite_is_found_out(mixture: Mixture) -> None:
    rows = np.tile(mixture.rows, (1, 6, 8, 1))
    rows[5, 301, 77, 1] = np.inf
    with pytest.raises(ValueError, match="not finite"):
        decompose_iva(rows, mixture.pitch_px, np.ones(rows.shape[1:3], bool))


def test_rows_may_be_files_and_so_may_the_result(mixture: Mixture, tmp_path: Path) -> None:
    files = []
    for index, row in enumerate(mixture.rows):
        np.save(tmp_path / f"{index}.npy", row)
        files.append(np.load(tmp_path / f"{index}.npy", mmap_mode="r"))
    shape = mixture.components.shape
    out = np.memmap(tmp_path / "components", np.float32, "w+", shape=shape)
    found = decompose_iva(files, mixture.pitch_px, EVERYWHERE, out=out)
    expected = decompose_iva(mixture.rows, mixture.pitch_px, EVERYWHERE)
    assert found.components is out
    np.testing.assert_array_equal(out, expected.components)


def test_a_component_too_many_is_said_to_be_noise(mixture: Mixture) -> None:
    found = decompose_iva(noisy(mixture.rows, 0.002), mixture.pitch_px, EVERYWHERE, n_components=4)
    assert any("Principal component 4 is not significant" in one.what for one in found.warnings)
    assert not any("Principal component 3" in one.what for one in found.warnings)
    assert found.significant == 3


def test_what_holds_no_light_at_all_stays_empty(mixture: Mixture) -> None:
    """An even board without noise: direct light alone, the same bits at every pitch."""
    rows = np.repeat(mixture.components[:1], 5, axis=0)
    found = decompose_iva(rows, [8, 16, 32, 64, np.inf], EVERYWHERE)
    np.testing.assert_allclose(found.components[0], rows[0], rtol=1e-5)
    assert np.abs(found.components[1:]).max() < 1e-5
    assert found.significant == 1
    np.testing.assert_allclose(found.mixing[..., 0], 1, atol=1e-6)


def test_noise_at_every_scale_is_said(mixture: Mixture) -> None:
    found = decompose_iva(noisy(mixture.rows, 0.1), mixture.pitch_px, EVERYWHERE)
    assert any("noise drowns" in one.what for one in found.warnings)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        pytest.param({"pitch_px": [8.0, np.inf]}, r"13 rows.*\(2,\)", id="too-few-pitches"),
        pytest.param({"pitch_px": np.arange(1, 14.0)}, "infinity", id="no-white"),
        pytest.param({"mask": np.ones((4, 5), bool)}, r"\(128, 144, 3\).*\(4, 5\)", id="mask"),
        pytest.param({"mask": np.zeros((128, 144), bool)}, "no usable pixel", id="all-masked"),
        pytest.param({"n_components": 1}, "2 to 13", id="one-component"),
        pytest.param({"n_components": 14}, "2 to 13", id="too-many-components"),
        pytest.param({"rows": np.zeros((13, 128, 144, 3), "f4")}, "no light", id="dark"),
        pytest.param({"rows": np.full((13, 128, 144, 3), np.nan, "f4")}, "finite", id="nan"),
        pytest.param({"out": np.zeros((2, 128, 144, 3), "f4")}, r"\(2, 128.*\(3, 128", id="out"),
    ],
)
def test_what_cannot_be_decomposed_is_refused(
    mixture: Mixture, change: dict[str, Any], said: str
) -> None:
    arguments: dict[str, Any] = {
        "rows": mixture.rows,
        "pitch_px": mixture.pitch_px,
        "mask": EVERYWHERE,
    }
    with pytest.raises(ValueError, match=said):
        decompose_iva(**(arguments | change))
