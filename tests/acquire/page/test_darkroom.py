from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from acquire.page.chart import focus_chart, shown_raster
from acquire.page.darkroom import (
    BINS,
    CLIPPED,
    SCREEN_PX,
    UNLIT,
    Negative,
    Print,
    negative,
    printed,
)
from acquire.plan import ProjectorPlan
from drivers.protocols import CameraSettings
from drivers.raw import decode_raw
from drivers.sim.devices import SimulationConfig, build
from processing.patterns import Pattern


def opened(file: bytes) -> NDArray[np.uint8]:
    pixels = np.asarray(cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_UNCHANGED), np.uint8)
    return pixels[..., ::-1] if pixels.ndim == 3 else pixels


def srgb(linear: NDArray[np.float32]) -> NDArray[np.float64]:
    clipped = np.clip(linear.astype(np.float64), 0, 1)
    curve = 1.055 * clipped ** (1 / 2.4) - 0.055
    return 255 * np.where(clipped <= 0.0031308, 12.92 * clipped, curve)


def simulated(exposure_s: float = 0.1) -> tuple[bytes, Negative]:
    bench = build(SimulationConfig("corner", 3, (32, 48), (72, 96)))
    bench.projector.show(Pattern.parse("white").raster((72, 96)))
    data = bench.camera.capture(CameraSettings(exposure_s, 8.0, 200)).data
    return data, negative("image/x-adobe-dng", data)


def test_what_is_shown_is_the_frame_through_the_srgb_curve() -> None:
    data, picture = simulated()
    shown = printed(picture, None)
    assert shown.media_type == "image/png"
    expected = srgb(decode_raw(data).values)
    # Half a code of rounding and as much of the table's steps.
    assert np.abs(opened(shown.image) - expected).max() <= 1


def test_a_part_is_shown_pixel_for_pixel() -> None:
    _, picture = simulated()
    whole, part = printed(picture, None), printed(picture, (5, 7, 20, 11))
    assert part.box == (5, 7, 20, 11)
    np.testing.assert_array_equal(opened(part.image), opened(whole.image)[7:18, 5:25])


@pytest.mark.parametrize(
    ("wanted", "box"),
    [
        pytest.param((40, 30, 65536, 65536), (40, 30, 8, 2), id="too large"),
        pytest.param((65536, 65536, 9, 9), (47, 31, 1, 1), id="outside"),
        pytest.param((0, 0, 0, 0), (0, 0, 1, 1), id="nothing"),
    ],
)
def test_any_part_that_is_asked_for_lies_inside(
    wanted: tuple[int, int, int, int], box: tuple[int, int, int, int]
) -> None:
    _, picture = simulated()
    assert printed(picture, wanted).box == box


def test_clipped_pixels_are_counted_and_marked() -> None:
    data, picture = simulated(exposure_s=0.2)
    saturated = decode_raw(data).saturated
    assert 0 < saturated.mean() < 1
    shown = printed(picture, None)
    assert shown.clipped == pytest.approx(saturated.mean())
    np.testing.assert_array_equal(opened(shown.marks) == CLIPPED, saturated)


def reduced(values: NDArray[np.float32], marks: NDArray[np.uint8]) -> Print:
    return printed(Negative(values, marks), None)


def test_one_clipped_pixel_in_millions_still_shows() -> None:
    values = np.full((2000, 3000, 3), 0.3, np.float32)
    marks = np.zeros((2000, 3000), np.uint8)
    marks[1234, 2345] = CLIPPED
    shown = reduced(values, marks)
    small = opened(shown.marks)
    assert max(small.shape) == SCREEN_PX
    places = np.argwhere(small == CLIPPED)
    assert 1 <= len(places) <= 4
    assert np.abs(places.mean(axis=0) * shown.reduced - (1234, 2345)).max() < 2 * shown.reduced


def test_unlit_is_what_results_call_so() -> None:
    values = np.full((20, 20, 3), 0.5, np.float32)
    values[:5] = 0.004
    tiff = cv2.imencode(".tiff", values[..., ::-1])[1].tobytes()
    picture = negative("image/tiff", tiff)
    assert (picture.marks[:5] == UNLIT).all()
    assert not picture.marks[5:].any()


def test_the_histogram_counts_every_pixel_of_a_small_picture() -> None:
    values = np.zeros((10, 10, 3), np.float32)
    values[..., 0], values[..., 1], values[..., 2] = 1.0, 0.5, -0.1
    shown = reduced(values, np.zeros((10, 10), np.uint8))
    assert [np.flatnonzero(counts).tolist() for counts in shown.histogram] == [
        [BINS - 1],
        [BINS // 2],
        [0],
    ]
    assert [sum(counts) for counts in shown.histogram] == [100, 100, 100]
    assert shown.mean == pytest.approx((1.0, 0.5, -0.1))


@pytest.mark.parametrize("resolution", [(48, 64), (1080, 1920), (768, 1024)])
def test_the_chart_reaches_every_edge_and_has_single_pixels(resolution: tuple[int, int]) -> None:
    chart = focus_chart(resolution)
    assert chart.shape == resolution
    assert set(np.unique(chart)) == {0, 255}
    frame = [chart[0], chart[-1], chart[:, 0], chart[:, -1]]
    assert all((side == 255).all() for side in frame)
    top = chart[: resolution[0] // 3]
    assert (np.abs(np.diff(top.astype(int), axis=1)).sum(axis=1) > 0).any()
    alternating = top[:, :-2].astype(int) - 2 * top[:, 1:-1] + top[:, 2:]
    assert (np.abs(alternating) == 510).any()


@pytest.mark.parametrize("what", ["", "checker", "checker:0", "checker:" + "9" * 40, "../white"])
def test_what_is_no_pattern_is_refused(what: str) -> None:
    with pytest.raises(ValueError, match=r"pattern|pitch|at most"):
        shown_raster(what, (48, 64), ProjectorPlan())
