"""Intervals of α hold the truth as often as they say."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from processing.independence.decomposition import decompose_iva
from processing.numerics.jackknife import half_width, tiles
from processing.ranges.account_fit import AccountFit
from processing.ranges.accounts import opaque, translucent
from processing.ranges.mean_mixing import mean_mixing
from tests.processing.conftest import HEIGHT, WIDTH, Mixture, patches

PITCHES_PX = np.array([8.0, 16.0, 32.0])
REPEATS = 400
# Four standard deviations of the share of 400 that hold the truth, and what Student's t lacks
# where the parts are not normal.
WITHIN = (0.95 - 0.065, 0.95 + 0.044)


@pytest.mark.parametrize("uneven", [0.0, 0.7], ids=["equal parts", "uneven parts"])
def test_interval_of_a_ratio_holds_the_truth_in_19_of_20(uneven: float) -> None:
    chance = np.random.default_rng(3)
    light = np.exp(chance.normal(0, uneven, (REPEATS, 40)))
    rates = 0.4 + chance.normal(0, 0.1, light.shape)
    hits = 0
    for sizes, rate in zip(light, rates, strict=True):
        product = sizes * rate
        whole = product.sum() / sizes.sum()
        without = (product.sum() - product) / (sizes.sum() - sizes)
        hits += int(abs(whole - 0.4) <= half_width(without[:, np.newaxis], sizes)[0])
    assert WITHIN[0] < hits / REPEATS < WITHIN[1]


def test_too_few_parts_give_no_interval() -> None:
    estimates = np.array([[1.0], [1.1], [0.9], [1.0], [1.05], [0.95]])
    assert np.isfinite(half_width(estimates, np.ones(6))).all()
    assert np.isnan(half_width(estimates[:4], np.ones(4))).all()
    # Six parts, of which one holds nearly everything, are hardly more than one.
    assert np.isnan(half_width(estimates, np.array([100.0, 1, 1, 1, 1, 1]))).all()
    with pytest.raises(ValueError, match=r"\(6, 1\).*\(5,\)"):
        half_width(estimates, np.ones(5))


def test_tiles_cut_the_picture_where_it_is_usable() -> None:
    mask = np.ones((16, 24), bool)
    mask[0, 0] = False
    labels = np.full(mask.shape, -1)
    labels[mask] = tiles(mask)
    assert labels[0, 0] == -1
    assert set(labels[mask]) == set(range(64))
    assert (labels[2:4, 3:6] == 9).all()


def fits_of(amounts: NDArray[np.float64], near: slice) -> AccountFit:
    none = np.zeros((len(amounts), 3))
    subsurface = amounts[:, near].sum(axis=1)
    return AccountFit(amounts, amounts[:, 0], subsurface, none, none, none[:, 0])


def test_mean_over_the_scene_and_its_interval() -> None:
    """Far light of random spectra, tile by tile, against what infinitely many tiles would have."""
    chance = np.random.default_rng(8)
    accounts = opaque(PITCHES_PX), translucent(PITCHES_PX)
    n_ranges = accounts[0].mixtures.shape[1]
    n_spreads = accounts[0].mixtures.shape[0]
    response = np.exp(-np.outer(1 / PITCHES_PX, np.linspace(0, 30, n_spreads)))
    tile = np.repeat(np.arange(64), 4)
    typical = np.linspace(1, 2, n_ranges + 1)
    spectrum = accounts[0].mixtures[:, 1:] @ typical[1:-1]
    truth = response @ spectrum / typical[1:].sum()
    nothing = np.zeros((len(tile), accounts[1].mixtures.shape[1] + 1))
    hits = np.zeros(len(PITCHES_PX))
    for _ in range(REPEATS):
        # Unit mean; what neighbours share makes the tiles differ.
        gamma = chance.gamma(4, 0.25, (64, n_ranges + 1))
        opaque_fit = fits_of(gamma[tile] * typical, slice(1, 1))
        found = mean_mixing(
            [response],
            accounts,
            [(opaque_fit, fits_of(nothing, slice(1, 2)))],
            np.zeros(len(tile), bool),
            tile,
        )
        hits += np.abs(found.alpha[0, :-1, 2] - truth) <= found.half_width[0, :-1, 2]
        assert (found.half_width[0, :, 0] == 0).all()
        assert (found.half_width[0, -1] == 0).all()
    assert np.all(hits / REPEATS > WITHIN[0])
    assert np.all(hits / REPEATS < WITHIN[1])


def test_interval_of_blind_separation_holds_the_truth(mixture: Mixture) -> None:
    """On pictures of independent components; the 36 numbers of a component move together.

    Six pictures of three components are some 18 independent cases: 0.80 is three of their
    standard deviations below 0.95.
    """
    held, widths = [], []
    for seed in range(6):
        chance = np.random.default_rng(seed)
        near = ndimage.gaussian_filter(patches(chance), (2, 2, 0))
        far = ndimage.gaussian_filter(patches(chance, 40), (4, 4, 0))
        parts = np.stack([0.6 * patches(chance), 0.25 * near, 0.2 * far])
        rows = np.tensordot(mixture.mixing, parts, 1).astype(np.float32)
        found = decompose_iva(rows, mixture.pitch_px, np.ones((HEIGHT, WIDTH), bool))
        missed = np.abs(found.mixing - mixture.mixing)[:, :-1]
        held.append(float(np.mean(missed <= found.mixing_half_width[:, :-1])))
        widths.append(float(np.median(found.mixing_half_width[:, :-1])))
        assert found.mixing_half_width[:, -1] == pytest.approx(0, abs=1e-9)
    assert np.mean(held) > 0.8
    assert max(widths) < 0.05
