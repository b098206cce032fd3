"""PTP over TCP against the simulated camera's server, and against servers that are none."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import pytest

from drivers.errors import CameraError
from drivers.protocols import CameraSettings
from drivers.ptp.codes import NikonOperation, Operation, PacketType, Property, ResponseCode
from drivers.ptp.datasets import DeviceInfo
from drivers.ptp.errors import (
    PtpDisconnectedError,
    PtpError,
    PtpProtocolError,
    PtpTimeoutError,
    PtpTransportError,
)
from drivers.ptp.ip import IpLink
from drivers.ptp.link import Link
from drivers.ptp.packets import (
    INIT_EVENT_ACK,
    PROBE_REQUEST,
    PROBE_RESPONSE,
    InitCommandAck,
    InitCommandRequest,
    InitEventRequest,
    InitFail,
    packet_bytes,
)
from drivers.ptp.transaction import (
    DataChunk,
    DataEnded,
    Event,
    NeedData,
    Request,
    Response,
    Stray,
)
from drivers.sim.ptp_responder.body import plain
from drivers.sim.ptp_responder.misbehaviour import Misbehaviour
from drivers.sim.ptp_responder.responder import Responder
from drivers.sim.ptp_responder.server import LOOPBACK, PtpIpServer

RAW_FILE = bytes(range(256)) * 40_000  # 10 MB: many packets, and more than the buffers of TCP
TIMEOUT_S = 5.0
SILENCE_S = 0.2
OK = Response(ResponseCode.OK, ())


def shoot(_: CameraSettings) -> tuple[bytes, str]:
    return RAW_FILE, "image/x-raw"


def server(*misbehaviours: str, body: str = "d4s") -> PtpIpServer:
    wrong = [Misbehaviour.parse(text) for text in misbehaviours]
    return PtpIpServer(Responder(shoot, plain() if body == "plain" else None, wrong))


@contextmanager
def connected(*misbehaviours: str, body: str = "d4s") -> Iterator[IpLink]:
    with server(*misbehaviours, body=body) as camera:
        link = IpLink(*camera.address)
        try:
            assert call(link, Operation.OPEN_SESSION, 1) == (OK, b"")
            yield link
        finally:
            link.close()


def call(
    link: Link, code: int, *parameters: int, data: bytes | None = None, wait_s: float = TIMEOUT_S
) -> tuple[Response, bytes]:
    link.send(Request(code, parameters, data))
    gathered = bytearray()
    while not isinstance(happening := link.receive(wait_s), Response):
        if isinstance(happening, DataChunk):
            gathered += happening.data
    return happening, bytes(gathered)


def capture(link: Link) -> int:
    """Take a picture to the card; its handle."""
    assert call(link, NikonOperation.INITIATE_CAPTURE_REC_IN_MEDIA, 0xFFFFFFFF, 0)[0] == OK
    until_s = time.monotonic() + TIMEOUT_S
    while call(link, NikonOperation.DEVICE_READY)[0].code != ResponseCode.OK:
        assert time.monotonic() < until_s
        time.sleep(0.01)
    return 3


def test_it_greets_and_works() -> None:
    with connected() as link:
        assert link.camera_name == "simulated D4S"
        response, data = call(link, Operation.GET_DEVICE_INFO)
        assert response == OK
        assert DeviceInfo.decode(data).model == "D4S"
        value = b"\x4c\x04"
        assert call(link, Operation.SET_DEVICE_PROP_VALUE, Property.F_NUMBER, data=value)[0] == OK
        assert call(link, Operation.GET_DEVICE_PROP_VALUE, Property.F_NUMBER) == (OK, value)


def test_a_large_object_lands_in_the_callers_buffer() -> None:
    with connected() as link:
        handle = capture(link)
        into = bytearray(len(RAW_FILE))
        link.send(Request(Operation.GET_OBJECT, (handle,)), memoryview(into))
        happenings = []
        while not isinstance(happening := link.receive(TIMEOUT_S), Response):
            happenings.append(happening)
        assert happenings[-1] == DataEnded(len(RAW_FILE), whole=True)
        assert into == RAW_FILE
        assert call(link, Operation.GET_OBJECT, handle) == (OK, RAW_FILE)


def test_events_come_by_themselves() -> None:
    with connected(body="plain") as link:
        assert isinstance(link.take(), NeedData)
        assert call(link, Operation.INITIATE_CAPTURE, 0, 0)[0] == OK
        events: list[Event] = []
        until_s = time.monotonic() + TIMEOUT_S
        while len(events) < 2:
            assert time.monotonic() < until_s
            link.poll_events(0.1)
            while isinstance(happening := link.take(), Event):
                events.append(happening)
        assert [event.code for event in events] == [0x4002, 0x400D]


def test_a_camera_that_is_there_answers_a_probe() -> None:
    with connected() as link:
        assert link.is_alive(TIMEOUT_S)
        assert call(link, Operation.GET_STORAGE_IDS)[0] == OK


def test_hosts_are_served_one_after_another_and_not_together() -> None:
    with server() as camera:
        for _ in range(3):
            link = IpLink(*camera.address)
            assert call(link, Operation.OPEN_SESSION, 1)[0] == OK
            with pytest.raises(PtpTransportError, match="busy with another program"):
                IpLink(*camera.address)
            link.close()
            link.close()
            until_s = time.monotonic() + TIMEOUT_S
            while not is_free(camera):
                assert time.monotonic() < until_s


def test_events_may_be_called_for_at_a_second_port() -> None:
    with socket.create_server((LOOPBACK, 0)) as listener:
        second = listener.getsockname()[1]
    with (
        PtpIpServer(Responder(shoot), event_port=second) as camera,
        socket.create_connection(camera.address, TIMEOUT_S) as commands,
        socket.create_connection((LOOPBACK, second), TIMEOUT_S) as events,
    ):
        commands.sendall(InitCommandRequest(bytes(16), "host").encode())
        assert commands.recv(4096)[4] == PacketType.INIT_COMMAND_ACK
        events.sendall(InitEventRequest(1).encode())
        assert events.recv(4096)[4] == PacketType.INIT_EVENT_ACK


def is_free(camera: PtpIpServer) -> bool:
    """Whether the camera has noticed that the last host is gone."""
    try:
        IpLink(*camera.address).close()
    except PtpTransportError:
        return False
    return True


def test_the_server_listens_on_this_computer_only_and_lets_its_port_go() -> None:
    with server() as camera:
        assert camera.address[0] == LOOPBACK == "127.0.0.1"
        with pytest.raises(CameraError, match=r"cannot listen at .*choose a free port"):
            PtpIpServer(Responder(shoot), *camera.address)
    assert not camera.is_plugged_in
    assert "ptp-ip-server" not in {thread.name for thread in threading.enumerate()}
    with PtpIpServer(Responder(shoot), *camera.address) as again:
        IpLink(*again.address).close()


def test_a_lost_answer_is_a_timeout_and_recovering_connects_anew() -> None:
    with connected("timeout@1004") as link:
        with pytest.raises(PtpTimeoutError, match=r"silent for 0.2 s.*asleep"):
            call(link, Operation.GET_STORAGE_IDS, wait_s=SILENCE_S)
        link.recover()
        assert call(link, Operation.OPEN_SESSION, 1)[0] == OK
        assert call(link, Operation.GET_STORAGE_IDS)[0] == OK


def test_a_camera_asleep_is_silent_and_a_new_connection_wakes_it() -> None:
    with connected("sleep@1004") as link:
        with pytest.raises(PtpTimeoutError):
            call(link, Operation.GET_STORAGE_IDS, wait_s=SILENCE_S)
        with pytest.raises(PtpProtocolError, match="not over"):
            link.send(Request(Operation.GET_STORAGE_IDS))
        link.recover()
        assert call(link, Operation.OPEN_SESSION, 1)[0] == OK
        assert call(link, Operation.GET_STORAGE_IDS)[0] == OK


def test_an_object_cut_short_is_told() -> None:
    with connected("cut-object") as link:
        handle = capture(link)
        link.send(Request(Operation.GET_OBJECT, (handle,)), memoryview(bytearray(len(RAW_FILE))))
        happenings = []
        while not isinstance(happening := link.receive(TIMEOUT_S), Response):
            happenings.append(happening)
        assert happenings[-1] == DataEnded(len(RAW_FILE) // 2, whole=False)


def test_answers_of_another_transaction_are_told_and_not_taken() -> None:
    with connected("stale-answer@1004") as link:
        link.send(Request(Operation.GET_STORAGE_IDS))
        assert link.receive(TIMEOUT_S) == Stray(ResponseCode.OK, 0x1234)
    with connected("wrong-transaction@1004") as link, pytest.raises(PtpTimeoutError):
        call(link, Operation.GET_STORAGE_IDS, wait_s=SILENCE_S)


def test_garbage_is_refused() -> None:
    with connected("garbage@1004") as link, pytest.raises(PtpProtocolError):
        call(link, Operation.GET_STORAGE_IDS)


def test_pulling_the_cable_amid_an_object_is_told_at_once_and_ever_after() -> None:
    with connected("unplug@1009") as link:
        handle = capture(link)
        with pytest.raises(PtpDisconnectedError, match="switched off, asleep or unplugged"):
            call(link, Operation.GET_OBJECT, handle)
        with pytest.raises(PtpDisconnectedError, match="no camera listens there"):
            link.recover()
        with pytest.raises(PtpDisconnectedError):
            link.receive(SILENCE_S)
        with pytest.raises(PtpDisconnectedError):
            link.send(Request(Operation.GET_STORAGE_IDS))


def test_a_host_that_breaks_the_rules_is_dropped_and_the_next_is_served() -> None:
    with server() as camera:
        for opening in (
            b"GET / HTTP/1.1\r\n\r\n",
            packet_bytes(PacketType.COMMAND_REQUEST, bytes(14)),
            InitEventRequest(99).encode(),
            InitCommandRequest(bytes(16), "host").encode() + InitFail(1).encode(),
        ):
            with socket.create_connection(camera.address, TIMEOUT_S) as host:
                host.sendall(opening)
                while host.recv(4096):
                    pass
        link = IpLink(*camera.address)
        assert call(link, Operation.OPEN_SESSION, 1)[0] == OK
        link.close()


@contextmanager
def impostor(*speakers: Callable[[socket.socket], None]) -> Iterator[int]:
    """A port where something else than a camera answers one connection after another."""

    def serve() -> None:
        with ExitStack() as open_until_all_have_spoken:
            for speak in speakers:
                connection, _ = listener.accept()
                open_until_all_have_spoken.enter_context(connection)
                speak(connection)

    with socket.create_server((LOOPBACK, 0)) as listener:
        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()[1]
        thread.join()


def greet(*answers: bytes) -> Callable[[socket.socket], None]:
    def speak(connection: socket.socket) -> None:
        connection.recv(4096)
        for answer in answers:
            connection.sendall(answer)

    return speak


ACK = InitCommandAck(1, bytes(16), "camera").encode()
IMPOSTORS: dict[str, tuple[bytes, type[Exception], str]] = {
    "another service": (b"HTTP/1.1 400 Bad Request\r\n", PtpProtocolError, "not PTP/IP"),
    "the wrong packet": (PROBE_REQUEST.encode(), PtpProtocolError, "does not answer as a PTP/IP"),
    "data": (
        packet_bytes(PacketType.DATA, bytes(8)),
        PtpProtocolError,
        "does not answer as a PTP/IP",
    ),
    "not paired": (InitFail(1).encode(), PtpTransportError, "pair it with this one"),
    "busy": (InitFail(2).encode(), PtpTransportError, "close that one"),
    "some reason": (InitFail(3).encode(), PtpTransportError, "off and on again"),
    "nothing": (b"", PtpDisconnectedError, "closed the connection"),
    "half a greeting": (ACK[:20], PtpDisconnectedError, "closed the connection"),
}


@pytest.mark.parametrize("name", IMPOSTORS)
def test_what_is_no_camera_is_told_so(name: str) -> None:
    answer, error, message = IMPOSTORS[name]
    with impostor(greet(answer)) as port, pytest.raises(error, match=message):
        IpLink(LOOPBACK, port)


@pytest.mark.parametrize(
    ("answer", "message"),
    [(InitFail(2).encode(), "close that one"), (ACK, "does not answer as a PTP/IP")],
    ids=["refused", "the wrong packet"],
)
def test_an_event_connection_that_is_not_accepted_is_told_so(answer: bytes, message: str) -> None:
    with impostor(greet(ACK), greet(answer)) as port, pytest.raises(PtpError, match=message):
        IpLink(LOOPBACK, port)


def test_a_camera_that_asks_is_answered() -> None:
    answers = []

    def probe(connection: socket.socket) -> None:
        greet(INIT_EVENT_ACK.encode(), PROBE_REQUEST.encode())(connection)
        answers.append(connection.recv(4096))

    with impostor(greet(ACK), probe) as port:
        link = IpLink(LOOPBACK, port)
        link.poll_events(TIMEOUT_S)
        assert isinstance(link.take(), NeedData)
    assert answers == [PROBE_RESPONSE.encode()]
    link.close()


def test_a_camera_that_does_not_answer_a_probe_is_not_there() -> None:
    release = threading.Event()
    events = greet(INIT_EVENT_ACK.encode())
    with impostor(greet(ACK), events, lambda _: _wait(release)) as port:
        link = IpLink(LOOPBACK, port)
        with socket.create_connection((LOOPBACK, port)):
            assert not link.is_alive(SILENCE_S)
            release.set()
    link.close()


def _wait(release: threading.Event) -> None:
    assert release.wait(TIMEOUT_S)


def test_a_port_that_is_silent_is_given_up() -> None:
    release = threading.Event()
    with impostor(lambda _: (release.wait(TIMEOUT_S) and None) or None) as port:
        with pytest.raises(PtpTimeoutError, match="does not greet"):
            IpLink(LOOPBACK, port, connect_timeout_s=SILENCE_S)
        release.set()


def test_a_port_where_nobody_listens_and_a_name_that_nobody_has() -> None:
    with socket.create_server((LOOPBACK, 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(PtpDisconnectedError, match=r"switch its network connection \(PTP/IP\) on"):
        IpLink(LOOPBACK, port)
    with pytest.raises(PtpDisconnectedError, match="address that the camera shows"):
        IpLink("camera.invalid", 15740)
