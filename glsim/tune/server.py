"""Serve the page: one GL thread, one bench per open tab, loopback unless asked otherwise."""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
import webbrowser
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from fastapi import Response
from nicegui import Client, app, ui

from glsim.errors import ConfigError, GlsimError
from glsim.faces.base import FaceSource
from glsim.settings.schema import Settings
from glsim.tune.gate import Gate
from glsim.tune.recording import measure_recording
from glsim.tune.state import Tuning, tuning_of_link

log = logging.getLogger(__name__)

ASSETS = Path(__file__).parent / "assets"

_T = TypeVar("_T")


@dataclass
class Workshop:
    """What all tabs share: where frames come from, and the threads that draw and measure.

    base: the settings that a tab starts from. command: the part of a command line that names the
    faces, e.g. ``render face.obj``. real: folder of a recording, or None.
    """

    base: Settings
    open_sources: Callable[[Settings], Sequence[FaceSource]]
    command: str
    start: Tuning
    real: Path | None = None
    backend: str | None = None
    gl: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "gl"))
    measuring: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "measure"))
    packets: dict[str, bytes] = field(default_factory=dict)
    recorded: dict[str, Any] | None = None

    async def on_gl(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """Run a function on the GL thread."""
        return await asyncio.get_running_loop().run_in_executor(self.gl, function, *arguments)

    async def measure(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """Run a function beside the GL thread."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self.measuring, function, *arguments)

    async def read_recording(self) -> None:
        """Measure the real recording, once."""
        if self.real is None or self.recorded is not None:
            return
        try:
            self.recorded = await self.measure(measure_recording, self.real)
        except GlsimError as error:
            log.warning("%s", error)


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
    from glsim.tune.page import Page

    token = secrets.token_urlsafe(24)
    port = _free_port(host, port)
    shown = f"[{host}]" if ":" in host else host
    address = f"http://{shown}:{port}/?token={token}"
    app.add_middleware(Gate, token=token, cookie=f"glsim_tune_{port}")
    app.add_static_files("/tune/assets", str(ASSETS), max_cache_age=0)

    @app.get("/tune/frame/{tab}/{which}")
    def frame(tab: str, which: str) -> Response:
        packet = workshop.packets.get(f"{tab}/{which}")
        if packet is None:
            return Response(status_code=404)
        return Response(packet, media_type="application/octet-stream")

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
        client.on_delete(page.close)
        await client.connected(timeout=60)
        await page.begin()

    async def started() -> None:
        announce(address)
        if browser:
            webbrowser.open(address)

    app.on_startup(started)
    ui.run(
        host=host, port=port, show=False, reload=False, show_welcome_message=False, dark=None,
        tailwind=False, reconnect_timeout=5, title="glsim tune", favicon=ASSETS / "icon.svg",
    )  # fmt: skip


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
