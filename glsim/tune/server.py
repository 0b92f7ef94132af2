"""Serve a page to the user's browsers alone, on loopback unless asked otherwise."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from fastapi import Response
from nicegui import Client, app, ui

from glsim.tune.address import Address
from glsim.tune.connection import TimedConnection
from glsim.tune.gate import Gate
from glsim.tune.kept import cookie_secret
from glsim.tune.tab import Tab

ASSETS = Path(__file__).parent / "assets"

#: How long a silent tab is kept, seconds: the first frame compiles shaders and takes seconds on a
#: busy machine. A tab that is closed says so and frees its context at once.
_PATIENCE = 20
#: Bounds of what one user's browsers need: 8 connections a tab; a link of 60,000 characters; the
#: code of a stage as it is typed.
_LAST_S = 0.8  # after the server's own second
_IDLE_S = 10  # the page asks for its next picture all the time
_CONNECTIONS, _LARGEST_HEAD, _LARGEST_MESSAGE = 100, 1 << 17, 1 << 20


def serve(
    open_tab: Callable[[Client, str], Tab],
    stop: Callable[[], object],
    address: Address,
    say: Callable[[str], None],
    title: str,
) -> None:
    """Serve a page at an address until the process is interrupted.

    Args:
        open_tab: builds the elements of a new tab; takes NiceGUI's client and the address' link.
        stop: called at the end.
        address: to serve at.
        say: prints the next address when one was used.
        title: of the page.
    """
    tabs: dict[str, Tab] = {}

    cookie = f"glsim_tune_{address.port}"
    app.add_middleware(
        Gate, use=partial(_use, address, say), secret=cookie_secret(), cookie=cookie,
        host=address.host, port=address.port,
    )  # fmt: skip
    app.add_static_files("/tune/assets", str(ASSETS), max_cache_age=0)

    @app.get("/tune/other/{tab}")
    async def other_picture(tab: str) -> Response:
        return _answer(tabs[tab].other_packet if tab in tabs else None, 404)

    @app.get("/tune/next/{tab}")
    async def next_picture(tab: str, after: int) -> Response:
        if tab not in tabs:
            return Response(status_code=404)
        return _answer(await tabs[tab].packet_after(after), 204)

    @app.post("/tune/closed/{tab}")
    async def closed(tab: str) -> None:
        if tab in tabs:
            await tabs[tab].rest()

    @ui.page("/", title=title)
    async def index(client: Client, s: str = "") -> None:
        tab = tabs[client.id] = open_tab(client, s)

        async def forget() -> None:
            tabs.pop(client.id, None)
            await tab.close()

        client.on_delete(forget)
        await client.connected(timeout=60)
        await tab.begin()

    app.on_shutdown(stop)
    try:
        ui.run(
            host=address.host, port=address.port, fd=address.listening.fileno(), show=False,
            reload=False, show_welcome_message=False, dark=None, tailwind=False,
            reconnect_timeout=_PATIENCE, title=title,
            favicon=ASSETS / "icon.svg",
            # On one machine: to compress 1.5 MB of layers takes longer than to draw and send them.
            gzip_middleware_factory=None,
            timeout_graceful_shutdown=1, limit_concurrency=_CONNECTIONS, timeout_keep_alive=_IDLE_S,
            http=TimedConnection,
            h11_max_incomplete_event_size=_LARGEST_HEAD, ws_max_size=_LARGEST_MESSAGE,
        )  # fmt: skip
    finally:
        address.remove_file()
        # The interpreter would wait for a frame that is being drawn, or measured.
        end = threading.Timer(_LAST_S, os._exit, (1,))
        end.daemon = True
        end.start()


def _use(address: Address, say: Callable[[str], None], ticket: str) -> bool:
    """Return whether a ticket is valid; if so, say the address with the next one."""
    valid = address.use(ticket)
    if valid:
        say(f"another browser: {address.url}")
    return valid


def _answer(packet: bytes | None, without: int) -> Response:
    """Answer with a picture's packet.

    Args:
        without: the status if there is none.
    """
    if packet is None:
        return Response(status_code=without)
    return Response(packet, media_type="application/octet-stream")
