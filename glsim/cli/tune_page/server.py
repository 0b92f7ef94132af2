"""Serve the page to the user's browsers alone."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from fastapi import Response
from nicegui import Client, app, ui

from glsim.cli.tune_page.access import AccessCheck, PageAddress, cookie_secret
from glsim.cli.tune_page.page import TunePage
from glsim.cli.tune_page.session import TuneSession

ASSETS = Path(__file__).parent / "assets"
#: How long a silent tab is kept, s: the first frame compiles shaders, seconds on a busy machine.
_PATIENCE_S = 20
_LAST_S = 0.8  # after the server's own second


def serve(session: TuneSession, address: PageAddress) -> None:
    """Serve the page at an address until the process is interrupted."""
    pages: dict[str, TunePage] = {}
    app.add_middleware(AccessCheck, address=address, secret=cookie_secret())
    app.add_static_files("/tune/assets", str(ASSETS), max_cache_age=0)

    @app.get("/tune/other/{tab}")
    async def other_picture(tab: str) -> Response:
        return _answer(pages[tab].other_packet if tab in pages else None)

    @app.get("/tune/next/{tab}")
    async def next_picture(tab: str, after: int) -> Response:
        if tab not in pages:
            return Response(status_code=404)
        return _answer(await pages[tab].packet_after(after))

    @ui.page("/", title="glsim tune")
    async def index(client: Client, s: str = "") -> None:
        page = pages[client.id] = TunePage(session, client, s)
        client.on_delete(lambda: pages.pop(client.id).close())
        await client.connected(timeout=60)
        await page.begin()

    app.on_shutdown(session.stop)
    try:
        ui.run(
            host=address.host, port=address.port, fd=address.listening.fileno(), show=False,
            reload=False, show_welcome_message=False, dark=None, tailwind=False,
            reconnect_timeout=_PATIENCE_S, title="glsim tune", favicon=ASSETS / "icon.svg",
            # On one machine: to compress 1.5 MB of layers takes longer than to draw and send them.
            gzip_middleware_factory=None, timeout_graceful_shutdown=1,
        )  # fmt: skip
    finally:
        # The interpreter would wait for a frame that is being drawn, or measured.
        end = threading.Timer(_LAST_S, os._exit, (1,))
        end.daemon = True
        end.start()


def _answer(packet: bytes | None) -> Response:
    """Answer with a picture's packet, or with 204 for none."""
    if packet is None:
        return Response(status_code=204)
    return Response(packet, media_type="application/octet-stream")
