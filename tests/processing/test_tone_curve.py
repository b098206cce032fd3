"""A camera's own tone curve, found from patterns and complements."""

from __future__ import annotations

import numpy as np
import pytest

from processing.frames.sites import Light
from processing.frames.tone_curve import KNOTS, Evidence, ToneCurve, find_curve
from tests.processing.gain_scenes import SITES, Array, Camera, Scene


def contrasty(light: Array, by: float) -> Array:
    """Light as a camera writes it that makes contrasts larger, as the sRGB curve reads it."""
    code = np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
    )
    steep = code + by * code * (1 - code) * (2 * code - 1)
    read: Array = np.where(steep <= 0.04045, steep / 12.92, ((steep + 0.055) / 1.055) ** 2.4)
    return read


def looked(by: float, *, pairs: int = 6) -> Evidence | None:
    rng = np.random.default_rng(7)
    scene, camera = Scene.of(rng), Camera(rng)

    def seen(light: Array) -> Light:
        plain = camera.light(light)
        values = contrasty(np.clip(plain.values, 0, 1).astype(np.float64), by)
        return Light(values.astype(np.float32), plain.usable)

    taken = []
    for k in range(pairs):
        first, second = scene.pair(6 + 3 * k, 0.9)
        gains = rng.uniform(0.9, 1.1, (2, 3))
        taken.append(
            (seen(gains[0] * (first + scene.room)), seen(gains[1] * (second + scene.room)))
        )
    return find_curve(taken, (seen(scene.white + scene.room), seen(scene.room)), SITES.tiles)


def test_a_curve_is_found_and_undone_but_for_a_factor() -> None:
    """A factor common to all light is no curve: the ratio to the light is compared, from 3 % on."""
    found = looked(0.5)
    assert found is not None
    assert found.convinces
    light = np.linspace(0.03, 0.8, 200)
    numbers = np.repeat(contrasty(light, 0.5)[:, np.newaxis], 3, axis=1).astype(np.float32)
    before = numbers[:, 0] / light
    found.curve.apply(numbers)
    after = numbers[:, 0] / light
    assert np.std(after) / np.mean(after) < 0.5 * np.std(before) / np.mean(before)


def test_without_a_curve_none_is_believed() -> None:
    found = looked(0.0)
    assert found is not None
    assert not found.convinces


def test_few_pairs_tell_nothing() -> None:
    assert looked(0.5, pairs=3) is None


def test_more_light_never_becomes_less() -> None:
    steep = tuple(8.0 if knot < 0.1 else 0.2 for knot in KNOTS)
    values = np.repeat(np.linspace(0, 1, 4001, dtype=np.float32)[:, np.newaxis], 3, axis=1)
    ToneCurve((steep,) * 3).apply(values)
    assert np.all(np.diff(values, axis=0) >= 0)
    plain = np.repeat(np.arange(256, dtype=np.float32)[:, np.newaxis], 3, axis=1) / np.float32(255)
    same = plain.copy()
    ToneCurve(((1.0,) * len(KNOTS),) * 3).apply(same)
    assert same == pytest.approx(plain, abs=1e-5)
