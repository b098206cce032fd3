"""Requests that no page of ours would make, against the real server."""

from __future__ import annotations

import http.client
import json
import queue
import socket
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from acquire.page.commands import MAX_COMMAND_BYTES
from acquire.page.server import FILES, MAX_VIEWERS
from tests.acquire.page.pages import PATIENCE_S, Client, Served, served

EVIL = "http://evil.example"


@pytest.fixture(scope="module")
def page() -> Iterator[Served]:
    with served() as page:
        yield page


def status(
    page: Served, path: str, headers: Mapping[str, str] | None = None, verb: str = "GET"
) -> int:
    """Of one request, its Host the page's own unless `headers` has another."""
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE_S)
    wanted = {"Host": page.host} | dict(headers or {})
    connection.putrequest(verb, path, skip_host=True, skip_accept_encoding=True)
    for name, value in wanted.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    if answer.status == 403:
        assert page.token.encode() not in body
    return answer.status


def test_the_page_itself_is_served_and_sealed(page: Served) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE_S)
    connection.request("GET", f"/{page.token}/")
    answer = connection.getresponse()
    body = answer.read().decode()
    connection.close()
    assert answer.status == 200
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["x-frame-options"] == "DENY"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert answer.headers["cache-control"] == "no-store"
    assert "access-control-allow-origin" not in answer.headers
    assert page.token not in body
    for name in FILES:
        assert status(page, f"/{page.token}/{name}") == 200


@pytest.mark.parametrize(
    "headers",
    [
        pytest.param({"Host": "evil.example"}, id="rebound name"),
        pytest.param({"Host": "evil.example:{port}"}, id="rebound name with our port"),
        pytest.param({"Host": "127.0.0.1"}, id="no port"),
        pytest.param({"Host": "127.0.0.1:1"}, id="another port"),
        pytest.param({"Host": "127.0.0.1:{port}.evil.example"}, id="suffix"),
        pytest.param({"Host": ""}, id="empty host"),
        pytest.param({"Origin": EVIL}, id="another origin"),
        pytest.param({"Origin": "null"}, id="sandboxed origin"),
        pytest.param({"Origin": "http://localhost:{port}"}, id="origin is not the host"),
        pytest.param({"Origin": "https://{host}"}, id="another scheme"),
        pytest.param({"Sec-Fetch-Site": "cross-site"}, id="called across sites"),
        pytest.param({"Sec-Fetch-Site": "same-site"}, id="called from another port"),
    ],
)
def test_a_request_from_elsewhere_is_refused_with_the_right_token(
    page: Served, headers: Mapping[str, str]
) -> None:
    changed = {
        name: value.format(port=page.port, host=page.host) for name, value in headers.items()
    }
    assert status(page, f"/{page.token}/", changed) == 403
    assert status(page, f"/{page.token}/page.js", changed) == 403


@pytest.mark.parametrize(
    "path",
    [
        pytest.param("/", id="none"),
        pytest.param("/page.js", id="none, file"),
        pytest.param("/socket", id="none, socket"),
        pytest.param("/wrong/", id="wrong"),
        pytest.param("/{short}/", id="shortened"),
        pytest.param("/{token}x/", id="lengthened"),
        pytest.param("//{token}/", id="second"),
        pytest.param("/?token={token}", id="query"),
        pytest.param("/%2e%2e/{token}/", id="behind dots"),
        pytest.param("/%ff%fe/", id="no UTF-8"),
        pytest.param("/" + "a" * 5000, id="long"),
    ],
)
def test_without_the_token_nothing_is_served(page: Served, path: str) -> None:
    assert status(page, path.format(token=page.token, short=page.token[:-1])) == 403


@pytest.mark.parametrize(
    "path",
    ["../../../../etc/passwd", "..%2f..%2fetc%2fpasswd", "%2e%2e/%2e%2e/etc/passwd", "/etc/passwd",
     "static/page.js", "page.html.jinja", "page.js%00.css", "frames/000000.dng", "plan.json",
     "..\\..\\pyproject.toml", "page.js/../../hub.py"],
)  # fmt: skip
def test_no_path_leads_to_a_file(page: Served, path: str) -> None:
    assert status(page, f"/{page.token}/{path}") == 404


@pytest.mark.parametrize("verb", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"])
def test_only_reading_is_allowed(page: Served, verb: str) -> None:
    assert status(page, f"/{page.token}/", verb=verb) == 405


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"origin": EVIL}, id="another origin"),
        pytest.param({"origin": None}, id="no origin"),
        pytest.param({"origin": "null"}, id="sandboxed origin"),
        pytest.param({"host": "evil.example", "origin": "http://evil.example"}, id="rebound name"),
        pytest.param({"path": "/socket"}, id="no token"),
        pytest.param({"path": "/" + "A" * 43 + "/socket"}, id="wrong token"),
    ],
)
def test_a_socket_from_elsewhere_is_refused(
    page: Served, changes: Mapping[str, str | None]
) -> None:
    with pytest.raises(InvalidStatus) as refused:
        page.viewer(**changes)
    assert refused.value.response.status_code == 403


def closed(client: Client) -> int:
    """The code with which the page closes a socket; 0 when it just went."""
    try:
        while True:
            client.connection.recv(PATIENCE_S)
    except ConnectionClosed as end:
        return end.rcvd.code if end.rcvd else 0
    finally:
        client.close()


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("", id="nothing"),
        pytest.param("{", id="no JSON"),
        pytest.param("[" * 1000, id="deep"),
        pytest.param('{"do": "shutdown"}', id="unknown"),
        pytest.param('{"do": "start", "out": "/tmp/x"}', id="with a path"),
        pytest.param('{"do": "show", "what": ' + json.dumps("x" * 200) + "}", id="long"),
        pytest.param('{"do": "expose", "exposure_s": NaN}', id="NaN"),
        pytest.param('{"do": "expose", "exposure_s": -1}', id="negative"),
        pytest.param('{"do": "region", "box": [0, 0, 1e99, 1]}', id="huge"),
        pytest.param('{"do": "region", "box": [0, 0, -1, 1]}', id="negative region"),
    ],
)
def test_what_is_not_understood_is_refused_and_does_nothing(page: Served, text: str) -> None:
    client = page.viewer()
    client.connection.send(text)
    assert "not understood" in client.told("refused")["why"]
    client.close()
    with pytest.raises(queue.Empty):
        page.commands.get(timeout=0.05)


def test_too_long_a_message_ends_the_socket(page: Served) -> None:
    client = page.viewer()
    client.connection.send("x" * (MAX_COMMAND_BYTES + 1))
    assert closed(client) in {1008, 1009}


def test_binary_and_repeated_nonsense_end_the_socket(page: Served) -> None:
    client = page.viewer()
    client.connection.send(b"\x00" * 100)
    assert closed(client) == 1008
    client = page.viewer()
    for _ in range(12):
        client.connection.send("nonsense")
    assert closed(client) == 1008


def test_a_flood_of_commands_ends_the_socket(page: Served) -> None:
    client = page.viewer()
    with suppress(ConnectionClosed):
        for _ in range(5000):
            client.ask(do="ready")
    assert closed(client) in {0, 1008}


def test_no_more_viewers_than_there_is_room_for(page: Served) -> None:
    with ExitStack() as leaving:
        for _ in range(MAX_VIEWERS):
            leaving.callback(page.viewer().close)
        with pytest.raises(InvalidStatus):
            page.viewer()


def test_the_page_cannot_be_reached_over_the_network(page: Served) -> None:
    outside = {
        str(info[4][0])
        for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)
        if not str(info[4][0]).startswith("127.")
    }
    for address in outside:
        with pytest.raises(OSError, match=r"refused|unreachable"):
            socket.create_connection((address, page.port), 5)


def test_after_all_this_the_page_still_works(page: Served) -> None:
    client = page.viewer()
    client.ask(do="take")
    client.until(lambda state: state["holder"] == state["you"])
    client.ask(do="show", what="white")
    assert page.commands.get(timeout=PATIENCE_S).do == "show"
    client.close()
    assert page.warnings == []
