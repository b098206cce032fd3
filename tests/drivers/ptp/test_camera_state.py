"""What a camera tells of its card and of its picture quality before a shot."""

from __future__ import annotations

import struct
from dataclasses import replace

import pytest

from drivers.ptp.codes import CanonProperty, Property
from drivers.ptp.discovery import open_camera
from drivers.sim.clock import SimulatedClock
from drivers.sim.ptp_responder.body import Body, d4s, plain
from tests.drivers.ptp.benches import SETTINGS, bench, picture
from tests.drivers.ptp.canon_eos import CanonEos
from tests.drivers.ptp.usb_backend import Bus, ResponderPipe

FULL = "the card is full"
JPEG_FINE, RAW, RAW_AND_JPEG = 2, 4, 7


def named_plain() -> Body:
    """A body without Nikon's operations whose name still says what its numbers mean."""
    body = plain()
    return replace(body, info=replace(body.info, manufacturer="Nikon Corporation"))


@pytest.mark.parametrize("model", [d4s(), plain()], ids=["D4S", "plain"])
def test_a_full_card_is_said_before_the_shot(model: Body) -> None:
    at = bench(model=model, card_images=2)
    store = at.responder._body.store
    store.add(b"older", "image/jpeg", "", to_sdram=False)
    with at.open() as camera:
        state = camera.state()
        assert state.room is not None
        assert state.room.images == 1
        assert state.room.size_bytes == 16 << 30
        assert not any(FULL in warning for warning in state.warnings)
        store.add(b"older", "image/jpeg", "", to_sdram=False)
        assert any(FULL in warning for warning in camera.state().warnings)


def test_a_camera_without_a_card_tells_of_no_room() -> None:
    with bench(card_images=0).open() as camera:
        assert camera.state().room is None
        assert camera.state().warnings == ()
        camera.capture(SETTINGS)


def test_a_card_that_is_too_small_for_the_plan_is_said_where_pictures_stay_on_it() -> None:
    with bench(model=plain(), card_images=5).open() as camera:
        assert camera.state().shortage(5) == ()
        (shortage,) = camera.state().shortage(6)
        assert "5 more pictures and 6" in shortage
        camera.capture(SETTINGS)
        assert "4 more pictures and 5" in camera.state().shortage(5)[0]
    with bench(card_images=5).open() as camera:
        assert camera.state().shortage(6) == ()


@pytest.mark.parametrize("before", [JPEG_FINE, RAW_AND_JPEG, RAW])
def test_a_generic_cameras_quality_is_set_to_raw_where_its_number_is_known(before: int) -> None:
    at = bench(model=named_plain())
    at.responder.turn(Property.COMPRESSION, before)
    with at.open() as camera:
        assert at.number(Property.COMPRESSION) == RAW
        assert camera.state().takes_raw
        camera.capture(SETTINGS)
    assert at.number(Property.COMPRESSION) == before


def test_a_quality_that_only_its_maker_can_name_is_left_and_said() -> None:
    at = bench(model=plain())
    at.responder.turn(Property.COMPRESSION, JPEG_FINE)
    with at.open() as camera:
        state = camera.state()
        assert at.number(Property.COMPRESSION) == JPEG_FINE
    assert state.takes_raw is None
    assert any(f"number {JPEG_FINE}" in warning for warning in state.warnings)


@pytest.mark.parametrize(
    ("step", "percent"),
    [(0, 0), (5, 25), (1, 50), (4, 75), (2, 100), pytest.param(3, None, id="not known")],
)
def test_canons_battery(step: int, percent: int | None) -> None:
    clock = SimulatedClock()
    eos = CanonEos(picture(SETTINGS)[0], b"", clock)
    eos.values[CanonProperty.BATTERY_POWER] = struct.pack("<I", step)
    bus = Bus(ResponderPipe(eos, clock), vendor=0x04A9, product=0x3218)
    with open_camera(None, clock, bus) as camera:
        state = camera.state()
    assert state.battery_percent == percent
    assert any("battery" in warning for warning in state.warnings) == (percent == 0)
