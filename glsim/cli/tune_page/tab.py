"""One open tab: its history of tunings, its drawing loop, and calls of its elements."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from nicegui import Client, background_tasks

from glsim.cli.tune_page.access import keep_tuning, kept_tuning
from glsim.cli.tune_page.preview import Picture, pack
from glsim.cli.tune_page.session import TuneSession
from glsim.cli.tune_page.tuning import History, StageCode, Tuning
from glsim.core.errors import GlsimError
from glsim.core.reason import Reason
from glsim.sensors.sensor import Sensor

#: Pause between a painted picture and its figures, seconds: normally, and while the page plays. To
#: show figures takes the browser as long as to show a picture.
_REST, _REST_PLAYING = 0.15, 1.5
#: Seconds that a browser's request waits for a picture, and that Ctrl-C waits for the server.
_WAITING: Final = 2.0


class Elements(NamedTuple):
    """Functions of the page's elements.

    Attributes:
        refresh: show the settings of the newest picture.
        reload: read the sensor's own values again.
        show_problem: show a message above the code, or clear it if empty.
        mark_code: mark the lines that a driver's message names, or clear the marks if empty.
    """

    refresh: Callable[[], None]
    reload: Callable[[], None]
    show_problem: Callable[[str], None]
    mark_code: Callable[[str], None]


class TuneTab:
    """Tunings and pictures of a tab."""

    def __init__(
        self, session: TuneSession, client: Client, build: Callable[[TuneTab], Elements]
    ) -> None:
        """Start from the last settings of this command, and build the page's elements."""
        self.session, self.client = session, client
        self.history = History(session.start)
        self.picture: Picture | None = None
        self.selected, self.playing, self.closed = "", False, False
        self.packet: bytes | None = None
        self.other_packet: bytes | None = None
        self.other_figures: dict[str, Any] | None = None
        self._drawn_at = 0.0
        self._number = 0
        self._presented = asyncio.Event()
        self._drawing = self._wanted = self._following = False
        self._followed: Picture | None = None
        self._file_times: dict[Path, float] = {}
        last = kept_tuning(session.start, session.command)
        self.restored = last is not None and self.history.change(last)
        self._elements = build(self)

    # what the page does

    def show_settings(self) -> None:
        """Show the newest picture's settings in the panels."""
        with self.client:
            self._elements.refresh()

    def show_problem(self, message: str, *, of_code: bool = False) -> None:
        """Show a message, or clear it if empty; of_code: the typed code does not compile."""
        with self.client:
            (self._elements.mark_code if of_code else self._elements.show_problem)(message)

    def call(self, name: str, *given: Any) -> None:
        """Call a JavaScript function of assets/tune.js."""
        if not self.closed:
            listed = ", ".join(json.dumps(value) for value in (name, *given))
            self.client.run_javascript(f"tuneCall({listed})")

    async def begin(self) -> None:
        """Draw the first picture, after the browser has connected."""
        reasons = [[r.name.lower(), r.help] for r in Reason]
        self.call("build", "tune-view", "tune-figures", reasons, self.client.id)
        await self.refresh()
        await self.session.read_recording()
        if self.session.recorded:
            self.call("recording", self.session.recorded, None)
            self._followed = None
            await self.follow()

    def close(self) -> None:
        """Stop drawing, after the browser has disconnected."""
        self.closed, self.playing = True, False

    # what changes

    def change(self, tuning: Tuning, what: str = "") -> None:
        """Make a tuning the current tuning, and draw it soon."""
        if self.history.change(tuning, what):
            background_tasks.create(self.refresh(), name="glsim tune")

    def set_value(self, name: str, value: Any) -> None:
        """Change one value, named as in ``--set``; None restores the sensor's value."""
        self.change(self.history.now.with_value(name, value), name)

    async def set_code(self, stage: str, code: StageCode | None) -> None:
        """Change the GLSL of a stage; None restores the sensor's code.

        Code that does not compile is marked and changes nothing.
        """
        tuning = self.history.now.with_code(stage, code)
        if tuning != self.history.now:
            try:
                await self._draw(tuning)
            except GlsimError as error:
                self.show_problem(str(error), of_code=True)
                return
            self.history.change(tuning, f"code {stage}")
            self._present()
        self.show_problem("", of_code=True)

    def toggle_play(self) -> None:
        """Start or stop playing the frames in sequence."""
        self.playing = not self.playing
        self.show_settings()
        if self.playing:
            self._next_frame()

    def _next_frame(self) -> None:
        now = self.history.now
        count = self.picture.frames if self.picture else 1
        self.change(replace(now, frame=(now.frame + 1) % count), "frame")

    async def keep_other(self) -> None:
        """Keep the shown settings as setting B, for comparison."""
        if self.picture is not None:
            self.other_packet = self.packet
            self.call("showOther", f"/tune/other/{self.client.id}?n={self._number}")
            self.other_figures = await self.session.measure(figures_of, self.picture)
            await self.refresh()

    async def drop_other(self) -> None:
        """Remove setting B and show the current settings alone."""
        self.other_packet = self.other_figures = None
        self.call("showOther", None)
        await self.refresh()

    # what is drawn

    async def refresh(self) -> None:
        """Draw the current tuning; requests during a drawing lead to one more drawing."""
        self._wanted = True
        if self._drawing:
            return
        self._drawing = True
        try:
            while self._wanted and not self.closed:
                self._wanted = False
                tuning = self.history.now
                try:
                    await self._draw(tuning)
                except GlsimError as error:
                    self._refused(tuning, str(error))
                else:
                    self._present()
        finally:
            self._drawing = False

    async def _draw(self, tuning: Tuning) -> None:
        self._drawn_at = time.time()
        self.picture = await self.session.on_gl(self.session.preview.draw, tuning)

    def _present(self) -> None:
        """Give the newest picture to the browser."""
        if self.picture is None or self.closed:
            return
        self._number += 1
        self.packet = pack(self.picture.frame, self._number)
        self._presented.set()
        self.show_problem("")

    async def watch(self) -> None:
        """Reload the sensor's own files after another program has changed them."""
        if self.picture is None:
            return
        times = _times(self.picture.sensor)
        known, self._file_times = self._file_times, times
        if any(t != known[f] if f in known else t > self._drawn_at for f, t in times.items()):
            self.session.preview.reload()
            self._elements.reload()
            await self.refresh()

    async def follow(self) -> None:
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

    async def packet_after(self, number: int) -> bytes | None:
        """Wait up to 2 s for a picture newer than ``number``; return its packet or None.

        The browser always has such a request open, which saves announcing a picture through the
        socket. It asks before it paints: while the page plays, the next frame is drawn meanwhile.
        """
        if self.playing and number >= self._number and not self._drawing:
            self._next_frame()
        if self._number <= number:
            self._presented.clear()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._presented.wait(), _WAITING)
        return self.packet if self._number > number else None

    def _refused(self, tuning: Tuning, why: str) -> None:
        """Show why a tuning cannot be drawn, and return to the tuning before it."""
        if self.closed:
            return
        self.playing = False
        self.show_problem(why)
        if self.picture is None or tuning != self.picture.tuning:  # if equal, a file has changed
            if self.history.refuse(tuning) and self.picture is None:
                self._wanted = True
            self.show_settings()


def _times(sensor: Sensor) -> dict[Path, float]:
    specs = [stage.spec for stage in sensor.stages]
    sources = [spec.source for spec in specs if spec.source is not None]
    files = {sensor.file, *(Path(spec.file) for spec in specs if spec.source is None)}
    files = files.union(*(source.files for source in sources))
    return {file: file.stat().st_mtime for file in files if file.is_file()}


def figures_of(picture: Picture) -> dict[str, Any]:
    """Compute the figures of a picture, on the measuring thread."""
    from glsim.cli.tune_page.figures import frame_figures  # takes 0.2 s

    return {**frame_figures(picture.frame), "milliseconds": round(picture.milliseconds, 1)}
