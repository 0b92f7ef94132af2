"""The address of the page: a listening socket, and a random token."""

from __future__ import annotations

import secrets
import socket
import threading
import webbrowser
from dataclasses import dataclass, field

from glsim.errors import ConfigError


@dataclass(frozen=True)
class Address:
    """A socket that takes connections before anything serves them, and the token of its page.

    A browser needs a second to start; until the server is up, its request waits in the socket.
    """

    host: str
    listening: socket.socket
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def port(self) -> int:
        """The port, which may not be the wanted one."""
        return int(self.listening.getsockname()[1])

    @property
    def url(self) -> str:
        """The address of the page, with the token."""
        shown = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{shown}:{self.port}/?token={self.token}"

    def open_browser(self) -> None:
        """Open the page in the user's browser, on a thread: one in a terminal blocks."""
        threading.Thread(target=webbrowser.open, args=(self.url,), daemon=True).start()


def listen(host: str, port: int) -> Address:
    """Listen on a host of this machine; on a free port if ``port`` is in use.

    Raises ConfigError for a host that cannot be used.
    """
    for wanted in (port, 0):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            listening = socket.socket(family)  # fails for ::1 without IPv6
        except OSError as error:
            failure = error
            continue
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            # Connections inherit it. The server takes the socket by its descriptor and so does not
            # know that it is TCP: small answers would wait up to 40 ms for each other.
            listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            listening.bind((host, wanted))
            listening.listen()
        except OSError as error:
            listening.close()
            failure = error
        else:
            return Address(host, listening)
    raise ConfigError(f"--host {host} --port {port}: {failure.strerror or failure}") from None
