"""Frames against what their raster lets expect at the places that samples see."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from processing.patterns import Pattern
from processing.proof.finding import Finding
from processing.proof.places import Places, Sighting, fit, sighting, weights

PROJECTOR_PX = 96, 128
NOISE = 0.02
OTHERS = [Pattern.parse(name) for name in ("checker:8", "stripes-columns:12", "stripes-rows:12")]
Array = NDArray[np.float64]


def surface(side: int = 40, moved: float = 0.0) -> Places:
    """A surface seen askew, 2 projector pixels a sample, away from the raster's edge."""
    down, right = np.mgrid[:side, :side] * 1.0
    row = 8 + 1.9 * down + 0.15 * right + moved
    column = 10 + 2.1 * right + 0.2 * down + 0.01 * right**2 + moved
    return Places(row.ravel(), column.ravel(), 2.0, PROJECTOR_PX)


def light(raster: Array, places: Places, alpha: float = 1.0, blur_px: float = 0.0) -> Array:
    """Relative light of samples, half of what is not direct everywhere alike, noisy."""
    sharp = gaussian_filter(raster, max(blur_px, 0.6))
    seen = map_coordinates(sharp, [places.row, places.column], order=1, mode="nearest")
    chance = np.random.default_rng(5)
    return np.asarray(
        0.5 * (1 - alpha) + alpha * seen + chance.normal(0, NOISE, seen.shape), np.float64
    )


def told(pattern: Pattern, picture: Array, places: Places) -> Sighting:
    return sighting(pattern, places, picture, np.full(picture.shape, NOISE**2), OTHERS)


PATTERNS = ["checker:6:4,2", "checker:12:5,3", "checker:24:16,8", "stripes-columns:12:4",
            "stripes-rows:8:2", "sinusoid-columns:12:6", "sinusoid-rows:24:12"]  # fmt: skip


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize(
    ("alpha", "blur_px", "moved"),
    [
        pytest.param(1.0, 0.0, 0.0, id="sharp"),
        pytest.param(1.0, 3.0, 0.0, id="blurred"),
        pytest.param(0.1, 0.0, 0.0, id="faded"),
        pytest.param(1.0, 0.0, 1.0, id="moved by half a camera pixel"),
        pytest.param(0.0, 0.0, 0.0, id="gone"),
    ],
)
def test_a_right_frame_is_never_accused(
    name: str, alpha: float, blur_px: float, moved: float
) -> None:
    pattern = Pattern.parse(name)
    picture = light(pattern.code(PROJECTOR_PX), surface(moved=moved), alpha, blur_px)
    found = told(pattern, 1.3 * picture + 0.05, surface())
    if alpha == 0:
        assert found.finding is Finding.UNSEEN
    elif blur_px == 0:
        assert found.finding is Finding.OWN
    assert not found.is_wrong


@pytest.mark.parametrize("name", ["checker:12:5,3", "stripes-columns:12:4", "sinusoid-rows:24:12"])
@pytest.mark.parametrize("alpha", [1.0, 0.2])
@pytest.mark.parametrize("moved", [(0, 5), (5, 0), (-6, 4)])
def test_a_moved_raster_is_found_where_it_stands(
    name: str, alpha: float, moved: tuple[int, int]
) -> None:
    pattern = Pattern.parse(name)
    raster = np.roll(pattern.code(PROJECTOR_PX), moved, (0, 1))
    found = told(pattern, light(raster, surface(), alpha), surface())
    family = pattern.family
    along = moved[0] * family.varies_down, moved[1] * family.varies_right
    if along == (0, 0):
        assert found.finding is Finding.OWN
        return
    assert found.finding is Finding.MISPLACED
    assert found.displaced_px == pytest.approx(along, abs=1.0)


@pytest.mark.parametrize(
    ("axes", "how"),
    [((1,), "mirrored left to right"), ((0,), "upside down"), ((0, 1), "turned by 180°")],
)
def test_a_raster_that_is_turned_over_is_told_by_all_its_frames(
    axes: tuple[int, ...], how: str
) -> None:
    named = []
    for shift in ((0, 1), (5, 4), (9, 7), (16, 10)):
        pattern = Pattern(OTHERS[0].family, 12, *shift)
        raster = np.flip(pattern.code(PROJECTOR_PX), axes)
        found = told(pattern, light(raster, surface()), surface())
        if found.is_wrong:
            assert found.finding is Finding.MISPLACED
            named.append(set(found.seen_as))
    assert len(named) >= 2
    assert set.intersection(*named) == {how}


@pytest.mark.parametrize("name", ["checker:8:3,3", "stripes-columns:12:5", "stripes-rows:12"])
def test_another_pattern_is_named(name: str) -> None:
    shown = Pattern.parse(name)
    found = told(Pattern.parse("checker:12"), light(shown.code(PROJECTOR_PX), surface()), surface())
    assert found.finding is Finding.OTHER
    assert found.seen_as == (f"{shown.family} of {shown.pitch_px} px",)


def test_a_raster_of_another_size_is_not_what_was_asked_for() -> None:
    pattern = Pattern.parse("checker:12")
    raster = pattern.code(PROJECTOR_PX)
    scaled = map_coordinates(raster, 0.8 * np.mgrid[:96, :128], order=1)
    found = told(pattern, light(scaled, surface()), surface())
    assert found.finding is Finding.OTHER
    assert found.seen_as == ()


def test_few_samples_tell_nothing() -> None:
    places = surface(16)
    raster = np.roll(Pattern.parse("checker:12").code(PROJECTOR_PX), 5, 1)
    assert told(Pattern.parse("checker:12"), light(raster, places), places).finding is (
        Finding.UNSEEN
    )


def test_places_and_light_must_be_of_one_number() -> None:
    places = surface()
    with pytest.raises(ValueError, match=r"\(1600,\).*\(5,\)"):
        fit(Pattern.parse("checker:12"), places, np.zeros(5), weights(np.zeros(5)))
