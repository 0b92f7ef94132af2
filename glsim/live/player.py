"""Play a stream to all tabs that look at it, as fast as they take the pictures."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, Protocol, TypeVar

from nicegui import background_tasks

from glsim.errors import GlsimError
from glsim.live.stream import LiveStream

_T = TypeVar("_T")

#: Pause after a frame that could not be read, seconds: a camera may be plugged in again.
_RETRY_S: Final = 1.0


class Screen(Protocol):
    """What shows the pictures: a tab."""

    def publish(self, packet: bytes, number: int) -> None:
        """Hand the next picture to the browser."""
        ...

    def say(self, problem: str) -> None:
        """Show why there is no new picture; "" takes it back."""
        ...

    def follow(self) -> None:
        """Show the player's state, which another tab may have changed."""
        ...


class Player:
    """Reads and denoises the next frame when a tab asks for one, on a thread of its own.

    A tab that is hidden or slow asks for none, and so none is made for it.

    Attributes:
        stream: what is played.
        paused: whether the present frame stays.
        screens: the open tabs.
    """

    def __init__(self, stream: LiveStream) -> None:
        self.stream, self.paused = stream, False
        self.screens: set[Screen] = set()
        self._thread = ThreadPoolExecutor(1, "live")
        self._asked = asyncio.Event()
        self._number = 0
        self._again = True
        self._running = False

    @property
    def number(self) -> int:
        """The number of the newest picture; 0 before the first."""
        return self._number

    def start(self) -> None:
        """Begin to play, once; called on the server's loop."""
        if not self._running:
            self._running = True
            background_tasks.create(self._run(), name="glsim live")

    def ask(self) -> None:
        """Say that a tab has the newest picture and waits for the next."""
        self._asked.set()

    def show_again(self) -> None:
        """Denoise and show the present frame once more, though the player is paused."""
        self._again = True
        self.ask()

    async def choose(self, spec: str, around: str | None) -> None:
        """Change the denoiser. Raises GlsimError; then the former one stays."""
        await self._on_thread(self.stream.choose, spec, around)
        self.show_again()

    def stop(self) -> None:
        """Let the camera go after the frame that is being read."""
        self._thread.submit(self.stream.source.close)
        self._thread.shutdown(wait=False)

    async def _run(self) -> None:
        while True:
            await self._asked.wait()
            self._asked.clear()
            if not self.screens or (self.paused and not self._again):
                continue
            make = self.stream.again if self._again else self.stream.next
            self._again = False
            number = self._number + 1
            try:
                packet = await self._on_thread(make, number)
            except GlsimError as error:
                self._say(str(error))
                await asyncio.sleep(_RETRY_S)
                self.ask()
                continue
            self._number = number
            self._say("")
            for screen in list(self.screens):
                screen.publish(packet, number)

    def _say(self, problem: str) -> None:
        for screen in list(self.screens):
            screen.say(problem)

    async def _on_thread(self, function: Callable[..., _T], *arguments: Any) -> _T:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, function, *arguments)
