"""Connections to the page: a client that is slow to ask makes room for others."""

from __future__ import annotations

import asyncio
from typing import Any, Final

from uvicorn.protocols.http.h11_impl import H11Protocol

#: How long a request may take to arrive, seconds. On one machine, or through ssh, it takes
#: milliseconds; the server itself waits for ever.
REQUEST_S: Final = 10.0


class TimedConnection(H11Protocol):
    """Closes a connection on which nothing is asked for REQUEST_S, byte by byte or not at all.

    The time runs while no request is being answered; bytes that arrive do not prolong it. A
    connection that was upgraded to a web socket is another protocol's. h11 bounds the head of a
    request; httptools, which uvicorn prefers, does not.
    """

    _deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection and start its time."""
        super().connection_made(transport)
        self._deadline = self.loop.call_later(REQUEST_S, transport.abort)

    def data_received(self, data: bytes) -> None:
        """Take bytes; stop the time when they complete a request, start it with the next one."""
        super().data_received(data)
        cycle: Any = self.cycle
        if self.transport.get_protocol() is not self or (cycle and not cycle.response_complete):
            self._stop()
        elif self._deadline is None:
            self._deadline = self.loop.call_later(REQUEST_S, self.transport.abort)

    def on_response_complete(self) -> None:
        """Stop the time of this request: the server's own, between requests, begins."""
        self._stop()
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._stop()
        super().connection_lost(exc)

    def _stop(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
