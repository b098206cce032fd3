from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from drivers.clock import SystemClock
from drivers.errors import ProjectorError
from drivers.window import WindowProjector
from drivers.xserver import list_monitors
from processing.patterns import Pattern
from tests.screens.desk import Desk

PATTERNS = (
    "white",
    "black",
    "checker:1",
    "checker:8:3,5",
    "checker:96:0,17",
    "stripes-columns:1",
    "stripes-columns:12:5",
    "stripes-rows:7:3",
    "sinusoid-columns:40:11",
    "sinusoid-rows:33:2",
)


def test_every_pattern_is_on_the_projector_pixel_for_pixel(desk_of_each_size: Desk) -> None:
    desk = desk_of_each_size
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    assert projector.resolution == desk.projector_px
    for text in PATTERNS:
        raster = Pattern.parse(text).raster(projector.resolution)
        projector.show(raster)
        seen = desk.photograph()
        assert np.array_equal(desk.projector_screen(seen), np.dstack([raster] * 3)), text
        assert not desk.operator_screen(seen).any(), text
    projector.close()
    assert not desk.photograph().any()


def test_every_color_value_is_kept(desk_of_each_size: Desk) -> None:
    desk = desk_of_each_size
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    raster = np.random.default_rng(5).integers(0, 256, (*projector.resolution, 3), np.uint8)
    assert all(len(np.unique(raster[..., channel])) == 256 for channel in range(3))
    projector.show(raster)
    assert np.array_equal(desk.projector_screen(desk.photograph()), raster)
    projector.close()


def test_a_grey_raster_after_a_color_one_and_back(desk_of_each_size: Desk) -> None:
    desk = desk_of_each_size
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    height, width = projector.resolution
    red = np.zeros((height, width, 3), np.uint8)
    red[..., 0] = 200
    grey = np.full((height, width), 77, np.uint8)
    for raster, expected in ((red, red), (grey, np.dstack([grey] * 3)), (red, red)):
        projector.show(raster)
        assert np.array_equal(desk.projector_screen(desk.photograph()), expected)
    projector.close()


def test_the_monitors_are_listed_with_size_place_and_rate(desk_of_each_size: Desk) -> None:
    operator, projector = list_monitors()
    height, width = desk_of_each_size.projector_px
    assert (operator.connector, operator.primary) == ("DUMMY0", True)
    assert (operator.size_px, operator.position_px) == ((1080, 1920), (0, 0))
    assert (projector.connector, projector.primary) == ("DUMMY1", False)
    assert (projector.size_px, projector.position_px) == ((height, width), (0, 1920))
    assert 59 < projector.refresh_hz < 61
    assert projector.exact


def test_another_raster_is_refused_and_the_projector_goes_on(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    for wrong in (
        np.zeros((800, 1281), np.uint8),
        np.zeros((1280, 800), np.uint8),
        np.zeros((800, 1280, 4), np.uint8),
        np.zeros((800, 1280), np.float64),
    ):
        with pytest.raises(ValueError, match="raster"):
            projector.show(wrong)  # type: ignore[arg-type]  # one of them is no raster at all
    projector.show(np.full((800, 1280), 255, np.uint8))
    assert (desk.projector_screen(desk.photograph()) == 255).all()
    projector.close()


def test_what_is_not_contiguous_is_shown_as_it_is_indexed(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    raster = np.random.default_rng(3).integers(0, 256, (1280, 800), np.uint8).T[:, ::-1]
    projector.show(raster)
    seen = desk.projector_screen(desk.photograph())
    assert np.array_equal(seen, np.dstack([raster] * 3))
    projector.close()


def test_closed_is_closed(desk: Desk) -> None:
    projector = WindowProjector(None, 0.0, SystemClock())
    projector.close()
    projector.close()
    with pytest.raises(ProjectorError, match="closed"):
        projector.show(np.zeros(desk.projector_px, np.uint8))


def test_a_picture_is_held_until_told_to_stop(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 0.0, SystemClock())
    projector.show(np.full(projector.resolution, 255, np.uint8))
    stop = threading.Event()
    seen = []

    def look_and_stop() -> None:
        seen.append(desk.photograph())
        stop.set()

    threading.Timer(0.2, look_and_stop).start()
    projector.hold(None, stop)
    projector.close()
    assert (desk.projector_screen(seen[0]) == 255).all()


def test_the_light_settles_before_show_returns(desk: Desk) -> None:
    projector = WindowProjector("DUMMY1", 0.3, SystemClock())
    raster = np.full(desk.projector_px, 255, np.uint8)
    for _ in range(2):
        started_s = time.monotonic()
        projector.show(raster)
        assert time.monotonic() - started_s >= 0.3
    projector.close()
