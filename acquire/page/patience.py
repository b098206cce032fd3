"""How long a connection may keep the page waiting before it is let go."""

from __future__ import annotations

import asyncio
import socket
import sys

from uvicorn.protocols.http.h11_impl import H11Protocol

REQUEST_LIMIT_S = 5.0
UNREAD_LIMIT_S = 10.0


class ImpatientProtocol(H11Protocol):
    """HTTP that closes a connection whose first request does not come."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the clock."""
        super().connection_made(transport)
        self.loop.call_later(REQUEST_LIMIT_S, self._look)

    def _look(self) -> None:
        waiting = self.cycle is None and self.transport.get_protocol() is self
        if waiting and not self.transport.is_closing():
            self.transport.abort()


def let_go_of_deaf(listening: socket.socket) -> None:
    """Close connections whose other end takes nothing for a while, where the system can (Linux).

    Only the system can end them: what waits to be sent holds a closed connection open.
    """
    if sys.platform == "linux":
        limit_ms = round(1000 * UNREAD_LIMIT_S)
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, limit_ms)
