"""The address of the page: a listening socket, and a ticket that lets one browser in."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import socket
import tempfile
import threading
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path

from glsim.errors import ConfigError

_TICKET_PAGE = """<!doctype html><meta charset="utf-8"><meta name="referrer" content="no-referrer">
<title>glsim</title><script>location.replace({url})</script>
"""


@dataclass
class Address:
    """A socket that takes connections before anything serves them, and the ticket of its page.

    A browser needs a second to start; until the server is up, its request waits in the socket.
    A ticket is used once: then the browser has a cookie, and the address of the page says nothing.
    """

    host: str
    listening: socket.socket
    ticket: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    _private: Path | None = None

    @property
    def port(self) -> int:
        """The port, which may not be the wanted one."""
        return int(self.listening.getsockname()[1])

    @property
    def url(self) -> str:
        """The address of the page, with the ticket."""
        shown = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{shown}:{self.port}/?ticket={self.ticket}"

    def use(self, ticket: str) -> bool:
        """Return whether this is the ticket; if so, the next one replaces it."""
        if not secrets.compare_digest(ticket.encode(), self.ticket.encode()):
            return False
        self.ticket = secrets.token_urlsafe(24)
        self.remove_file()
        return True

    def open_browser(self) -> None:
        """Open the page in the user's browser, on a thread: one in a terminal blocks.

        Everybody on the machine can read the arguments of a process. So the browser is given a file
        that the user alone can read, and which leads to the address.
        """
        self._private = Path(tempfile.mkdtemp(prefix="glsim-tune-"))  # mode 0700
        page = self._private / "open.html"
        with os.fdopen(os.open(page, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(_TICKET_PAGE.format(url=json.dumps(self.url)))
        threading.Thread(target=webbrowser.open, args=(page.as_uri(),), daemon=True).start()

    def remove_file(self) -> None:
        """Remove the file that ``open_browser`` wrote, if there is one."""
        if self._private is not None:
            shutil.rmtree(self._private, ignore_errors=True)
            self._private = None


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
