"""What is measured on the way: principal components, noise, gradients, smoothing, whitening."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.frames.noise import noise_deviation
from processing.independence.gradients import gradient_samples
from processing.independence.pca import principal_components
from processing.independence.smoothing import choose_smoothing
from processing.independence.whitening import whitening
from processing.numerics.rows import combine
from processing.numerics.strata import sample_stride, stratified
from tests.processing.conftest import Mixture

SHAPE = (40, 50)
EVERYWHERE = np.ones(SHAPE, bool)


def images(n: int, n_colors: int = 3, seed: int = 0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).standard_normal((n, *SHAPE, n_colors)).astype(np.float32)


@pytest.fixture
def spotted() -> NDArray[np.bool_]:
    """A mask with a hole and single lost pixels."""
    mask = EVERYWHERE.copy()
    mask[10:20, 25:33] = False
    mask[3, 4] = mask[30, 45] = mask[0, 0] = False
    return mask


def test_principal_components_are_the_singular_vectors_of_usable_pixels(
    spotted: NDArray[np.bool_],
) -> None:
    rows = images(5) + 1
    rows[1:] *= 0.1
    found = principal_components(rows, spotted)
    data = rows[:, spotted].reshape(5, -1).astype(np.float64)
    left, singular, _ = np.linalg.svd(data, full_matrices=False)
    np.testing.assert_allclose(found.shares, singular**2 / np.sum(singular**2), rtol=1e-9)
    np.testing.assert_allclose(np.abs(found.vectors), np.abs(left), atol=1e-6)
    assert found.mean_square == pytest.approx(np.mean(data**2))


def test_shares_of_rows_of_known_rank() -> None:
    one = images(1)[0]
    found = principal_components(np.stack([one, 2 * one, 3 * one]), EVERYWHERE)
    assert found.shares[0] == pytest.approx(1)
    assert np.all(found.shares[1:] < 1e-12)
    np.testing.assert_allclose(found.vectors[:, 0], np.array([1, 2, 3]) / np.sqrt(14), rtol=1e-6)


def test_a_large_stack_is_summed_in_blocks() -> None:
    """More values than one block holds give what the whole would."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((4, 900, 700, 2)).astype(np.float32)
    found = principal_components(rows, np.ones((900, 700), bool))
    gram = np.tensordot(rows.astype(np.float64), rows.astype(np.float64), ((1, 2, 3), (1, 2, 3)))
    values = np.linalg.eigvalsh(gram)[::-1]
    np.testing.assert_allclose(found.shares, values / values.sum(), rtol=1e-12)


def test_some_lines_of_a_large_stack_tell_its_principal_components() -> None:
    """Three kinds of noise, of 630 000 pixels and of every sixth line of them."""
    rng = np.random.default_rng(0)
    rows = np.tensordot(
        np.array([[1.0, 0, 0], [0, 0.2, 0], [0, 0, 0.05], [0.5, 0.1, 0.02]]),
        rng.standard_normal((3, 900, 700, 2)),
        1,
    ).astype(np.float32)
    mask = rng.random((900, 700)) < 0.9
    every, some = (principal_components(rows, mask, stride_px) for stride_px in (1, 6))
    # Some 190 000 values: variances to 0.3 %, directions to half of that; three times as much.
    np.testing.assert_allclose(some.shares[:3], every.shares[:3], rtol=0.01)
    np.testing.assert_allclose(some.vectors[:, :3], every.vectors[:, :3], atol=0.005)
    assert some.mean_square == pytest.approx(every.mean_square, rel=0.01)


def test_larger_pictures_have_larger_strides() -> None:
    mask = np.zeros((2000, 2000), bool)
    mask[:724, :724] = True
    assert (sample_stride(mask), sample_stride(mask, axes=1)) == (1, 1)
    mask[:1500, :1500] = True
    assert (sample_stride(mask), sample_stride(mask, axes=1)) == (3, 5)


@pytest.mark.parametrize("per_color", [False, True], ids=["one-matrix", "a-matrix-per-color"])
def test_images_are_combined_in_place(per_color: bool) -> None:
    before = images(3)
    matrix = np.random.default_rng(1).standard_normal((3, 3, 3) if per_color else (3, 3))
    each = np.broadcast_to(matrix, (3, 3, 3))
    expected = np.stack([np.tensordot(each[c], before[..., c], 1) for c in range(3)], axis=-1)
    after = before.copy()
    combine(matrix, after, after)
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("deviation", [0.001, 0.01, 0.1])
def test_noise_is_measured_over_a_picture(mixture: Mixture, deviation: float) -> None:
    picture = mixture.rows[-1]
    noise = np.random.default_rng(0).normal(0, deviation, picture.shape)
    found = noise_deviation((picture + noise).astype(np.float32), np.ones((128, 144), bool))
    assert found == pytest.approx(deviation, rel=0.05)


def test_noise_knows_neither_slopes_nor_lost_pixels(spotted: NDArray[np.bool_]) -> None:
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]]
    slope = np.repeat((down * 3.0 + right * 7.0)[..., np.newaxis], 3, axis=2).astype(np.float32)
    assert noise_deviation(slope, EVERYWHERE) == 0
    slope[~spotted] = np.nan
    assert noise_deviation(slope, spotted) == 0
    assert noise_deviation(slope, np.zeros(SHAPE, bool)) == 0


def test_gradients_of_a_slope_are_its_slope(spotted: NDArray[np.bool_]) -> None:
    down, right = np.mgrid[: SHAPE[0], : SHAPE[1]]
    slope = (2.0 * down + 5.0 * right)[np.newaxis, ..., np.newaxis].astype(np.float32)
    samples = gradient_samples(slope, EVERYWHERE)
    assert samples.shape == (1, 1, 40 * 49 + 39 * 50)
    assert np.all(samples[0, 0, : 40 * 49] == 5)
    assert np.all(samples[0, 0, 40 * 49 :] == 2)
    lost = gradient_samples(np.where(spotted[..., np.newaxis], slope, 1e9), spotted)
    assert set(np.unique(lost)) == {2.0, 5.0}


@pytest.mark.parametrize("smoothing_px", [0.0, 1.0, 2.5])
def test_masked_values_do_not_leak_into_gradients(
    spotted: NDArray[np.bool_], smoothing_px: float
) -> None:
    clean = images(2)
    wild = np.where(spotted[..., np.newaxis], clean, np.float32(np.nan))
    one = gradient_samples(clean, spotted, smoothing_px)
    np.testing.assert_array_equal(one, gradient_samples(wild, spotted, smoothing_px))


@pytest.mark.parametrize("smoothing_px", [0.0, 1.5])
def test_gradients_keep_the_mixing(spotted: NDArray[np.bool_], smoothing_px: float) -> None:
    sources = images(2)
    mixing = np.array([[1.0, 0.3], [0.2, 1.0], [0.7, -0.4]])
    mixed = np.tensordot(mixing, sources, 1).astype(np.float32)
    expected = mixing @ gradient_samples(sources, spotted, smoothing_px)
    found = gradient_samples(mixed, spotted, smoothing_px)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


def test_a_stride_takes_a_lattice_of_the_same_gradients() -> None:
    """One pixel of each 3 × 3, of which the last line and column have no neighbour."""
    one = images(1)
    plain, lines = one[0, ..., 0], stratified(40, 3)
    right, down = [], []
    for turn, line in enumerate(lines):
        columns = stratified(50, 3, turn)
        right.append(np.diff(plain[line])[columns[columns < 49]])
        if line < 39:
            down.append((plain[line + 1] - plain[line])[columns])
    found = gradient_samples(one, EVERYWHERE, stride_px=3)[0, 0]
    np.testing.assert_array_equal(found, np.concatenate([*right, *down]))


@pytest.mark.parametrize("stride", [1, 2, 3, 7])
def test_every_stratum_has_a_place(stride: int) -> None:
    for turn in range(5):
        places = stratified(100, stride, turn)
        np.testing.assert_array_equal(places // stride, np.arange(-(-100 // stride)))


@pytest.mark.parametrize("stride", [2, 3, 4, 8])
def test_texture_of_the_same_period_is_not_passed_over(stride: int) -> None:
    """Checks of 8 px have an edge at one pixel in eight, wherever the lattice lies."""
    down, right = np.mgrid[:400, :400]
    checks = (down // 8 + right // 8) % 2
    samples = gradient_samples(
        checks.astype(np.float32)[np.newaxis, ..., np.newaxis], np.ones((400, 400), bool), 0, stride
    )
    # 2500 samples and more: three standard deviations of a binomial are 0.02.
    assert np.mean(samples != 0) == pytest.approx(1 / 8, abs=0.02)


def test_smoothing_grows_with_noise(mixture: Mixture) -> None:
    weak = 0.02 * mixture.components[2]
    mask = np.ones((128, 144), bool)
    chosen = []
    for deviation in (0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1.0):
        noise = np.random.default_rng(0).normal(0, deviation, weak.shape)
        found, enough = choose_smoothing((weak + noise).astype(np.float32), mask, deviation)
        chosen.append(found)
        assert enough == (deviation < 1e-3)
    assert chosen == sorted(chosen)
    assert chosen[0] == 0
    assert chosen[-1] == 3


def test_whitened_mixtures_are_white() -> None:
    rng = np.random.default_rng(0)
    scales = np.array([1, 1e-2, 1e-4])[:, np.newaxis]
    mixing = rng.standard_normal((3, 3, 3))
    mixtures = (scales * (mixing @ rng.laplace(size=(3, 3, 10_000)))).astype(np.float32)
    white = whitening(mixtures) @ mixtures
    covariance = white @ white.swapaxes(1, 2) / white.shape[2]
    np.testing.assert_allclose(covariance, np.tile(np.eye(3), (3, 1, 1)), atol=1e-5)


def test_dependent_mixtures_cannot_be_whitened() -> None:
    mixtures = np.random.default_rng(0).laplace(size=(3, 3, 1000)).astype(np.float32)
    mixtures[:, 2] = 2 * mixtures[:, 1]
    with pytest.raises(ValueError, match="depend on each other"):
        whitening(mixtures)
    mixtures[:, 2] = 0
    with pytest.raises(ValueError, match="no gradients"):
        whitening(mixtures)


def test_shapes_that_do_not_fit_are_both_named() -> None:
    with pytest.raises(ValueError, match=r"\(1, 40, 50, 3\).*\(4, 4\)"):
        gradient_samples(images(1), np.ones((4, 4), bool))
    with pytest.raises(ValueError, match=r"\(40, 50, 3\).*\(4, 4\)"):
        noise_deviation(images(1)[0], np.ones((4, 4), bool))
    with pytest.raises(ValueError, match="bool"):
        principal_components(images(2), np.ones(SHAPE))  # type: ignore[arg-type]
