"""Work that waits until the browser has painted a picture: the panel and the figures."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress

from nicegui import background_tasks

from glsim.tune.bench import DrawnFrame

#: Longest wait for a tab to paint, seconds; a hidden one never does.
_PAINTING = 2.0


class AfterPainting:
    """Calls functions for the newest picture after it is painted.

    Args:
        newest: returns the newest picture; None ends all calls.
        playing: returns whether the page plays.
    """

    def __init__(
        self, newest: Callable[[], DrawnFrame | None], playing: Callable[[], bool]
    ) -> None:
        self._newest, self._playing = newest, playing
        self._painted = asyncio.Event()
        self._running: set[str] = set()

    def expect(self) -> None:
        """Note that a new picture is on its way to the browser."""
        self._painted.clear()

    def painted(self) -> None:
        """Note that the browser has painted it."""
        self._painted.set()

    def call(
        self, show: Callable[[DrawnFrame], Awaitable[None]], rest_s: float, play_s: float
    ) -> None:
        """Call ``show`` for the newest picture, again until there is no newer one.

        Args:
            rest_s, play_s: pause between painting and showing; the same while the page plays.
        """

        async def follow() -> None:
            try:
                shown = None
                while (picture := self._newest()) is not None and picture is not shown:
                    # Pictures and dragged sliders come first: showing figures takes as long.
                    with suppress(TimeoutError):
                        await asyncio.wait_for(self._painted.wait(), _PAINTING)
                    await asyncio.sleep(play_s if self._playing() else rest_s)
                    shown = self._newest()
                    if shown is not None:
                        await show(shown)
            finally:
                self._running.discard(show.__name__)

        if show.__name__ not in self._running:
            self._running.add(show.__name__)
            background_tasks.create(follow(), name=show.__name__)
