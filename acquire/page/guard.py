"""Who may speak to the page: this computer's browsers, from the page itself, with its token.

A page from the web can make a browser call any address on this computer. What it cannot do is
know the token, change the Origin that the browser sends, or send our Host (unless it points its
own name at the loopback address, and then the Host is that name).
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any, Final

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

POLICY_VIOLATION = 1008
SECURITY_HEADERS: Final = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}
_HEADERS = [(name.encode(), value.encode()) for name, value in SECURITY_HEADERS.items()]


class Guard:
    """Lets through what may speak and hides the token from the application behind it.

    Parameters
    ----------
    app
        The application; sees paths without the token.
    port
        Where the page is served; part of Host and Origin.
    token
        The first part of every path.
    """

    def __init__(self, app: App, port: int, token: str) -> None:
        self._app = app
        self._token = token.encode()
        self._hosts = {f"127.0.0.1:{port}".encode(), f"localhost:{port}".encode()}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer as an ASGI application."""
        if scope["type"] not in {"http", "websocket"}:
            return
        inner = self._admitted(scope)
        if inner is not None:
            await self._app({**scope, "path": inner, "raw_path": b""}, receive, _sealed(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})
        else:
            await _refuse(send)

    def _admitted(self, scope: Scope) -> str | None:
        """The path behind the token; None for everyone who must not get it."""
        headers: list[tuple[bytes, bytes]] = scope["headers"]
        hosts = _all(headers, b"host")
        origins = _all(headers, b"origin")
        sites = _all(headers, b"sec-fetch-site")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return None
        if any(origin != b"http://" + hosts[0] for origin in origins) or len(origins) > 1:
            return None
        if scope["type"] == "websocket" and not origins:
            return None
        if any(site not in {b"same-origin", b"none"} for site in sites):
            return None
        first, _, rest = str(scope["path"]).removeprefix("/").partition("/")
        if not hmac.compare_digest(first.encode(errors="replace"), self._token):
            return None
        return "/" + rest


def _all(headers: list[tuple[bytes, bytes]], wanted: bytes) -> list[bytes]:
    return [value for name, value in headers if name.lower() == wanted]


def _sealed(send: Send) -> Send:
    async def sealed(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *_HEADERS]}
        await send(message)

    return sealed


async def _refuse(send: Send) -> None:
    """The same answer to everyone: it says neither what was wrong nor what is here."""
    headers = [*_HEADERS, (b"content-type", b"text/plain"), (b"content-length", b"10")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": b"forbidden\n"})
