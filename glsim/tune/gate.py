"""Let in the user's own browsers alone: a ticket for the first request, then a cookie."""

from __future__ import annotations

import json
import os
import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any, Final
from urllib.parse import parse_qs

from glsim.tune.peer import peer_uid

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
Application = Callable[[Message, Receive, Send], Awaitable[None]]

#: No other page may frame this one, and this one loads nothing from elsewhere. NiceGUI builds its
#: page with scripts in the text.
_POLICY = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; "
    "base-uri 'self'; form-action 'self'; object-src 'none'"
)
HEADERS: Final = (
    (b"content-security-policy", _POLICY.encode()),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "::1"})
_EVERY_HOST = frozenset({"0.0.0.0", "::"})
_AGE = "Max-Age=2592000"  # 30 days, as the secret
_LINK = re.compile(r"[A-Za-z0-9_-]*")


class Gate:
    """An ASGI middleware that answers 403 to all but the user's browsers, web sockets alike.

    A page that is opened with ``?ticket=...`` gets a cookie, which its further requests carry.
    Refused are other origins, other names of this machine (an attacker's may lead to 127.0.0.1) and
    connections of other users of this machine.
    """

    def __init__(
        self,
        app: Application,
        use: Callable[[str], bool],
        secret: str,
        cookie: str,
        host: str,
        port: int,
    ) -> None:
        """Guard an application.

        Args:
            use: takes a ticket; returns whether it was valid.
            secret: value of the cookie.
            cookie: name of the cookie.
            host, port: where the page is served.
        """
        self._app, self._use, self._secret, self._cookie = app, use, secret, cookie
        self._host, self._port = host, port

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]}
        if not self._is_own(scope, headers):
            await _refuse(scope, send)
            return
        query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        ticket = query.get("ticket", [""])[0]
        if scope["type"] == "http" and ticket and self._use(ticket):
            await self._admit(send, query.get("s", [""])[0])
            return
        given = _cookie(headers, self._cookie)
        if not secrets.compare_digest(given.encode(), self._secret.encode()):
            await _refuse(scope, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *HEADERS]
            await send(message)

        await self._app(scope, receive, with_headers)

    def _is_own(self, scope: Message, headers: MutableMapping[str, str]) -> bool:
        """Whether the request comes from this user, for this host, from no page of another."""
        host = headers.get("host", "")
        name = host.rpartition(":")[0] if re.search(r":\d+$", host) else host
        known = _LOOPBACK | {self._host}
        if self._host not in _EVERY_HOST and name.strip("[]").lower() not in known:
            return False
        origin = headers.get("origin")
        if origin is not None and origin.partition("://")[2] != host:
            return False
        uid = peer_uid(scope.get("client"), self._port)
        return uid is None or uid in (0, os.getuid())

    async def _admit(self, send: Send, link: str) -> None:
        """Give the cookie, and lead to the page without the ticket.

        A script does it: a browser that follows a redirection from another site keeps a strict
        cookie to itself.
        """
        target = json.dumps(f"/?s={link}" if link and _LINK.fullmatch(link) else "/")
        cookie = f"{self._cookie}={self._secret}; Path=/; HttpOnly; SameSite=Strict; {_AGE}"
        page = f"<!doctype html><title>glsim</title><script>location.replace({target})"
        head = [
            (b"content-type", b"text/html; charset=utf-8"),
            (b"cache-control", b"no-store"),
            (b"set-cookie", cookie.encode()),
            *HEADERS,
        ]
        await send({"type": "http.response.start", "status": 200, "headers": head})
        await send({"type": "http.response.body", "body": f"{page}</script>".encode()})


def _cookie(headers: MutableMapping[str, str], name: str) -> str:
    try:
        cookies = SimpleCookie(headers.get("cookie", ""))
    except CookieError:
        return ""
    return cookies[name].value if name in cookies else ""


async def _refuse(scope: Message, send: Send) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    head = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": head})
    text = (
        b"glsim: open the address that the command printed last: it lets one browser in, "
        b"once. Then the command prints the next one.\n"
    )
    await send({"type": "http.response.body", "body": text})
