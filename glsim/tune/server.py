"""Serve the page: one GL thread, one bench per open tab, loopback unless asked otherwise."""

from __future__ import annotations

import asyncio
import secrets
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path

from fastapi import Response
from nicegui import Client, app, background_tasks, ui

from glsim.errors import ConfigError
from glsim.tune.gate import Gate
from glsim.tune.page import Page
from glsim.tune.state import tuning_of_link
from glsim.tune.workshop import Workshop

ASSETS = Path(__file__).parent / "assets"

#: How long a silent tab is kept, seconds: the first frame compiles shaders and takes seconds on a
#: busy machine. A tab that is closed says so and frees its context at once.
_PATIENCE = 20


def serve(
    workshop: Workshop,
    host: str = "127.0.0.1",
    port: int = 8137,
    *,
    browser: bool = True,
    announce: Callable[[str], None] = print,
) -> None:
    """Serve the page until the process is interrupted.

    host: an address of this machine. port: a free one is taken if it is in use. announce: called
    with the address, which holds the token. Raises ConfigError for a host that cannot be used.
    """
    token = secrets.token_urlsafe(24)
    port = _free_port(host, port)
    shown = f"[{host}]" if ":" in host else host
    address = f"http://{shown}:{port}/?token={token}"
    pages: dict[str, Page] = {}
    app.add_middleware(Gate, token=token, cookie=f"glsim_tune_{port}")
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

    async def tell() -> None:
        await _listening(host, port)
        announce(address)
        if browser:
            webbrowser.open(address)

    app.on_startup(lambda: background_tasks.create(tell(), name="address"))
    ui.run(
        host=host, port=port, show=False, reload=False, show_welcome_message=False, dark=None,
        tailwind=False, reconnect_timeout=_PATIENCE, title="glsim tune",
        favicon=ASSETS / "icon.svg",
        # On one machine: to compress 1.5 MB of layers takes longer than to draw and send them.
        gzip_middleware_factory=None,
    )  # fmt: skip


def _answer(packet: bytes | None, without: int) -> Response:
    """Answer with a picture's packet. without: the status if there is none."""
    if packet is None:
        return Response(status_code=without)
    return Response(packet, media_type="application/octet-stream")


async def _listening(host: str, port: int) -> None:
    """Wait until the server takes connections, which it does a moment after its start."""
    while True:
        try:
            _, writer = await asyncio.open_connection(host, port)
        except OSError:
            await asyncio.sleep(0.02)
        else:
            writer.close()
            return


def _free_port(host: str, port: int) -> int:
    """Return the port, or a free one if it is in use. Raises ConfigError."""
    for wanted in (port, 0):
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            with socket.socket(family) as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((host, wanted))
                return int(probe.getsockname()[1])
        except OSError as error:
            failure = error
    raise ConfigError(f"--host {host} --port {port}: {failure.strerror or failure}") from None
