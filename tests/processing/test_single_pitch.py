"""Standard errors at one pitch against repeated simulation of the sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.frames.footprint import contrast
from processing.frames.frame_noise import FrameNoise, FrameSample, lattice, noise_of
from processing.frames.noise_bias import Correction, extrema_correction, measured_kinds
from processing.frames.order_statistics import (
    IntervalTable,
    amplitude_distribution,
    mean_extrema,
    mean_range,
    range_distribution,
)
from processing.frames.separation import ExtremaSeparation, SinusoidSeparation
from processing.frames.single_pitch import (
    CorrelationSeparation,
    Estimate,
    amplitude_estimate,
    extrema_estimate,
)
from processing.patterns import Family, Pattern, shift_grid

SHAPE = (90, 120)
EVERYWHERE = np.ones(SHAPE, bool)
# What an interval of one standard error is to hold, as the issue of the method states it.
RATE, TOLERANCE = 0.68, 0.03

Image = NDArray[np.float32]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """Counts of a Bayer quad in 14 bits, green the mean of two."""

    full_well_e: float
    read_noise_e: float

    def expose(self, rng: np.random.Generator, light: Array) -> Image:
        """Light (height, width) as (height, width, 3) in fractions of the full well."""
        sites = np.repeat(light[..., np.newaxis] * self.full_well_e, 4, axis=-1)
        electrons = rng.poisson(sites) + rng.normal(0, self.read_noise_e, sites.shape)
        counts = np.rint(electrons * 16383 / self.full_well_e) / 16383
        red, green, other, blue = np.moveaxis(counts, -1, 0)
        return np.stack([red, (green + other) / 2, blue], axis=-1).astype(np.float32)

    @property
    def noise(self) -> FrameNoise:
        """As a calibration would find it; rounding has the variance 1/12."""
        sites = np.array([1, 0.5, 1])
        constant = (self.read_noise_e / self.full_well_e) ** 2 + 1 / 12 / 16383**2
        return FrameNoise(sites * constant, sites / self.full_well_e)


@dataclass(frozen=True)
class Shot:
    """Pixels of all brightnesses and kinds, at random places, under the patterns of a pitch."""

    patterns: tuple[Pattern, ...]
    footprint_px: float
    sensor: Sensor
    seed: int = 0

    def run(self) -> Seen:
        rng = np.random.default_rng(self.seed)
        white = np.exp(rng.uniform(np.log(0.02), np.log(0.9), SHAPE))
        direct = white * np.where(rng.random(SHAPE) < 0.15, 0, rng.random(SHAPE))
        places = rng.uniform(0, 2 * self.patterns[0].pitch_px, (2, *SHAPE))
        seen = [contrast(one, places, self.footprint_px) for one in self.patterns]
        extrema = ExtremaSeparation((*SHAPE, 3))
        waves, slope = SinusoidSeparation((*SHAPE, 3)), CorrelationSeparation((*SHAPE, 3))
        sample = FrameSample(self.patterns)
        for pattern, one in zip(self.patterns, seen, strict=True):
            frame = self.sensor.expose(rng, white / 2 + direct / 2 * one)
            extrema.add(frame)
            waves.add(frame, pattern.phase)
            slope.add(frame, one)
            sample.add(frame, pattern)
        lit = self.sensor.expose(rng, white)
        variance = sample.noise_variance
        noise = self.sensor.noise if variance is None else noise_of([variance], lit, EVERYWHERE)
        swing = direct * np.ptp(seen, axis=0) / 2
        return Seen(white, direct, swing, lit, noise, extrema, waves, slope, sample)


@dataclass(frozen=True)
class Seen:
    white: Array
    direct: Array
    swing: Array
    lit: Image
    noise: FrameNoise
    extrema: ExtremaSeparation
    waves: SinusoidSeparation
    slope: CorrelationSeparation
    sample: FrameSample


def checkers(pitch_px: int, counts: tuple[int, int] = (6, 6)) -> tuple[Pattern, ...]:
    return tuple(Pattern(Family.CHECKER, pitch_px, *s) for s in shift_grid(pitch_px, counts))


def waves(family: Family, pitch_px: int, count: int) -> tuple[Pattern, ...]:
    return tuple(Pattern(family, pitch_px, 0, 2 * pitch_px * k // count) for k in range(count))


def assert_covers(estimate: Estimate, truth: Array, white: Array) -> None:
    """In each colour, and at dark and bright pixels and those with little direct light, if any."""
    held = np.abs(estimate.direct_light - truth[..., np.newaxis]) <= estimate.deviation
    some = {"dark": white < 0.08, "bright": white > 0.4, "hardly direct": truth < 0.1 * white}
    shares = {name: held[those].mean() for name, those in some.items() if those.any()}
    for name, share in {"all": held.mean(axis=(0, 1)), **shares}.items():
        assert np.all(share >= RATE - TOLERANCE), (name, share)
        assert np.all(share <= RATE + TOLERANCE), (name, share)


# Of full scale, at half light: 20 000 electrons 0.5 %, 1 300 electrons 2 %, 200 000 0.16 %.
CAMERA = Sensor(20_000, 5)


@pytest.mark.parametrize(
    "shot",
    [
        pytest.param(Shot(checkers(8), 3.0, CAMERA), id="finest pitch, half lit frames"),
        pytest.param(Shot(checkers(96), 3.0, CAMERA), id="coarsest pitch"),
        pytest.param(Shot(checkers(16), 3.0, Sensor(200_000, 20)), id="0.16 % noise"),
        pytest.param(Shot(checkers(16), 3.0, Sensor(1_300, 5)), id="2 % noise"),
        pytest.param(Shot(checkers(24, (4, 2)), 2.0, CAMERA), id="eight shifts"),
        pytest.param(Shot(waves(Family.STRIPES_COLUMNS, 24, 8), 2.0, CAMERA), id="stripes"),
    ],
)
def test_errors_of_corrected_extrema_cover_the_truth(shot: Shot) -> None:
    """Nothing but the frames is known: not the noise, nor the places, nor the footprint.

    Neighbours see different parts of the pattern, and what is measured around a pixel fits it only
    on average.
    """
    seen = shot.run()
    plain = seen.extrema.separate().direct_light
    correction = extrema_correction(len(shot.patterns))
    at = lattice(SHAPE)
    kinds = measured_kinds(seen.sample, seen.noise, EVERYWHERE[at], correction)
    estimate = extrema_estimate(plain, seen.lit, seen.noise, correction, kinds=kinds)
    assert_covers(estimate, seen.swing, seen.white)
    off = (estimate.direct_light - seen.swing[..., np.newaxis]) / estimate.deviation
    raw = (plain - seen.swing[..., np.newaxis]) / estimate.deviation
    assert abs(off.mean()) < 0.5
    assert raw.mean() > 1


@pytest.mark.parametrize("count", [3, 4, 5, 8])
def test_errors_of_sinusoids_cover_the_truth(count: int) -> None:
    """Of 3 and 5 shifts, none of which has a complement, the noise is that of a calibration."""
    shot = Shot(waves(Family.SINUSOID_COLUMNS, 24, count), 2.0, CAMERA)
    seen = shot.run()
    estimate = amplitude_estimate(
        seen.waves.separate().direct_light,
        seen.lit,
        seen.noise,
        [pattern.phase for pattern in shot.patterns],
    )
    damped = seen.direct * np.sinc(2 / 48) * np.sinc(0.5 / 24)
    assert_covers(estimate, damped, seen.white)


@pytest.mark.parametrize(
    "patterns",
    [
        pytest.param(checkers(8), id="36"),
        pytest.param(checkers(48, (4, 2)), id="8"),
        pytest.param(waves(Family.STRIPES_COLUMNS, 25, 5), id="5"),
        pytest.param(waves(Family.STRIPES_COLUMNS, 24, 4), id="4"),
        pytest.param(waves(Family.STRIPES_COLUMNS, 24, 3), id="3"),
    ],
)
def test_errors_of_correlation_with_known_places_cover_the_truth(
    patterns: tuple[Pattern, ...],
) -> None:
    seen = Shot(patterns, 3.0, CAMERA).run()
    estimate = seen.slope.estimate(seen.noise)
    assert_covers(estimate, seen.direct, seen.white)
    off = (estimate.direct_light - seen.direct[..., np.newaxis]) / estimate.deviation
    assert abs(off.mean()) < 0.02


@pytest.mark.parametrize("tilt", [0.0, 0.03], ids=["even", "tilted"])
@pytest.mark.parametrize("count", [3, 5])
def test_white_stands_in_for_missing_complements(count: int, tilt: float) -> None:
    """Some of eight shifts of stripes: max and min alone would miss pixels.

    Light that travelled over half a period tilts the plateaus by up to three times the noise.
    """
    patterns = waves(Family.STRIPES_COLUMNS, 24, 8)[:count]
    rng = np.random.default_rng(2)
    sigma, places = 0.01, rng.uniform(0, 48, (2, *SHAPE))
    direct = rng.uniform(0, 0.5, SHAPE)
    travelled = [Pattern(Family.SINUSOID_COLUMNS, 24, 0, one.shift_x_px) for one in patterns]
    light = np.stack(
        [
            0.25 + direct / 2 * contrast(one, places) + tilt * contrast(other, places)
            for one, other in zip(patterns, travelled, strict=True)
        ]
    )
    frames = light[..., np.newaxis] + rng.normal(0, sigma, (*light.shape, 3))
    extrema, sample = ExtremaSeparation((*SHAPE, 3)), FrameSample(patterns)
    for one, frame in zip(patterns, frames.astype(np.float32), strict=True):
        extrema.add(frame)
        sample.add(frame, one)
    lit = (0.5 + rng.normal(0, sigma, (*SHAPE, 3))).astype(np.float32)
    noise = FrameNoise(np.full(3, sigma**2), np.zeros(3))
    correction, at = extrema_correction(len(patterns), 1.0), lattice(SHAPE)
    kinds = measured_kinds(sample, noise, EVERYWHERE[at], correction, lit[at].astype(np.float64))
    estimate = extrema_estimate(
        extrema.separate(lit).direct_light, lit, noise, correction, kinds=kinds
    )
    truth = np.abs(2 * light - 0.5).max(axis=0)
    assert_covers(estimate, truth, np.full(SHAPE, 0.5))


@pytest.mark.parametrize("swing", [0.0, 0.5, 1.0, 2.0, 5.0, 20.0, 100.0])
@pytest.mark.parametrize(
    "contrasts",
    [
        pytest.param(np.array([1.0, -1.0]), id="a pair"),
        pytest.param(np.repeat([1.0, -1.0], 18), id="36 sharp"),
        pytest.param(np.sin(np.linspace(0.1, 6, 20)), id="known and all different"),
    ],
)
def test_intervals_hold_at_any_amount_of_light(contrasts: Array, swing: float) -> None:
    rng = np.random.default_rng(3)
    scaled = (2 * contrasts - contrasts.max() - contrasts.min()) / np.ptp(contrasts)
    frames = swing / 2 * scaled + rng.standard_normal((20_000, len(contrasts)))
    extrema = ExtremaSeparation((100, 200, 1))
    for frame in frames.T:
        extrema.add(frame.reshape(100, 200, 1).astype(np.float32))
    plain = extrema.separate().direct_light
    white, noise = np.zeros_like(plain), FrameNoise(np.ones(1), np.zeros(1))
    correction = Correction.of(contrasts)
    found = extrema_estimate(plain, white, noise, correction)
    assert np.mean(np.abs(found.direct_light - swing) <= found.deviation) == pytest.approx(
        RATE, abs=0.015
    )


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        pytest.param(2, 1.128, id="2"),
        pytest.param(10, 3.078, id="10"),
        pytest.param(25, 3.931, id="25"),
    ],
)
def test_the_mean_range_of_noise_is_that_of_control_charts(frames: int, expected: float) -> None:
    """d₂ of ISO 7870-2, to the digits that it prints."""
    _, mean = mean_extrema(np.linspace(-1, 1, frames))
    assert mean[0] == pytest.approx(expected, abs=6e-4)


def test_both_ways_to_the_mean_range_agree() -> None:
    contrasts = np.sin(np.linspace(0.1, 6, 20))
    one, other = mean_extrema(contrasts), mean_range(range_distribution(contrasts))
    np.testing.assert_allclose(one, other, atol=1e-5)


def test_the_median_of_a_pixel_without_light_is_none() -> None:
    for one in (amplitude_distribution, range_distribution(np.repeat([1.0, -1.0], 18))):
        table = IntervalTable.of([one])
        ratios = np.linspace(0, 12, 4000)
        median = ratios[np.searchsorted(one(ratios, np.zeros(4000)), 0.5)]
        assert table(np.array([median]))[0] == pytest.approx(0, abs=0.02)


def test_a_leak_is_undone_in_light_and_error() -> None:
    noise = FrameNoise(np.full(3, 1e-6), np.zeros(3))
    white, direct = np.ones((2, 2, 3), np.float32), np.full((2, 2, 3), 0.5, np.float32)
    correction = Correction.of(np.repeat([1.0, -1.0], 18))
    plain = extrema_estimate(direct, white, noise, correction)
    leaking = extrema_estimate(direct, white, noise, correction, leak=0.2)
    np.testing.assert_allclose(
        direct - leaking.direct_light, (direct - plain.direct_light) / 0.8, rtol=1e-4
    )
    np.testing.assert_allclose(leaking.deviation, plain.deviation / 0.8, rtol=1e-5)


@pytest.mark.parametrize("text", ["checker:6:3,2", "stripes-rows:6:1", "sinusoid-columns:6:2"])
def test_contrast_is_that_of_the_code(text: str) -> None:
    """In the centre of a projector pixel, and averaged over whole pixels."""
    pattern = Pattern.parse(text)
    code = 2 * pattern.code((24, 24)) - 1
    down, right = np.mgrid[:24, :24] + 0.5
    binary = pattern.family.is_binary
    tolerance = 1e-12 if binary else 1 - np.sinc(0.5 / 6) + 1e-12
    np.testing.assert_allclose(contrast(pattern, np.stack([down, right])), code, atol=tolerance)
    if binary:
        mean = (code[:23, :23] + code[1:, :23] + code[:23, 1:] + code[1:, 1:]) / 4
        seen = contrast(pattern, np.stack([down, right])[:, :23, :23] + 0.5, 2.0)
        np.testing.assert_allclose(seen, mean, atol=1e-12)


def test_what_does_not_fit_is_refused_by_both_shapes() -> None:
    image = np.zeros((4, 5, 3), np.float32)
    noise = FrameNoise(np.zeros(3), np.zeros(3))
    table = Correction.of(np.array([1.0, -1.0]))
    with pytest.raises(ValueError, match=r"\(4, 4, 3\).*\(4, 5, 3\)"):
        extrema_estimate(image[:, :4], image, noise, table)
    with pytest.raises(ValueError, match="one a colour"):
        extrema_estimate(image, image, FrameNoise(np.zeros(1), np.zeros(1)), table)
    with pytest.raises(ValueError, match="2 phases"):
        amplitude_estimate(image, image, noise, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"\[0, 1\)"):
        extrema_estimate(image, image, noise, table, leak=1.0)
    slope = CorrelationSeparation((4, 5, 3))
    with pytest.raises(ValueError, match=r"\(4, 5, 3\).*\(4, 4\)"):
        slope.add(image, np.zeros((4, 4)))
    with pytest.raises(ValueError, match="span 0"):
        Correction.of(np.ones(5))
