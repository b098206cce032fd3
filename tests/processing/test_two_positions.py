"""Stripes in two positions: places from a binary code, and ranges of light from one difference."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from processing.frames.gathering import HarmonicsStack
from processing.frames.harmonics import PitchDesign
from processing.metrics import relative_error
from processing.patterns import Family, Pattern
from processing.ranges.two_positions.binary_code import binary_codes, relative_to
from processing.ranges.two_positions.code_waves import CodeWaves
from processing.ranges.two_positions.decomposition import decompose_pairs
from tests.processing.light import PROJECTOR_PX, Scene, slanted

SHAPE = (48, 56)
EVERYWHERE = np.ones(SHAPE, bool)
OCTAVES = (2, 4, 8, 16, 32, 64, 128)
BOTH = (Family.STRIPES_ROWS, Family.STRIPES_COLUMNS)
SCALE = 1.1


def pairs(
    pitches_px: tuple[int, ...] = OCTAVES, families: tuple[Family, ...] = BOTH
) -> list[Pattern]:
    return [
        Pattern(family, pitch_px, *((shift, 0) if family.varies_down else (0, shift)))
        for pitch_px in pitches_px
        for family in families
        for shift in (0, pitch_px)
    ]


def stepped() -> NDArray[np.float64]:
    """Two planes, 40 projector pixels apart, with a depth edge between two columns."""
    places = slanted(SHAPE, SCALE)
    places[1, :, 30:] += 40
    return places


def scene(places_px: NDArray[np.float64] | None = None, blur_px: float = 0.6) -> Scene:
    ones = np.ones((*SHAPE, 3)) * np.array([1.0, 0.7, 0.4])
    places = slanted(SHAPE, SCALE) if places_px is None else places_px
    return Scene(places, {0.0: 0.5 * ones, 32.0: 0.1 * ones, np.inf: 0.2 * ones}, blur_px)


def gathered(light: Scene, patterns: list[Pattern], noise: float = 1e-3) -> HarmonicsStack:
    rng = np.random.default_rng(0)
    stack = HarmonicsStack(patterns, light.white.shape, PROJECTOR_PX)
    for pattern in patterns:
        frame = light.frame(pattern)
        stack.add((frame + rng.normal(0, noise, frame.shape)).astype(np.float32), pattern)
    return stack


def test_difference_of_a_pair_is_the_wave_at_the_place() -> None:
    """Direct light alone, in the middle of every projector pixel."""
    at = np.arange(0.0, 64.0)
    places = np.stack([np.zeros((1, at.size)), at[np.newaxis]])
    light = Scene(places, {0.0: np.ones((1, at.size, 1))}, blur_px=2.0)
    designs = [PitchDesign.of(pairs((16,), (Family.STRIPES_COLUMNS,)))]
    # Samples of a Gaussian smooth as one does whose variance is that of a projector pixel less.
    waves = CodeWaves.of(designs, [0.0], 4.0 - 1 / 12)
    one, other = (light.frame(pattern)[0, :, 0] for pattern in designs[0].patterns)
    # The middle of pixel 0 of the raster is at ½ there, and at 0 here; bins are a quarter apart.
    np.testing.assert_allclose(one - other, np.tile(waves.wave[2:-1:4, 0], 2), atol=2e-3)


@pytest.mark.parametrize("shift_px", [0, 5])
def test_second_pattern_may_be_the_complement_at_any_shift(shift_px: int) -> None:
    """The wave begins where the first pattern does."""
    patterns = [Pattern(Family.STRIPES_COLUMNS, 8, 0, shift_px + k * 8) for k in (0, 1)]
    design = PitchDesign.of(patterns)
    assert design.is_pair
    wave = CodeWaves.of([design], [0.0], 0.01).wave[:, 0]
    code = 2 * patterns[0].code((1, 16))[0] - 1
    # In the middle of every projector pixel.
    np.testing.assert_allclose(wave[2:-1:4], code, atol=1e-5)


@pytest.mark.parametrize(
    "patterns",
    [
        pytest.param([Pattern(Family.CHECKER, 8, k, 0) for k in (0, 8)], id="checkers"),
        pytest.param([Pattern(Family.STRIPES_ROWS, 8, k, 0) for k in (0, 5)], id="no-complement"),
    ],
)
def test_other_pairs_of_frames_are_refused(patterns: list[Pattern]) -> None:
    with pytest.raises(ValueError, match="unknowns of a pixel"):
        PitchDesign.of(patterns)


def test_pairs_and_more_positions_are_not_mixed() -> None:
    more = [Pattern(Family.STRIPES_ROWS, 24, k, 0) for k in (0, 12, 24, 36)]
    with pytest.raises(ValueError, match=r"stripes-columns:8 has two positions, other pitches"):
        HarmonicsStack([*pairs((8,)), *more], (4, 4, 1), PROJECTOR_PX)


def decoded(light: Scene, families: tuple[Family, ...]) -> list[NDArray[np.float32] | None]:
    """Places down and right, pixel centres at whole numbers."""
    stack = gathered(light, pairs(families=families))
    differences = stack.differences(slice(0, SHAPE[0])).sum(axis=-1)
    relative = relative_to(stack.white().sum(axis=-1), differences)
    waves = CodeWaves.of(stack.designs, np.zeros(1), light.blur_px**2 + 0.1, SCALE)
    codes = binary_codes(waves, relative.reshape(len(relative), -1), PROJECTOR_PX)
    noise = np.full(SHAPE, 1e-5, np.float32)
    return [
        None if code is None
        else code.decoded(relative[code.chosen], EVERYWHERE, noise).places_px - np.float32(0.5)
        for code in codes
    ]  # fmt: skip


@pytest.mark.parametrize(
    "families", [BOTH, BOTH[:1], BOTH[1:]], ids=["both", "rows-alone", "columns-alone"]
)
def test_places_are_found_to_a_tenth_of_a_pixel_up_to_depth_edges(
    families: tuple[Family, ...],
) -> None:
    """Under light from elsewhere, blur and noise; what no stripes tell is not made up."""
    light = scene(stepped())
    for axis, found in enumerate(decoded(light, families)):
        if BOTH[axis] not in families:
            assert found is None
            continue
        assert found is not None
        off = np.abs(found - light.places_px[axis])
        assert np.median(off) < 0.03
        assert np.percentile(off, 98) < 0.1


def test_light_of_range_zero_is_direct_and_the_rest_is_not() -> None:
    """Far nearer than the best single pitch, whose edges of stripes are half lit."""
    light = scene()
    stack = gathered(light, pairs())
    found = decompose_pairs(stack, EVERYWHERE)
    truth, white = light.parts[0.0].astype(np.float32), light.white.astype(np.float32)
    singles = np.abs(stack.differences(slice(0, SHAPE[0])))
    assert found.names == ("direct", "interreflection")
    error = relative_error(found.components[0], truth, EVERYWHERE)
    assert error < 0.03
    assert error < 0.2 * min(relative_error(one, truth, EVERYWHERE) for one in singles)
    assert relative_error(found.components[1], white - truth, EVERYWHERE) < 0.06
    np.testing.assert_allclose(found.components.sum(axis=0), found.white, atol=1e-6)
    off = np.abs(found.components[0] - truth)
    assert np.mean(off <= found.deviations[0]) > 0.6


def test_errors_stay_finite_where_noise_leaves_a_colour_less_than_no_light() -> None:
    """Its errors are no larger than those of colours with light."""
    light = scene()
    for part in light.parts.values():
        part[..., 2] = 0
    found = decompose_pairs(gathered(light, pairs()), EVERYWHERE)
    assert (found.white[..., 2] < 0).any()
    assert np.isfinite(found.deviations).all()
    assert found.components.min() >= 0
    assert found.deviations[..., 2].max() < found.deviations[..., 0].max()


def test_direct_light_at_a_depth_edge_is_that_of_both_surfaces() -> None:
    """Pixels of one column see half of either side."""
    near, far = slanted(SHAPE, SCALE), stepped()
    parts = scene().parts
    halves = [
        Scene(one, {spread: 0.5 * light for spread, light in parts.items()}, 0.6)
        for one in (near, far)
    ]
    whole = scene(far)
    patterns = pairs()
    stack = HarmonicsStack(patterns, whole.white.shape, PROJECTOR_PX)
    for pattern in patterns:
        frame = whole.frame(pattern)
        mixed = sum(half.frame(pattern) for half in halves)
        shifted = halves[1].frame(pattern) + halves[0].frame(pattern)
        frame[:, 29] = np.where(np.isfinite(mixed), shifted, 0)[:, 30]
        stack.add(frame, pattern)
    found = decompose_pairs(stack, EVERYWHERE)
    truth = whole.parts[0.0][:, 29]
    assert np.mean(np.abs(found.components[0][:, 29] - truth)) < 0.1 * truth.mean()


def test_diffusion_is_recognised_where_it_is() -> None:
    """The right half scatters below its surface as diffusion does, the left half is opaque."""
    ones = np.ones((*SHAPE, 3))
    right = np.zeros(SHAPE)[..., np.newaxis] + (np.arange(SHAPE[1]) >= SHAPE[1] // 2)[:, np.newaxis]
    near = {1.0: 0.06, 3.0: 0.12, 6.0: 0.16, 12.0: 0.16}
    parts = {spread: share * right * ones for spread, share in near.items()}
    parts[0.0] = ones - np.sum(list(parts.values()), axis=0)
    light = Scene(slanted(SHAPE, 2.5), parts, 0.8)
    found = decompose_pairs(gathered(light, pairs()), EVERYWHERE)
    assert found.names == ("direct", "subsurface", "interreflection")
    inside, outside = found.translucent[:, 32:].mean(), found.translucent[:, :24].mean()
    assert inside > 0.9
    assert outside < 0.05


def test_a_gray_code_is_recognised_behind_the_shifts_of_a_binary_one() -> None:
    """Stripes shown half a pitch on, announced without: what many scanners show and tables say."""
    light = scene()
    announced = pairs()
    stack = HarmonicsStack(announced, light.white.shape, PROJECTOR_PX)
    rng = np.random.default_rng(0)
    for pattern in announced:
        on, down = pattern.pitch_px // 2, pattern.family.varies_down
        shift = (pattern.shift_y_px + on * down, pattern.shift_x_px + on * (not down))
        frame = light.frame(Pattern(pattern.family, pattern.pitch_px, *shift))
        stack.add((frame + rng.normal(0, 1e-3, frame.shape)).astype(np.float32), pattern)
    found = decompose_pairs(stack, EVERYWHERE)
    assert any("Gray code" in one.what for one in found.warnings)
    truth = light.parts[0.0].astype(np.float32)
    assert relative_error(found.components[0], truth, EVERYWHERE) < 0.03


def test_frames_of_no_code_are_told() -> None:
    """Every pitch shown at a shift of its own, which the session does not know."""
    light = scene()
    announced = pairs()
    stack = HarmonicsStack(announced, light.white.shape, PROJECTOR_PX)
    for pattern in announced:
        on, down = pattern.pitch_px * 7 // 10, pattern.family.varies_down
        on += pattern.pitch_px // 4 * (pattern.pitch_px in {8, 32})
        shift = (pattern.shift_y_px + on * down, pattern.shift_x_px + on * (not down))
        stack.add(light.frame(Pattern(pattern.family, pattern.pitch_px, *shift)), pattern)
    found = decompose_pairs(stack, EVERYWHERE)
    assert any("may show other patterns" in one.meaning for one in found.warnings)
    sound = decompose_pairs(gathered(light, announced), EVERYWHERE)
    assert not any("may show other patterns" in one.meaning for one in sound.warnings)


def test_pitches_that_are_not_resolved_are_left_out_and_said() -> None:
    found = decompose_pairs(gathered(scene(blur_px=2.5), pairs()), EVERYWHERE)
    (said,) = (one for one in found.warnings if "left out" in one.what)
    assert said.what.startswith("stripes-columns:2, stripes-rows:2")
    truth = scene().parts[0.0]
    assert relative_error(found.components[0], truth.astype(np.float32), EVERYWHERE) < 0.06


@pytest.mark.parametrize(
    ("patterns", "mask", "said"),
    [
        pytest.param(pairs((8, 16)), EVERYWHERE, "fewer than 3 pitches", id="two-pitches"),
        pytest.param(pairs(), ~EVERYWHERE, "leaves no pixel", id="nothing-usable"),
        pytest.param(pairs(), EVERYWHERE[:4], r"\(4, 56\).*\(48, 56, 3\)", id="shapes"),
    ],
)
def test_what_is_no_code_is_refused(
    patterns: list[Pattern], mask: NDArray[np.bool_], said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        decompose_pairs(gathered(scene(), patterns), mask)
