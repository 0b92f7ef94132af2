"""Web page of one tab: its elements, and the server."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from fastapi import Response
from nicegui import Client, app, ui

from glsim.cli.tune_page.access import AccessCheck, PageAddress, cookie_secret
from glsim.cli.tune_page.editor import CodeEditor
from glsim.cli.tune_page.panel import StageList
from glsim.cli.tune_page.session import TuneSession
from glsim.cli.tune_page.tab import Elements, TuneTab
from glsim.cli.tune_page.topbar import TopBar

ASSETS = Path(__file__).parent / "assets"
#: Seconds for which a silent tab is kept; the first frame compiles shaders, which is slow.
_PATIENCE_S = 20
_LAST_S = 0.8  # seconds after the server's timeout of 1 s

_HEAD = """
<link rel="stylesheet" href="/tune/assets/tune.css">
<script>window.tuneCall = (name, ...given) => window.glsimTune
  ? window.glsimTune[name](...given) : (window.tuneQueue ??= []).push([name, given]);</script>
<script type="module" src="/tune/assets/tune.js"></script>
"""


def build_page(tab: TuneTab) -> Elements:
    """Build the page's controls and pictures for a newly opened browser tab."""
    ui.add_head_html(_HEAD)
    ui.dark_mode(None)
    ui.on("tune_shown", tab.follow)
    with ui.element("main").classes("tune"):
        with ui.element("header").classes("top"):
            top = TopBar(tab)
        with ui.element("nav").classes("left").props('aria-label="stages"'):
            stages = StageList(tab, lambda: editor.new_stage())
        ui.element("section").classes("view").props('id="tune-view" aria-label="images"')
        ui.element("aside").classes("figures").props('id="tune-figures" aria-label="figures"')
        with ui.element("section").classes("code").props('aria-label="code"'):
            editor = CodeEditor(tab)
    if tab.restored:
        said = "these are your last settings: undo (Ctrl+Z) leads to those of the command"
        ui.notify(said, type="warning", position="top", timeout=12_000, close_button="ok")
    ui.timer(1.0, tab.watch)

    def refresh() -> None:
        if tab.picture is not None:
            stages.refresh(tab.picture)
            editor.refresh(tab.picture)
        top.refresh()

    return Elements(refresh, stages.reload, editor.problem, editor.mark)


def serve(session: TuneSession, address: PageAddress) -> None:
    """Serve the page at an address until the process is interrupted."""
    tabs: dict[str, TuneTab] = {}
    app.add_middleware(AccessCheck, address=address, secret=cookie_secret())
    app.add_static_files("/tune/assets", str(ASSETS), max_cache_age=0)

    @app.get("/tune/other/{tab}")
    async def other_picture(tab: str) -> Response:
        return _answer(tabs[tab].other_packet if tab in tabs else None)

    @app.get("/tune/next/{tab}")
    async def next_picture(tab: str, after: int) -> Response:
        if tab not in tabs:
            return Response(status_code=404)
        return _answer(await tabs[tab].packet_after(after))

    @ui.page("/", title="glsim tune")
    async def index(client: Client) -> None:
        tab = tabs[client.id] = TuneTab(session, client, build_page)
        client.on_delete(lambda: tabs.pop(client.id).close())
        await client.connected(timeout=60)
        await tab.begin()

    app.on_shutdown(session.stop)
    try:
        ui.run(
            host=address.host, port=address.port, fd=address.listening.fileno(), show=False,
            reload=False, show_welcome_message=False, dark=None, tailwind=False,
            reconnect_timeout=_PATIENCE_S, title="glsim tune", favicon=ASSETS / "icon.svg",
            # No compression on one machine: it takes longer than to draw and send 1.5 MB of layers.
            gzip_middleware_factory=None, timeout_graceful_shutdown=1,
            proxy_headers=False,  # else a local user forges the address that AccessCheck looks up
        )  # fmt: skip
    finally:
        # Exit without waiting for a frame that is being drawn or measured.
        end = threading.Timer(_LAST_S, os._exit, (1,))
        end.daemon = True
        end.start()


def _answer(packet: bytes | None) -> Response:
    """Answer a request with a picture's packet, or with status 204 if there is none."""
    if packet is None:
        return Response(status_code=204)
    return Response(packet, media_type="application/octet-stream")
