"""Gains of an automatic camera, found from patterns and complements."""

from __future__ import annotations

import numpy as np
import pytest

from processing.frames.exposure_gains import (
    PairGains,
    black_gain,
    pair_gains,
    single_gain,
)
from processing.frames.sites import Sites
from processing.frames.tone_curve import due_of
from tests.processing.gain_scenes import SIDE, SITES, Array, Camera, Scene

TRIALS = 16


def taken(seed: int, gains: Array, contrast: float = 1.0, change: Array | None = None) -> PairGains:
    """A pair in one capture; `change` is light that only the second frame has."""
    rng = np.random.default_rng(seed)
    scene, camera = Scene.of(rng), Camera(rng)
    due, usable = due_of((camera.light(scene.white + scene.room), camera.light(scene.room)))
    first, second = scene.pair(10, contrast)
    other = second if change is None else second + change
    frames = (
        camera.light(gains[0] * (first + scene.room)),
        camera.light(gains[1] * (other + scene.room)),
    )
    found = pair_gains(frames, due, usable, SITES.tiles)
    assert found is not None
    return found


def drawn(seed: int) -> Array:
    return 1 + 0.15 * np.random.default_rng(1000 + seed).uniform(-1, 1, (2, 3))


def deviations(contrast: float) -> tuple[Array, Array]:
    """Errors and standard errors of all gains."""
    off, stated = [], []
    for seed in range(TRIALS):
        found, gains = taken(seed, drawn(seed), contrast), drawn(seed)
        off.append([one.value for one in found.gains] - gains)
        stated.append([one.error for one in found.gains])
        assert found.differs
        assert found.fits
    return np.array(off), np.array(stated)


@pytest.mark.parametrize("contrast", [1.0, 0.2], ids=["resolved", "hardly resolved"])
def test_gains_are_found_within_their_errors(contrast: float) -> None:
    """0.68 of 96 values, whose colours share the scene: three standard deviations are 0.14."""
    off, stated = deviations(contrast)
    covered = float(np.mean(np.abs(off) < stated))
    assert 0.68 - 0.14 < covered < 0.68 + 0.14
    assert np.mean(np.abs(off) < 2 * stated) > 0.88


@pytest.mark.parametrize("contrast", [0.02, 0.0], ids=["a trace", "nothing"])
def test_where_stripes_are_not_resolved_half_of_the_light_tells(contrast: float) -> None:
    """Noise alone would draw both gains to their mean, 0.05 off: half of the light does not."""
    off, stated = deviations(contrast)
    assert np.sqrt(np.mean(off**2)) < 0.003
    assert np.mean(np.abs(off) < stated) > 0.68


def test_equal_gains_are_not_told_from_none() -> None:
    found = [taken(seed, np.ones((2, 3)), contrast) for seed in range(20) for contrast in (1, 0.1)]
    assert not any(one.differs for one in found)


def test_what_moved_does_not_count() -> None:
    """A twentieth of the picture is brighter by half of white in one frame."""
    change = np.zeros((SIDE, SIDE, 3))
    change[10:31, 10:31] = 0.4
    still, moved = taken(3, drawn(3)), taken(3, drawn(3), change=change)
    for one, other in zip(still.gains, moved.gains, strict=True):
        assert other.value == pytest.approx(one.value, abs=0.004)
    assert moved.outlying > 0.02 > still.outlying


def test_what_gains_do_not_explain_stays_uncorrected() -> None:
    """Light that comes in from one side of the picture is no gain."""
    ramp = 0.3 * np.broadcast_to(
        np.linspace(-1, 1, SIDE)[:, np.newaxis, np.newaxis] ** 3, (SIDE, SIDE, 3)
    )
    found = taken(4, np.ones((2, 3)), change=ramp)
    assert found.left > 0.05
    assert found.by_place > found.by_level
    assert not found.fits


def test_the_gain_of_black_and_of_another_white_frame() -> None:
    rng = np.random.default_rng(5)
    scene, camera = Scene.of(rng), Camera(rng)
    bright = Scene(scene.white, 0.2 * scene.white[::-1] + 0.05, scene.direct)
    white = camera.light(bright.white + bright.room)
    black = camera.light(1.3 * bright.room)
    pairs = []
    for pitch in (8, 12, 20):
        first, second = bright.pair(pitch, 1.0)
        pairs.append(
            (camera.light(first + bright.room), camera.light(1.1 * (second + bright.room)))
        )
    found = black_gain(pairs, (white, black), SITES.tiles)
    assert found is not None
    assert np.all(np.abs(found.value - 1.3) < np.maximum(4 * found.error, 0.02))
    assert black_gain(pairs, (white, camera.light(1e-4 * bright.room)), SITES.tiles) is None
    again = single_gain(camera.light(0.93 * (bright.white + bright.room)), white, SITES.tiles)
    assert again is not None
    assert again.value == pytest.approx(0.93, abs=0.002)


def test_sites_are_neighbours_inside_the_picture() -> None:
    sites = Sites((240, 321))
    place = np.moveaxis(np.mgrid[:240, :321], 0, -1).astype(np.float32)
    dark = np.zeros((240, 321), np.bool_)
    dark[100:140] = True
    light = sites.light(place, dark)
    assert np.all(light.values[1] - light.values[0] == 1)
    assert light.usable.sum() == pytest.approx(len(light.usable) * 199 / 240, rel=0.05)
    assert sites.tiles.min() == 0
    assert sites.tiles.max() == 63
    assert not Sites((20, 300)).suffice
