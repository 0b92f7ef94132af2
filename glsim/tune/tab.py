"""One open tab of a page: the pictures that it takes, and the calls of its scripts."""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from typing import Any, Final

from nicegui import Client, ui

#: Longest wait of a browser's request for a picture, and of the server's end after Ctrl-C, seconds.
_WAITING: Final = 2.0

_HEAD = """
<link rel="stylesheet" href="/tune/assets/tune.css">
<script>window.tuneCall = (name, ...given) => window.glsimTune
  ? window.glsimTune[name](...given) : (window.tuneQueue ??= []).push([name, given]);</script>
<script type="module" src="/tune/assets/tune.js"></script>
"""


class Tab:
    """One open tab.

    Attributes:
        client: NiceGUI's.
        tab: its identity in addresses.
    """

    def __init__(self, client: Client) -> None:
        self.client, self.tab = client, client.id
        self._number = 0
        self._packet: bytes | None = None
        self._presented = asyncio.Event()
        self._closed = False

    async def begin(self) -> None:
        """Show the first picture; called when the browser is connected."""
        raise NotImplementedError

    @property
    def other_packet(self) -> bytes | None:
        """The picture beside the newest one; None without."""
        return None

    def add_head(self) -> None:
        """Add the scripts and the styles to the page; the first thing that builds it."""
        ui.add_head_html(_HEAD)

    def call(self, name: str, *given: Any) -> None:
        """Call a function of assets/tune.js."""
        if not self._closed:
            listed = ", ".join(json.dumps(value) for value in (name, *given))
            self.client.run_javascript(f"tuneCall({listed})")

    def publish(self, packet: bytes, number: int) -> None:
        """Hand the next picture to the browser. number: in the packet's head; rises."""
        self._packet, self._number = packet, number
        self._presented.set()

    async def packet_after(self, number: int) -> bytes | None:
        """Wait up to 2 s for a picture later than ``number``; return its packet, None without one.

        The browser always has such a request open, which saves announcing a picture through the
        socket.
        """
        if self._packet is None or self._number <= number:
            self._presented.clear()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._presented.wait(), _WAITING)
        return self._packet if self._number > number else None

    async def rest(self) -> None:
        """Free what the tab holds, until its next picture; called when it is closed or hidden."""
        self._packet = None

    async def close(self) -> None:
        """Free all; called when the browser has gone."""
        self._closed = True
        await self.rest()

    # looks

    def follow_system_theme(self) -> None:
        """Be dark or light as the system is, until the user chooses."""
        self.dark = ui.dark_mode(None)

    async def change_theme(self) -> bool:
        """Change between dark and light; return whether the page is dark now."""
        dark = not await self.is_dark()
        self.dark.set_value(dark)
        self.call("themed")
        return dark

    async def is_dark(self) -> bool:
        """Ask the browser whether the page is dark, by system or user choice."""
        script = "document.body.classList.contains('body--dark')"
        return bool(await self.client.run_javascript(script, timeout=60.0))
