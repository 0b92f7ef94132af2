"""Web page of one tab: its elements, their updates, and the server."""

from __future__ import annotations

import asyncio
import os
import threading
from pathlib import Path

from fastapi import Response
from nicegui import Client, app, ui

from glsim.cli.tune_page.access import (
    AccessCheck,
    PageAddress,
    cookie_secret,
    keep_tuning,
    kept_tuning,
)
from glsim.cli.tune_page.editor import CodeEditor
from glsim.cli.tune_page.panel import StageList
from glsim.cli.tune_page.preview import Picture
from glsim.cli.tune_page.session import TuneSession
from glsim.cli.tune_page.tab import TuneTab, figures_of
from glsim.cli.tune_page.topbar import TopBar
from glsim.core.reason import Reason
from glsim.sensors.sensor import Sensor

#: Pause between a painted picture and its figures, and the same while the page plays, seconds:
#: to show figures takes the browser as long as a picture.
_REST, _REST_PLAYING = 0.15, 1.5

ASSETS = Path(__file__).parent / "assets"
#: How long a silent tab is kept, s: the first frame compiles shaders, seconds on a busy machine.
_PATIENCE_S = 20
_LAST_S = 0.8  # after the server's own second

_HEAD = """
<link rel="stylesheet" href="/tune/assets/tune.css">
<script>window.tuneCall = (name, ...given) => window.glsimTune
  ? window.glsimTune[name](...given) : (window.tuneQueue ??= []).push([name, given]);</script>
<script type="module" src="/tune/assets/tune.js"></script>
"""


class TunePage(TuneTab):
    """Web page of one open tab."""

    def __init__(self, session: TuneSession, client: Client) -> None:
        """Build the page's controls and pictures for a newly opened browser tab."""
        super().__init__(session, client)
        self._following = False
        self._followed: Picture | None = None
        self._file_times: dict[Path, float] = {}
        said = self._open_kept()
        ui.add_head_html(_HEAD)
        ui.dark_mode(None)
        ui.on("tune_shown", self._follow)
        with ui.element("main").classes("tune"):
            with ui.element("header").classes("top"):
                self.top = TopBar(self)
            with ui.element("nav").classes("left").props('aria-label="stages"'):
                self.stages = StageList(self, lambda: self.editor.new_stage())
            ui.element("section").classes("view").props('id="tune-view" aria-label="images"')
            ui.element("aside").classes("figures").props('id="tune-figures" aria-label="figures"')
            with ui.element("section").classes("code").props('aria-label="code"'):
                self.editor = CodeEditor(self)
        if said:
            ui.notify(said, type="warning", timeout=12_000, close_button="ok")
        ui.timer(1.0, self._watch)

    def _open_kept(self) -> str:
        """Open the last settings of this command, if there are any; return a message."""
        kept = kept_tuning(self.session.start, self.session.command)
        if kept is None or not self.history.change(kept):
            return ""
        return "these are your last settings: undo (Ctrl+Z) leads to those of the command"

    async def begin(self) -> None:
        """Draw the first picture, after the browser has connected."""
        reasons = [[r.name.lower(), r.help] for r in Reason]
        self.call("build", "tune-view", "tune-figures", reasons, self.client.id)
        await self.refresh()
        await self.session.read_recording()
        if self.session.recorded:
            self.call("recording", self.session.recorded, None)
            self._followed = None
            await self._follow()

    def close(self) -> None:
        """Stop drawing, after the browser has disconnected."""
        self.closed, self.playing = True, False

    async def _watch(self) -> None:
        """Reload the sensor's own files after another program has changed them."""
        if self.picture is None:
            return
        times = _times(self.picture.sensor)
        known, self._file_times = self._file_times, times
        if any(t != known[f] if f in known else t > self.drawn_at for f, t in times.items()):
            self.session.preview.reload()
            self.stages.reload()
            await self.refresh()

    def show_settings(self) -> None:
        """Show the newest picture's settings in the panels."""
        with self.client:
            if self.picture is not None:
                self.stages.refresh(self.picture)
                self.editor.refresh(self.picture)
            self.top.refresh()

    def show_problem(self, message: str, *, of_code: bool = False) -> None:
        """Show a message above the code; an empty message clears it."""
        with self.client:
            (self.editor.mark if of_code else self.editor.problem)(message)

    async def _follow(self) -> None:
        """Show settings and figures of the newest picture, after the browser has painted it."""
        if self._following:
            return
        self._following = True
        try:
            while self.picture is not self._followed and not self.closed:
                self._followed = picture = self.picture
                self.show_settings()
                start, command = self.session.start, self.session.command
                await self.session.measure(keep_tuning, start, command, self.history.now)
                await asyncio.sleep(_REST_PLAYING if self.playing else _REST)
                if picture is not None and (picture is self.picture or self.playing):
                    await self._measure(picture)
        finally:
            self._following = False

    async def _measure(self, picture: Picture) -> None:
        figures = await self.session.measure(figures_of, picture)
        self.call("statistics", figures, self.other_figures)
        if self.session.recorded and not self.playing:
            from glsim.cli.tune_page.figures import tuned_figures

            here = await self.session.measure(tuned_figures, picture.frame)
            self.call("recording", self.session.recorded, here)


def _times(sensor: Sensor) -> dict[Path, float]:
    """Return the modification time of the sensor's file and of its stages' files."""
    specs = [stage.spec for stage in sensor.stages]
    sources = [spec.source for spec in specs if spec.source is not None]
    files = {sensor.file, *(Path(spec.file) for spec in specs if spec.source is None)}
    files = files.union(*(source.files for source in sources))
    return {file: file.stat().st_mtime for file in files if file.is_file()}


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
    async def index(client: Client) -> None:
        page = pages[client.id] = TunePage(session, client)
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
            proxy_headers=False,  # else a local user forges the address that AccessCheck looks up
        )  # fmt: skip
    finally:
        # The interpreter would wait for a frame that is being drawn, or measured.
        end = threading.Timer(_LAST_S, os._exit, (1,))
        end.daemon = True
        end.start()


def _answer(packet: bytes | None) -> Response:
    """Answer a request with a picture's packet, or with status 204 if there is none."""
    if packet is None:
        return Response(status_code=204)
    return Response(packet, media_type="application/octet-stream")
