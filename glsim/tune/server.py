"""Serve the page: one GL thread, one bench per open tab, loopback unless asked otherwise."""

from __future__ import annotations

from pathlib import Path

from fastapi import Response
from nicegui import Client, app, ui

from glsim.errors import ConfigError
from glsim.tune.address import Address
from glsim.tune.gate import Gate
from glsim.tune.page import Page
from glsim.tune.state import tuning_of_link
from glsim.tune.workshop import Workshop

ASSETS = Path(__file__).parent / "assets"

#: How long a silent tab is kept, seconds: the first frame compiles shaders and takes seconds on a
#: busy machine. A tab that is closed says so and frees its context at once.
_PATIENCE = 20


def serve(workshop: Workshop, address: Address) -> None:
    """Serve the page at an address until the process is interrupted."""
    pages: dict[str, Page] = {}
    app.add_middleware(Gate, token=address.token, cookie=f"glsim_tune_{address.port}")
    app.add_static_files("/tune/assets", str(ASSETS), max_cache_age=0)

    @app.get("/tune/other/{tab}")
    async def other_picture(tab: str) -> Response:
        return _answer(pages[tab].comparison.packet if tab in pages else None, 404)

    @app.get("/tune/next/{tab}")
    async def next_picture(tab: str, after: int) -> Response:
        if tab not in pages:
            return Response(status_code=404)
        return _answer(await pages[tab].packet_after(after), 204)

    @app.post("/tune/closed/{tab}")
    async def closed(tab: str) -> None:
        if tab in pages:
            await pages[tab].rest()

    @ui.page("/", title="glsim tune")
    async def index(client: Client, s: str = "") -> None:
        start, problem = workshop.start, ""
        if s:
            try:
                start = tuning_of_link(s)
            except ConfigError as error:
                problem = str(error)
        page = Page(workshop, client, start)
        page.build(problem)
        pages[client.id] = page

        async def forget() -> None:
            pages.pop(client.id, None)
            await page.close()

        client.on_delete(forget)
        await client.connected(timeout=60)
        await page.begin()

    ui.run(
        host=address.host, port=address.port, fd=address.listening.fileno(), show=False,
        reload=False, show_welcome_message=False, dark=None, tailwind=False,
        reconnect_timeout=_PATIENCE, title="glsim tune",
        favicon=ASSETS / "icon.svg",
        # On one machine: to compress 1.5 MB of layers takes longer than to draw and send them.
        gzip_middleware_factory=None,
    )  # fmt: skip


def _answer(packet: bytes | None, without: int) -> Response:
    """Answer with a picture's packet.

    Args:
        without: the status if there is none.
    """
    if packet is None:
        return Response(status_code=without)
    return Response(packet, media_type="application/octet-stream")
