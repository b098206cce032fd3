"""White and black are judged part by part."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.proof.finding import Finding
from processing.proof.parts import Parts
from processing.proof.references import Reference, contradicted, later_reference
from processing.proof.sample_noise import SampleNoise

SIDE = 64
NOISE = SampleNoise(1e-4)  # 1 % of white
PLACES = np.divmod(np.arange(SIDE * SIDE), SIDE)
PARTITIONS = tuple(Parts.grid(PLACES, (SIDE, SIDE), grid) for grid in ((1, 1), (4, 4), (16, 1)))
DOWN = PLACES[0]


def noisy(light: NDArray[np.float64], seed: int) -> NDArray[np.float32]:
    """A frame of this light."""
    chance = np.random.default_rng(seed)
    frame: NDArray[np.float32] = (light + chance.normal(0, 0.01, light.shape)).astype(np.float32)
    return frame


def checks(shift: int) -> NDArray[np.float64]:
    lit: NDArray[np.float64] = ((PLACES[0] + shift) // 8 + PLACES[1] // 8) % 2 == 0
    return lit.astype(np.float64)


WHITE, BLACK = np.full(SIDE * SIDE, 0.8), np.full(SIDE * SIDE, 0.02)
LAST_ROWS = DOWN >= 58


@pytest.mark.parametrize(
    ("light", "is_white", "finding"),
    [
        pytest.param(BLACK, False, Finding.OWN, id="black"),
        pytest.param(BLACK + 0.05, False, Finding.OWN, id="black, more light in the room"),
        pytest.param(
            np.where(LAST_ROWS, 0.8 * checks(0), BLACK), False, Finding.OTHER, id="black, torn"
        ),
        pytest.param(0.8 * WHITE, True, Finding.OWN, id="white, darker lamp"),
        pytest.param(np.where(LAST_ROWS, 0.02, WHITE), True, Finding.OTHER, id="white, cut"),
        pytest.param(0.8 * checks(0), True, Finding.OTHER, id="white shows a pattern"),
        pytest.param(BLACK, True, Finding.BLANK, id="white shows nothing"),
    ],
)
def test_a_later_reference_is_compared_with_the_first(
    light: NDArray[np.float64], is_white: bool, finding: Finding
) -> None:
    found, _ = later_reference(
        noisy(light, 1), noisy(WHITE, 2), noisy(BLACK, 3), NOISE, PARTITIONS, is_white=is_white
    )
    assert found is finding


@pytest.mark.parametrize(
    ("white", "black", "wrong"),
    [
        pytest.param(WHITE, BLACK, set(), id="both right"),
        pytest.param(0.85 * WHITE, BLACK, set(), id="a lamp that brightens"),
        pytest.param(WHITE, 0.8 * checks(0), {Reference.BLACK}, id="black shows a pattern"),
        pytest.param(0.8 * checks(4), BLACK, {Reference.WHITE}, id="white shows a pattern"),
        pytest.param(
            np.where(LAST_ROWS, BLACK, WHITE), BLACK, {Reference.WHITE}, id="white is cut off"
        ),
    ],
)
def test_patterns_prove_white_and_black_wrong(
    white: NDArray[np.float64], black: NDArray[np.float64], wrong: set[Reference]
) -> None:
    frames = np.stack([noisy(0.02 + 0.78 * checks(2 * k), k) for k in range(8)])
    frames[3] = noisy(BLACK, 9)  # a minority may be wrong
    pairs = [(0, 4), (1, 5), (2, 6), (3, 7)]
    found = contradicted(frames, noisy(white, 20), noisy(black, 21), pairs, NOISE, PARTITIONS)
    assert found == wrong
