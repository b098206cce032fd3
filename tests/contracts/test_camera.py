"""What every camera does (see `drivers.protocols.Camera`)."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from drivers.errors import CameraError, DriverError
from drivers.raw import decode_raw
from tests.contracts.benches import CAMERAS, CameraCase


@pytest.fixture(params=CAMERAS)
def case(request: pytest.FixtureRequest) -> Iterator[CameraCase]:
    case = CAMERAS[request.param]()
    yield case
    case.camera.close()


def test_settings_are_read_back_as_asked(case: CameraCase) -> None:
    assert case.camera.capture(case.settings).settings == case.settings


def test_the_file_decodes(case: CameraCase) -> None:
    frame = case.camera.capture(case.settings)
    assert frame.media_type.startswith("image/")
    image = decode_raw(frame.data)
    assert image.values.shape == (*case.image_px, 3)
    assert image.saturated.shape == case.image_px


def test_a_frame_takes_at_least_its_exposure(case: CameraCase) -> None:
    frame = case.camera.capture(case.settings)
    assert frame.finished_s - frame.started_s >= case.settings.exposure_s - 1e-6


def test_frames_follow_one_another(case: CameraCase) -> None:
    first, second = (case.camera.capture(case.settings) for _ in range(2))
    assert second.started_s >= first.finished_s


def test_settings_that_it_does_not_have_are_refused_and_it_goes_on(case: CameraCase) -> None:
    with pytest.raises(DriverError):
        case.camera.capture(case.refused)
    assert case.camera.capture(case.settings).settings == case.settings


def test_it_can_be_closed_twice_and_captures_nothing_after(case: CameraCase) -> None:
    case.camera.close()
    case.camera.close()
    with pytest.raises(CameraError):
        case.camera.capture(case.settings)
