"""Access control of the page, and the settings that are kept after the command ends.

As in Jupyter, the page listens on loopback. The printed address contains a token, which a browser
exchanges for a cookie; requests of other origins are refused. A file that only the user can read
stores the cookie's secret and the last settings.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import tempfile
import threading
import webbrowser
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pydantic import TypeAdapter
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from glsim.cli.tune_page.tuning import Tuning
from glsim.core.errors import ConfigError
from glsim.core.files.cache_folder import cache_folder
from glsim.core.files.contents import text_hash
from glsim.core.files.regular import read_regular

#: A browser keeps its cookie for 30 days, s.
_COOKIE_S = 30 * 86_400
_LOOPBACK = ("localhost", "127.0.0.1", "::1")
_EVERY_HOST = ("0.0.0.0", "::")
#: Largest state file, bytes, and largest number of stored settings.
_LARGEST, _MOST_KEPT = 1 << 22, 20


@dataclass
class PageAddress:
    """A listening socket and the access token of its page.

    A browser can connect at once: its request waits in the socket until the server is up.
    """

    host: str
    listening: socket.socket
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def port(self) -> int:
        """The port in use; it differs from the requested port if that was taken."""
        return int(self.listening.getsockname()[1])

    @property
    def url(self) -> str:
        """URL of the page, with the token."""
        shown = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{shown}:{self.port}/?token={self.token}"

    def open_browser(self) -> None:
        """Open the page in the user's browser, through a file that only the user can read.

        Everybody on the machine can read the arguments of a process.
        """
        page = _write_private(
            "tune.html", f"<script>location.replace({json.dumps(self.url)})</script>"
        )
        if page is not None:
            threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()


def listen(host: str, port: int) -> PageAddress:
    """Listen on a host of this machine; use a free port if ``port`` is taken.

    Raises ConfigError for a host that cannot be used.
    """
    for wanted in (port, 0):
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            listening = socket.create_server((host, wanted), family=family)
        except OSError as error:
            failure = error.strerror or error
        else:
            # Without this option, small answers wait up to 40 ms for each other.
            listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return PageAddress(host, listening)
    raise ConfigError(f"--host {host} --port {port}: {failure}")


class AccessCheck:
    """ASGI middleware that refuses browsers without the token or the cookie."""

    def __init__(self, app: ASGIApp, address: PageAddress, secret: str) -> None:
        """Wrap an application; ``secret`` is the value of the cookie."""
        self._app, self._address, self._secret = app, address, secret
        self._cookie = f"glsim_tune_{address.port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application, or answer it (403 if it is refused)."""
        answer = self._answer(scope) if scope["type"] in ("http", "websocket") else None
        if answer is None:
            await self._app(scope, receive, _unframed(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await answer(scope, receive, send)

    def _answer(self, scope: Scope) -> Response | None:
        """Return a refusal or a redirection; None for a request that may reach the page."""
        request = HTTPConnection(scope)
        if self._is_own(request):
            if _equal(request.cookies.get(self._cookie, ""), self._secret):
                return None
            if _equal(request.query_params.get("token", ""), self._address.token):
                # Lax: this redirection, which began in a local file, shall send the cookie.
                page = RedirectResponse(str(request.url.remove_query_params("token")), 303)
                page.set_cookie(
                    self._cookie, self._secret, _COOKIE_S, httponly=True, samesite="lax"
                )
                return page
        return PlainTextResponse("glsim tune: open the address that the command printed\n", 403)

    def _is_own(self, request: HTTPConnection) -> bool:
        """Whether a request names this host, and does not come from a page of another origin.

        A foreign name may lead to 127.0.0.1.
        """
        host = request.headers.get("host", "")
        try:
            name = urlsplit(f"//{host}").hostname
            origin = urlsplit(request.headers.get("origin", f"http://{host}")).netloc
        except ValueError:
            return False
        known = name in (*_LOOPBACK, self._address.host) or self._address.host in _EVERY_HOST
        return known and origin == host


def _equal(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())


def _unframed(send: Send) -> Send:
    """Wrap ``send`` to forbid other pages to show the answer in a frame."""

    async def send_with_header(message: Message) -> None:
        if message["type"] == "http.response.start":
            policy = (b"content-security-policy", b"frame-ancestors 'none'")
            message["headers"] = [*message["headers"], policy, (b"referrer-policy", b"no-referrer")]
        await send(message)

    return send_with_header


def _write_private(name: str, text: str) -> Path | None:
    """Write a file of mode 0600 in the cache folder; return None without a cache folder."""
    try:
        path = cache_folder() / name
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, written = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
        Path(written).replace(path)
    except (OSError, ConfigError):
        return None
    return path


def _read_state() -> dict[str, Any]:
    try:
        state = json.loads(read_regular(cache_folder() / "tune.json", _LARGEST))
    except (OSError, ValueError, ConfigError):
        return {}
    return state if isinstance(state, dict) else {}


def _write_state(state: dict[str, Any]) -> None:
    _write_private("tune.json", json.dumps(state))


def cookie_secret() -> str:
    """Return the value of the cookie, equal at every start, so that bookmarks work."""
    state = _read_state()
    if not isinstance(state.get("secret"), str):
        state["secret"] = secrets.token_urlsafe(24)
        _write_state(state)
    return str(state["secret"])


def _start_key(start: Tuning, command: str) -> str:
    return text_hash("\n".join([str(Path.cwd()), command, json.dumps(asdict(start))]))


def keep_tuning(start: Tuning, command: str, tuning: Tuning) -> None:
    """Save the last tuning of a command, identified by its start tuning, words and folder."""
    state, key = _read_state(), _start_key(start, command)
    kept = state.get("tunings", {})
    others = [(k, v) for k, v in kept.items() if k != key] if isinstance(kept, dict) else []
    _write_state(state | {"tunings": dict([*others, (key, asdict(tuning))][-_MOST_KEPT:])})


def kept_tuning(start: Tuning, command: str) -> Tuning | None:
    """Return the tuning that ``keep_tuning`` saved last for a command; None if there is none."""
    try:
        kept = _read_state()["tunings"][_start_key(start, command)]
        return TypeAdapter(Tuning).validate_python(kept)
    except (KeyError, TypeError, ValueError):
        return None
