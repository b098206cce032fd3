from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from drivers.errors import ReplayError
from drivers.protocols import CameraSettings, RawFrame
from drivers.raster import raster_digest
from drivers.sim.replay import ReplayCamera, ReplayProjector

SETTINGS = CameraSettings(0.1, 8.0, 200)
RASTERS = [np.full((2, 3), value, np.uint8) for value in (0, 128, 255)]


def frame(text: str) -> RawFrame:
    return RawFrame(text.encode(), "image/x-adobe-dng", SETTINGS, 0.0, 1.0)


def replay(*recorded: tuple[int, str]) -> tuple[ReplayProjector, ReplayCamera]:
    projector = ReplayProjector((2, 3))
    pairs = [(raster_digest(RASTERS[index]), partial(frame, text)) for index, text in recorded]
    return projector, ReplayCamera(projector, pairs)


def test_frames_of_a_raster_that_repeats_come_in_the_order_of_the_recording() -> None:
    projector, camera = replay((0, "a"), (1, "b"), (0, "c"), (1, "d"))
    handed_over = []
    for index in (1, 0, 0, 1):
        projector.show(RASTERS[index])
        handed_over.append(camera.capture(SETTINGS).data)
    assert handed_over == [b"b", b"a", b"c", b"d"]


def test_a_raster_that_was_not_recorded_is_refused() -> None:
    projector, camera = replay((0, "a"))
    projector.show(RASTERS[2])
    with pytest.raises(ReplayError, match="no frame for this raster"):
        camera.capture(SETTINGS)


def test_more_frames_than_were_recorded_are_refused() -> None:
    projector, camera = replay((0, "a"))
    projector.show(RASTERS[0])
    camera.capture(SETTINGS)
    with pytest.raises(ReplayError, match=r"1 frame\(s\).*all have been handed over"):
        camera.capture(SETTINGS)


def test_other_settings_are_refused_and_both_are_named() -> None:
    projector, camera = replay((0, "a"))
    projector.show(RASTERS[0])
    with pytest.raises(ReplayError, match=r"exposure_s=0\.1.*exposure_s=0\.2"):
        camera.capture(CameraSettings(0.2, 8.0, 200))
    assert camera.capture(SETTINGS).data == b"a"


def test_nothing_is_captured_before_something_is_shown() -> None:
    _, camera = replay((0, "a"))
    with pytest.raises(ReplayError, match="nothing has been shown"):
        camera.capture(SETTINGS)


def test_a_recording_is_read_frame_by_frame() -> None:
    projector = ReplayProjector((2, 3))
    read: list[str] = []

    def reader(text: str) -> RawFrame:
        read.append(text)
        return frame(text)

    pairs = [(raster_digest(RASTERS[0]), partial(reader, text)) for text in "ab"]
    camera = ReplayCamera(projector, pairs)
    projector.show(RASTERS[0])
    assert not read
    camera.capture(SETTINGS)
    assert read == ["a"]
