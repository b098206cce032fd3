"""The camera against the simulated body over pyusb: settings, shots, everything that goes wrong."""

from __future__ import annotations

import errno

import pytest

from drivers.errors import CameraError, CameraTimeoutError, SettingsError
from drivers.protocols import CameraSettings
from drivers.ptp.codes import (
    ContainerType,
    NikonEvent,
    NikonOperation,
    NikonProperty,
    Property,
    ResponseCode,
)
from drivers.ptp.discovery import open_camera
from drivers.ptp.transaction import Event
from drivers.ptp.vendor_events import encode_nikon_events
from drivers.ptp.wire import Container
from drivers.sim.clock import SimulatedClock
from drivers.sim.ptp_responder.answer import Output
from drivers.sim.ptp_responder.body import plain
from drivers.sim.ptp_responder.responder import Responder
from tests.drivers.ptp.benches import SETTINGS, bench, picture
from tests.drivers.ptp.usb_backend import Bus, ResponderPipe, usb_error

EXPECTED, _ = picture(SETTINGS)


def test_a_shot_is_the_bodys_file_and_control_is_given_back() -> None:
    at = bench()
    quality_of_the_owner = 0
    at.responder.turn(Property.COMPRESSION, quality_of_the_owner)
    with at.open() as camera:
        assert at.responder.is_remote
        frame = camera.capture(SETTINGS)
    assert frame.data == EXPECTED
    assert frame.settings == SETTINGS
    assert frame.media_type == "image/x-adobe-dng"
    assert not at.responder.is_remote
    assert not at.responder.is_open
    assert not at.bus.is_claimed
    assert at.number(Property.COMPRESSION) == quality_of_the_owner
    assert at.number(NikonProperty.RECORDING_MEDIA) == 0


def test_it_says_who_it_is_and_how_it_stands() -> None:
    at = bench()
    with at.open() as camera:
        assert (camera.device.manufacturer, camera.device.model) == ("Nikon Corporation", "D4S")
        state = camera.state()
    assert state.battery_percent == 80
    assert state.is_manual_exposure
    assert state.is_manual_focus
    assert state.takes_raw
    assert state.settings == SETTINGS
    assert state.warnings == ()


@pytest.mark.parametrize(
    ("code", "value", "warning"),
    [
        pytest.param(Property.EXPOSURE_PROGRAM, 2, "mode dial", id="mode P"),
        pytest.param(Property.FOCUS_MODE, 0x8010, "autofocus", id="lever on AF"),
        pytest.param(Property.BATTERY_LEVEL, 12, "12 %", id="battery low"),
    ],
)
def test_what_a_person_should_change_is_said(code: int, value: int, warning: str) -> None:
    at = bench()
    at.responder.turn(NikonProperty.AF_MODE, 0)
    at.responder.turn(code, value)
    with at.open() as camera:
        assert any(warning in text for text in camera.state().warnings)


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param(CameraSettings(1 / 30, 5.6, 100), id="1/30"),
        pytest.param(CameraSettings(1 / 3, 16.0, 3200), id="1/3"),
        pytest.param(CameraSettings(1 / 8000, 8.0, 200), id="1/8000"),
        pytest.param(CameraSettings(1.3, 8.0, 200), id="1.3 s"),
        pytest.param(CameraSettings(30.0, 22.0, 50), id="30 s"),
        pytest.param(CameraSettings(0.1, None, None), id="time only"),
    ],
)
@pytest.mark.parametrize("model", [pytest.param(None, id="D4S"), pytest.param(plain(), id="plain")])
def test_settings_are_set_and_read_back(settings: CameraSettings, model: object) -> None:
    at = bench(model=model)  # type: ignore[arg-type]
    with at.open() as camera:
        frame = camera.capture(settings)
        found = camera.state().settings
    assert frame.settings == settings
    assert found is not None
    assert found.exposure_s == pytest.approx(settings.exposure_s, rel=0, abs=1e-4)
    assert found.aperture == (settings.aperture or 8.0)
    assert found.iso == (settings.iso or 200)
    assert frame.finished_s - frame.started_s >= settings.exposure_s


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        pytest.param(CameraSettings(0.11, 8.0, 200), ["1/10", "1/8"], id="time"),
        pytest.param(CameraSettings(90.0, 8.0, 200), ["30 s", "25 s"], id="longer than any"),
        pytest.param(CameraSettings(0.1, 8.5, 200), ["f/8", "f/9"], id="aperture"),
        pytest.param(CameraSettings(0.1, 8.0, 210), ["200", "250"], id="ISO"),
    ],
)
def test_values_that_it_does_not_have_are_refused_with_the_nearest(
    settings: CameraSettings, named: list[str]
) -> None:
    at = bench()
    with at.open() as camera:
        with pytest.raises(SettingsError) as caught:
            camera.capture(settings)
        assert all(text in str(caught.value) for text in named)
        assert camera.capture(SETTINGS).data == EXPECTED


def test_in_mode_p_it_says_to_turn_the_dial() -> None:
    at = bench()
    at.responder.turn(Property.EXPOSURE_PROGRAM, 2)
    with at.open() as camera:
        assert camera.capture(SETTINGS).data == EXPECTED  # nothing needs to be changed
        with pytest.raises(SettingsError, match="set the mode dial to M"):
            camera.capture(CameraSettings(0.2, 8.0, 200))


@pytest.mark.parametrize(
    "wrong",
    [
        "busy@9207*3",
        "busy=A200@90C8*5",
        "busy=A004@9207*2",
        "stall@1009",
        "stall@1015",
        "stall@90C7",
        "stale-answer@9207",
        "stale-answer@1009",
        "stale-answer@1002",
        "cut-object",
        "cut-object*2",
        "lost-event",
        "lost-object-event",
        "lost-completion",
        "completion-first",
        "zero-handle",
        "odd-event",
        "busy=2006@9207",
    ],
)
def test_faults_of_which_the_program_need_not_know(wrong: str) -> None:
    at = bench(wrong)
    with at.open() as camera:
        for _ in range(2):
            assert camera.capture(SETTINGS).data == EXPECTED
    assert not at.responder.is_remote


@pytest.mark.parametrize(
    "wrong",
    [
        "timeout@9207",
        "timeout@1009",
        "wrong-transaction@9207",
        "wrong-transaction@1009",
        "stall@9207",
        "sleep@9207",
        "garbage@1009",
        "garbage@90C7+1",
        "cut-object*3",
    ],
)
def test_after_a_lost_shot_the_next_try_succeeds(wrong: str) -> None:
    at = bench(wrong)
    with at.open() as camera:
        with pytest.raises(CameraTimeoutError):
            camera.capture(SETTINGS)
        frame = camera.capture(CameraSettings(0.2, 8.0, 200))
        assert frame.data == picture(CameraSettings(0.2, 8.0, 200))[0]
    assert not at.responder.is_remote
    assert not at.responder.is_open


@pytest.mark.parametrize(
    ("wrong", "advice"),
    [
        pytest.param("busy=A002@9207", "switch lens and body to M", id="out of focus"),
        pytest.param("busy=A002@90C8+1", "switch lens and body to M", id="out of focus, later"),
        pytest.param("busy=A008@9207", "mode dial", id="bulb"),
        pytest.param("busy=A009@9207", "MUP", id="mirror up"),
        pytest.param("busy=200C@9207", "full", id="store full"),
        pytest.param("busy=2013@9207", "no card", id="no card"),
        pytest.param("busy=2019@9207*999", "stays busy", id="busy for ever"),
    ],
)
def test_what_needs_a_person_stops_with_advice(wrong: str, advice: str) -> None:
    at = bench(wrong)
    with at.open() as camera:
        with pytest.raises(CameraError, match=advice) as caught:
            camera.capture(SETTINGS)
        assert not isinstance(caught.value, CameraTimeoutError)
    assert not at.responder.is_remote


def test_a_picture_that_nobody_fetched_does_not_block_the_next() -> None:
    at = bench("timeout@90C7+1", "lost-event+1")
    with at.open() as camera:
        with pytest.raises(CameraTimeoutError):
            camera.capture(SETTINGS)
        longer = CameraSettings(0.2, 8.0, 200)
        assert camera.capture(longer).data == picture(longer)[0]


class MirrorUp(Responder):
    """A body whose release dial is on MUP: the first release only raises the mirror."""

    def __init__(self, clock: SimulatedClock) -> None:
        super().__init__(picture, clock=clock)
        self.is_up = False
        self.releases = 0

    def handle(self, container: Container) -> list[Output]:
        number = container.transaction
        if container.code == NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA:
            self.releases += 1
            if self.releases == 1:
                self.is_up = True
                return [Container(ContainerType.RESPONSE, ResponseCode.OK, number)]
        if container.code == NikonOperation.GET_EVENT and self.is_up:
            self.is_up = False
            event = encode_nikon_events([Event(NikonEvent.MIRROR_UP, (0,))])
            response = Container(ContainerType.RESPONSE, ResponseCode.OK, number)
            return [Container(ContainerType.DATA, container.code, number, event), response]
        return super().handle(container)


def test_a_mirror_that_only_goes_up_is_released_again() -> None:
    clock = SimulatedClock()
    body = MirrorUp(clock)
    with open_camera(None, clock, Bus(ResponderPipe(body, clock))) as camera:
        assert camera.capture(SETTINGS).data == EXPECTED
    assert body.releases == 2


@pytest.mark.parametrize("order", [(), ("jpeg-first",)], ids=["raw first", "JPEG first"])
def test_of_a_pair_the_raw_file_is_delivered(order: tuple[str, ...]) -> None:
    at = bench(*order)
    with at.open() as camera:
        at.responder.turn(Property.COMPRESSION, 7)  # on the body, after control was taken
        for _ in range(2):
            assert camera.capture(SETTINGS).data == EXPECTED


@pytest.mark.parametrize("wrong", ["", "lost-event", "lost-completion", "completion-first"])
def test_a_plain_camera_delivers_from_its_card_and_leaves_it_there(wrong: str) -> None:
    at = bench(*([wrong] if wrong else []), model=plain())
    with at.open() as camera:
        for _ in range(2):
            assert camera.capture(SETTINGS).data == EXPECTED


@pytest.mark.parametrize("packet_bytes", [64, 512, 1024])
@pytest.mark.parametrize("splits_headers", [False, True], ids=["together", "header alone"])
def test_packets_of_every_size(packet_bytes: int, splits_headers: bool) -> None:
    at = bench(packet_bytes=packet_bytes, splits_headers=splits_headers)
    with at.open() as camera:
        assert camera.capture(SETTINGS).data == EXPECTED


def test_a_session_that_a_killed_program_left_open_is_taken_over() -> None:
    at = bench()
    at.open()  # and never closed
    at.bus.is_claimed = False
    with at.open() as camera:
        assert camera.capture(SETTINGS).data == EXPECTED


def test_a_camera_that_comes_back_is_found_again_once() -> None:
    at = bench("unplug@9207")
    at.pipe.comes_back_after_s = 1.0
    with at.open() as camera:
        assert camera.capture(SETTINGS).data == EXPECTED


def test_a_camera_that_stays_away_stops_the_capture_and_can_be_closed() -> None:
    at = bench("unplug@1009")
    with at.open() as camera:
        with pytest.raises(CameraError, match="every frame before this one is safe"):
            camera.capture(SETTINGS)
        with pytest.raises(CameraError, match="every frame before this one is safe"):
            camera.capture(SETTINGS)
        at.pipe.plug_in()
        assert camera.capture(SETTINGS).data == EXPECTED


def test_live_view_delivers_jpeg_frames_and_ends() -> None:
    at = bench()
    with at.open() as camera:
        frames = camera.live_view()
        for _ in range(3):
            frame = next(frames)
            assert frame.startswith(b"\xff\xd8\xff")
            assert frame.endswith(b"\xff\xd9")
        frames.close()
        assert camera.capture(SETTINGS).data == EXPECTED


def test_live_view_that_the_camera_forbids_says_why() -> None:
    at = bench()
    at.responder.turn(Property.BATTERY_LEVEL, 5)
    with at.open() as camera, pytest.raises(CameraError, match="battery"):
        next(camera.live_view())


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        pytest.param(errno.EBUSY, "gvfs-gphoto2-volume-monitor", id="EBUSY"),
        pytest.param(errno.ENODEV, "unplugged", id="ENODEV"),
    ],
)
def test_a_camera_that_cannot_be_claimed_says_what_to_do(error: int, advice: str) -> None:
    at = bench()
    at.bus.failures = [usb_error(error)] * 10
    before_s = at.clock.now()
    with pytest.raises(CameraError, match=advice):
        at.open()
    assert at.clock.now() - before_s < 5


def test_a_camera_that_is_busy_for_a_moment_is_claimed() -> None:
    at = bench()
    at.bus.failures = [usb_error(errno.EBUSY)] * 2
    with at.open() as camera:
        assert camera.capture(SETTINGS).data == EXPECTED


def test_no_permission_prints_the_udev_rule() -> None:
    at = bench()
    at.bus.open_failure = usb_error(errno.EACCES)
    with pytest.raises(CameraError) as caught:
        at.open()
    assert 'ATTR{idVendor}=="04b0", ATTR{idProduct}=="0435"' in str(caught.value)
    assert "udevadm" in str(caught.value)


def test_no_camera_says_what_to_look_at() -> None:
    at = bench()
    at.bus.pipe = None
    with pytest.raises(CameraError, match="USB mode"):
        at.open()
