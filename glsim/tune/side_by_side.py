"""A second setting beside the current one: B beside A."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from glsim.errors import GlsimError
from glsim.tune.bench import DrawnFrame
from glsim.tune.desk import Desk
from glsim.tune.packet import pack
from glsim.tune.state import Tuning


class SideBySide:
    """Setting B beside the current one; its attributes are None without a B.

    Attributes:
        figures: its statistics.
        packet: its picture for the browser.
    """

    def __init__(
        self,
        page: Desk,
        draw: Callable[[Tuning], Awaitable[DrawnFrame]],
        measure: Callable[[DrawnFrame], dict[str, Any]],
    ) -> None:
        """Take what draws a tuning's picture, and what measures its figures."""
        self._page, self._draw, self._measure = page, draw, measure
        self._second: Tuning | None = None
        self._number = 0
        self.packet: bytes | None = None
        self.figures: dict[str, Any] | None = None

    async def keep(self) -> None:
        """Keep the current settings as B."""
        await self._show(self._page.history.now)

    async def swap(self) -> None:
        """Make B the current settings, and the current ones B."""
        if self._second is not None:
            second = self._second
            await self._show(self._page.history.now)
            self._page.change(second)

    async def drop(self) -> None:
        """Show the current settings alone."""
        self._second = self.figures = self.packet = None
        self._page.call("showOther", None)
        await self._page.refresh()

    async def _show(self, tuning: Tuning) -> None:
        page = self._page
        try:
            drawn = await self._draw(tuning)
        except GlsimError as error:
            ui.notify(str(error), type="negative")
            return
        self._second = tuning
        self._number += 1
        self.packet = pack(drawn.frame)
        page.call("showOther", f"/tune/other/{page.client.id}?n={self._number}")
        self.figures = await page.workshop.measure(self._measure, drawn)
        await page.refresh()
