"""PTP over USB below the camera: pipes, halts, large objects, and what a person must do."""

from __future__ import annotations

import errno
import os
import random
import tracemalloc
from pathlib import Path

import pytest

from drivers.errors import CameraError
from drivers.protocols import CameraSettings
from drivers.ptp import objects, usb_advice
from drivers.ptp.codes import ClassRequest, Operation, ResponseCode
from drivers.ptp.discovery import list_cameras
from drivers.ptp.errors import PtpDisconnectedError, PtpTimeoutError
from drivers.ptp.session import PtpSession
from drivers.ptp.usb import UsbLink
from drivers.ptp.usb_port import find
from drivers.sim.clock import SimulatedClock
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from tests.drivers.ptp.benches import bench, picture
from tests.drivers.ptp.usb_backend import Bus, ResponderPipe, usb_error

LARGE = random.Random(1).randbytes(20_000_000)
D4S = (0x04B0, 0x0435)


def session_with(data: bytes, *wrong: str, packet_bytes: int = 512) -> tuple[PtpSession, int]:
    """A session with a body whose card holds one file; its handle."""
    clock = SimulatedClock()
    misbehaviours = [Misbehaviour.parse(text) for text in wrong]
    responder = Responder(lambda _: (data, "image/jpeg"), None, misbehaviours, clock)
    bus = Bus(ResponderPipe(responder, clock, packet_bytes))
    session = PtpSession(UsbLink(find(bus)[0], clock), clock)
    session.open()
    session.ask(Operation.INITIATE_CAPTURE, 0, 0)
    clock.sleep(1.0)
    return session, objects.pictures(session, objects.handles(session))[0][0]


@pytest.mark.parametrize(
    "operations",
    [pytest.param((), id="whole"), pytest.param((Operation.GET_PARTIAL_OBJECT,), id="in parts")],
)
def test_a_large_object_comes_whole_and_is_held_once(operations: tuple[int, ...]) -> None:
    session, handle = session_with(LARGE)
    about = objects.info(session, handle)
    assert objects.download(session, handle, about, operations).data == LARGE
    tracemalloc.start()
    try:
        kept = objects.download(session, handle, about, operations).data
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(kept) == len(LARGE)
    assert held < 1.01 * len(LARGE)


@pytest.mark.parametrize("wrong", ["cut-object@101B+1", "cut-object@101B*2", "busy@101B+2*3"])
def test_parts_that_are_cut_are_asked_for_again(wrong: str) -> None:
    session, handle = session_with(LARGE, wrong)
    about = objects.info(session, handle)
    operations = (Operation.GET_PARTIAL_OBJECT,)
    assert objects.download(session, handle, about, operations).data == LARGE


def test_a_body_that_has_no_parts_after_all_delivers_whole() -> None:
    session, handle = session_with(LARGE, "busy=2005@101B")
    about = objects.info(session, handle)
    operations = (Operation.GET_PARTIAL_OBJECT,)
    assert objects.download(session, handle, about, operations).data == LARGE


@pytest.mark.parametrize("packet_bytes", [64, 512, 1024])
@pytest.mark.parametrize("beyond", [-1, 0, 1], ids=["short", "full", "over"])
@pytest.mark.parametrize("packets", [1, 2, 2048])
def test_transfers_that_end_at_the_edge_of_a_packet(
    packet_bytes: int, beyond: int, packets: int
) -> None:
    data = random.Random(packets).randbytes(packets * packet_bytes - 12 + beyond)
    session, handle = session_with(data, packet_bytes=packet_bytes)
    assert session.ask(Operation.GET_OBJECT, handle).data == data
    assert session.ask(Operation.GET_OBJECT, handle).data == data


class EmptyPackets(ResponderPipe):
    """A device that says nothing, again and again."""

    def read(self, size: int, timeout_s: float) -> bytes:  # noqa: ARG002
        return b""


class OddEvents(ResponderPipe):
    """A device whose interrupt pipe babbles."""

    def read_event(self, size: int, timeout_s: float) -> bytes:
        self._clock.sleep(timeout_s)
        return bytes(range(size))


def test_a_device_that_sends_only_empty_packets_is_given_up() -> None:
    at = bench()
    at.bus.pipe = EmptyPackets(at.responder, at.clock)
    with pytest.raises(CameraError, match="switch it off and on"):
        at.open()


def test_events_that_are_none_do_not_cost_a_shot() -> None:
    at = bench()
    at.bus.pipe = OddEvents(at.responder, at.clock)
    settings = CameraSettings(0.1, 8.0, 200)
    with at.open() as camera:
        assert camera.capture(settings).data == picture(settings)[0]


def test_a_halted_pipe_is_cleared() -> None:
    at = bench("stall@1009")
    with at.open() as camera:
        camera.capture(CameraSettings(0.1, 8.0, 200))
    assert at.pipe.cleared


def test_recovering_cancels_resets_and_asks_for_the_status() -> None:
    session, _ = session_with(b"\xff\xd8\xff\xd9", "timeout@1001")
    with pytest.raises(PtpTimeoutError):
        session.ask(Operation.GET_DEVICE_INFO)
    assert not session.is_in_step
    session.recover()
    session.open()
    assert session.ask(Operation.GET_DEVICE_INFO).code == ResponseCode.OK


def test_the_class_requests_of_a_recovery_are_the_standards() -> None:
    at = bench("timeout@9207")
    with at.open() as camera:
        with pytest.raises(PtpTimeoutError):
            camera.capture(CameraSettings(0.1, 8.0, 200))
        camera.capture(CameraSettings(0.1, 8.0, 200))
    assert at.pipe.requests[:3] == [
        ClassRequest.CANCEL,
        ClassRequest.DEVICE_RESET,
        ClassRequest.GET_DEVICE_STATUS,
    ]


@pytest.mark.parametrize("number", [errno.ENODEV, errno.ENXIO, errno.ESHUTDOWN])
def test_a_device_that_is_gone_is_told_from_one_that_fails(number: int) -> None:
    at = bench()
    at.bus.failures = [usb_error(number)]
    with pytest.raises(PtpDisconnectedError, match="check cable and battery"):
        at.open()


def test_cameras_are_listed_by_place_name_and_serial_number() -> None:
    at = bench()
    (found,) = list_cameras(at.bus)
    assert found.address == "usb:001,004"
    assert (found.vendor, found.product) == D4S
    assert (found.name, found.serial_number) == ("D4S", "0000123")
    assert not at.bus.is_claimed


def test_a_camera_that_may_not_be_opened_is_listed_without_a_name() -> None:
    at = bench()
    at.bus.open_failure = usb_error(errno.EACCES)
    (found,) = list_cameras(at.bus)
    assert found.name is None
    assert found.serial_number is None


def test_who_has_the_device_file_open_is_named(tmp_path: Path) -> None:
    for number, name, target in (
        (10, "gvfsd-gphoto2", "/dev/bus/usb/001/004"),
        (11, "bash", "/dev/pts/0"),
        (os.getpid(), "python", "/dev/bus/usb/001/004"),
    ):
        (tmp_path / str(number) / "fd").mkdir(parents=True)
        (tmp_path / str(number) / "comm").write_text(f"{name}\n")
        (tmp_path / str(number) / "fd" / "7").symlink_to(target)
    assert usb_advice.holders(1, 4, tmp_path) == ["gvfsd-gphoto2"]


@pytest.mark.parametrize(
    ("text", "commands"),
    [
        pytest.param(
            usb_advice.busy(1, 4, "linux", "/nowhere"),
            ["systemctl --user stop gvfs-gphoto2-volume-monitor.service"],
            id="Linux, busy",
        ),
        pytest.param(usb_advice.busy(1, 4, "darwin"), ["pkill -9 ptpcamerad"], id="macOS, busy"),
        pytest.param(
            usb_advice.denied(*D4S, "linux"), ["udev", "04b0", "0435"], id="Linux, denied"
        ),
        pytest.param(usb_advice.denied(*D4S, "win32"), ["WinUSB", "Zadig"], id="Windows, denied"),
        pytest.param(usb_advice.unsupported(*D4S, "win32"), ["Zadig"], id="Windows, no driver"),
        pytest.param(usb_advice.no_libusb(), ["apt install libusb-1.0-0"], id="no libusb"),
    ],
)
def test_what_a_person_must_do_is_said_with_the_command(text: str, commands: list[str]) -> None:
    assert all(command in text for command in commands)


def test_windows_without_winusb_says_so() -> None:
    at = bench()
    at.bus.open_failure = NotImplementedError("Operation not supported")
    with pytest.raises(CameraError, match="no driver that libusb can use"):
        at.open()
