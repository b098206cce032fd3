"""Connections that no browser of ours would make, against the real server."""

from __future__ import annotations

import asyncio
import base64
import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

from acquire.page.darkroom import Negative
from acquire.page.hub import Hub
from acquire.page.process import MAX_CONNECTIONS
from acquire.page.server import MAX_VIEWERS
from acquire.page.state import Setting
from tests.acquire.page.pages import PATIENCE_S, Client, Served, served
from tests.acquire.page.programs import children


@pytest.fixture(scope="module")
def page() -> Iterator[Served]:
    with served() as page:
        yield page


def connection(page: Served) -> socket.socket:
    made = socket.create_connection(("127.0.0.1", page.port), PATIENCE_S)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    return made


def shaken(page: Served, *more: str) -> socket.socket:
    """A socket after its handshake, which nobody reads from then on."""
    made = connection(page)
    key = base64.b64encode(os.urandom(16)).decode()
    lines = [
        f"GET /{page.token}/socket HTTP/1.1",
        *(f"Host: {page.host}", f"Origin: http://{page.host}"),
        *("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"),
        *(f"Sec-WebSocket-Key: {key}", *more, "", ""),
    ]
    made.sendall("\r\n".join(lines).encode())
    assert made.recv(12) == b"HTTP/1.1 101"
    return made


def frame(opcode: int, payload: bytes, *, final: bool = True, masked: bool = True) -> bytes:
    """A frame after RFC 6455, 5.2; the mask is 0."""
    size = len(payload)
    length = bytes([size]) if size < 126 else b"\x7e" + size.to_bytes(2, "big")
    length = bytes([length[0] | (0x80 if masked else 0)]) + length[1:]
    return (
        bytes([(0x80 if final else 0) | opcode]) + length + (bytes(4) if masked else b"") + payload
    )


def is_closed(made: socket.socket) -> bool:
    """Whether the page ends a connection; what it still says is read."""
    made.settimeout(PATIENCE_S)
    try:
        while made.recv(65536):
            pass
    except ConnectionError:
        pass
    made.close()
    return True


def resident_bytes() -> int:
    (process,) = children(os.getpid())
    status = Path(f"/proc/{process}/statm").read_text()
    return int(status.split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.parametrize(
    "sent",
    [
        pytest.param(b"".join([frame(1, b"x" * 1000, final=False)] * 3), id="long in pieces"),
        pytest.param(frame(1, b"\xff\xfe"), id="no UTF-8"),
        pytest.param(frame(1, b"{}", masked=False), id="unmasked"),
        pytest.param(frame(3, b"{}"), id="unknown opcode"),
        pytest.param(b"\xf1" + frame(1, b"{}")[1:], id="reserved bits"),
        pytest.param(frame(9, b"x" * 126), id="long ping"),
        pytest.param(b"\x81\xff" + b"\xff" * 8 + bytes(4), id="16 exabytes"),
        pytest.param(os.urandom(4096), id="noise"),
    ],
)
def test_what_is_no_message_ends_the_socket(page: Served, sent: bytes) -> None:
    made = shaken(page)
    made.sendall(sent)
    assert is_closed(made)


def test_compression_is_not_taken(page: Served) -> None:
    """A kilobyte that unpacks to a gigabyte needs it."""
    made = shaken(page, "Sec-WebSocket-Extensions: permessage-deflate")
    head = made.recv(4096).split(b"\r\n\r\n")[0]
    assert b"permessage" not in head
    made.sendall(b"\xc1" + frame(1, b"{}")[1:])
    assert is_closed(made)


@pytest.mark.parametrize(
    "request_",
    [
        pytest.param("GET /{token}/ HTTP/1.0\r\n\r\n", id="no host"),
        pytest.param("GET /{token}/ HTTP/1.1\r\nHost: {host}\r\nHost: {host}\r\n\r\n", id="twice"),
        pytest.param("GET http://{host}/{token}/ HTTP/1.1\r\nHost: {host}\r\n\r\n", id="proxy"),
        pytest.param("CONNECT {host} HTTP/1.1\r\nHost: {host}\r\n\r\n", id="tunnel"),
        pytest.param("GET /{token}/ HTTP/1.1\r\nHost: {host}\r\n" + "a: b\r\n" * 20000, id="heads"),
        pytest.param("\x16\x03\x01" + "x" * 100 + "\r\n\r\n", id="TLS"),
        pytest.param(
            "POST /{token}/ HTTP/1.1\r\nHost: {host}\r\nContent-Length: 99999999999\r\n\r\n",
            id="long body",
        ),
    ],
)
def test_a_request_that_is_none_is_refused(page: Served, request_: str) -> None:
    made = connection(page)
    made.sendall(request_.format(token=page.token, host=page.host).encode("latin-1"))
    made.settimeout(PATIENCE_S)
    answer = made.recv(4096)
    made.close()
    assert int(answer.split()[1]) in {400, 403, 404, 405}
    assert b"lumisplit" not in answer


def test_silent_connections_do_not_keep_the_page_from_others(page: Served) -> None:
    with ExitStack() as leaving:
        for _ in range(MAX_CONNECTIONS + 10):
            leaving.enter_context(connection(page))
        deadline_s = time.monotonic() + PATIENCE_S
        answer = b""
        while b" 200 " not in answer:
            assert time.monotonic() < deadline_s
            with connection(page) as made:
                made.sendall(f"GET /{page.token}/ HTTP/1.1\r\nHost: {page.host}\r\n\r\n".encode())
                answer = made.recv(15)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs Linux's /proc")
def test_viewers_that_take_nothing_cost_neither_memory_nor_places(page: Served) -> None:
    """All places are taken by viewers who never read, while large pictures come."""
    noise = np.random.default_rng(0).integers(0, 255, (500, 500, 3)).astype(np.uint8)
    picture = cv2.imencode(".png", noise)[1].tobytes()
    with ExitStack() as leaving:
        for _ in range(MAX_VIEWERS):
            leaving.enter_context(shaken(page))
        page.desk.picture("image/png", picture)
        before = resident_bytes()
        client: Client | None = None
        deadline_s = time.monotonic() + PATIENCE_S
        while client is None:
            assert time.monotonic() < deadline_s
            for _ in range(20):
                page.desk.picture("image/png", picture)
            page.desk.remark("x" * 1000)
            try:
                client = page.viewer()
            except InvalidStatus:
                time.sleep(0.05)
        # A picture for each of them, and some for what is being printed.
        assert resident_bytes() - before < 2 * MAX_VIEWERS * len(picture) + (32 << 20)
        client.ask(do="take")
        client.until(lambda state: state["holder"] == state["you"])
        client.ask(do="show", what="white")
        assert page.commands.get(timeout=PATIENCE_S).do == "show"
        client.close()
    assert page.warnings == []


def test_parts_that_nobody_looks_at_any_more_are_forgotten() -> None:
    """A viewer who moves about for hours while no new picture comes."""
    setting = Setting("a bench", (48, 64), 1000, None, can_aim=True, can_start=False, version="0")
    hub = Hub(setting, lambda _: None)
    picture = Negative(np.zeros((50, 60, 3), np.float32), np.zeros((50, 60), np.uint8))

    async def look() -> None:
        viewer = hub.join()
        hub._hang(picture, None)
        for left in range(40):
            viewer.box = (left, 0, 10, 10)
            assert await hub.picture_for(viewer)
        assert len(hub._prints) <= 2

    asyncio.run(look())
    hub.close()
