"""State of one open tab without its elements: history of tunings, and drawing loop."""

from __future__ import annotations

import asyncio
import json
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

from nicegui import Client, background_tasks

from glsim.cli.tune_page.preview import Picture, pack
from glsim.cli.tune_page.session import TuneSession
from glsim.cli.tune_page.tuning import History, StageCode, Tuning
from glsim.core.errors import GlsimError

#: Longest wait of a browser's request for a picture, and of the server's end after Ctrl-C, seconds.
_WAITING: Final = 2.0


class TuneTab:
    """Tunings and pictures of a tab, which ``TunePage`` shows.

    Attributes:
        picture: the newest one.
        selected: the open section of the left column.
        playing: whether frame follows frame.
        packet: the newest picture for the browser.
        other_packet: the picture of setting B, or None.
        other_figures: its figures, or None.
        drawn_at: when the newest picture was asked for, seconds since the epoch.
    """

    def __init__(self, session: TuneSession, client: Client) -> None:
        self.session, self.client = session, client
        self.history = History(session.start)
        self.picture: Picture | None = None
        self.selected, self.playing, self.closed = "", False, False
        self.packet: bytes | None = None
        self.other_packet: bytes | None = None
        self.other_figures: dict[str, Any] | None = None
        self.drawn_at = 0.0
        self._number = 0
        self._presented = asyncio.Event()
        self._drawing = self._wanted = False

    # what the page does

    def show_settings(self) -> None:
        """Show the newest picture's settings in the panels."""
        raise NotImplementedError

    def show_problem(self, message: str, *, of_code: bool = False) -> None:
        """Show a message, or clear it if empty; of_code: the typed code does not compile."""
        raise NotImplementedError

    def call(self, name: str, *given: Any) -> None:
        """Call a JavaScript function of assets/tune.js."""
        if not self.closed:
            listed = ", ".join(json.dumps(value) for value in (name, *given))
            self.client.run_javascript(f"tuneCall({listed})")

    # what changes

    def change(self, tuning: Tuning, what: str = "") -> None:
        """Make a tuning the current tuning, and draw it soon.

        Args:
            what: name of the change, for undo.
        """
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
        self.drawn_at = time.time()
        self.picture = await self.session.on_gl(self.session.preview.draw, tuning)

    def _present(self) -> None:
        """Give the newest picture to the browser."""
        if self.picture is None or self.closed:
            return
        self._number += 1
        self.packet = pack(self.picture.frame, self._number)
        self._presented.set()
        self.show_problem("")

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
        if self.picture is None or tuning != self.picture.tuning:  # else a file has changed
            if self.history.refuse(tuning) and self.picture is None:
                self._wanted = True
            self.show_settings()


def figures_of(picture: Picture) -> dict[str, Any]:
    """Compute the figures of a picture, on the measuring thread."""
    from glsim.cli.tune_page.figures import frame_figures  # takes 0.2 s

    return {**frame_figures(picture.frame), "milliseconds": round(picture.milliseconds, 1)}
