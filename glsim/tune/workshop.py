"""What all tabs share: the faces, and the threads that draw and measure."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from glsim.errors import ConfigError, GlsimError
from glsim.faces.base import FaceSource
from glsim.settings.schema import Settings
from glsim.tune.bench import Bench
from glsim.tune.kept import KeptTuning
from glsim.tune.state import Tuning, tuning_of_link
from glsim.tune.trust import check_link, code_of

log = logging.getLogger(__name__)

_T = TypeVar("_T")


@dataclass
class Workshop:
    """What all tabs share.

    Attributes:
        base: the settings that a tab starts from.
        command: the part of a command line that names the faces, e.g. ``render face.obj``.
        start: the tuning of the command's options.
        own_sensor: the sensor that the command names; its code may run.
        allowed: Python stages of other sensors that the user has allowed to run.
        real: folder of a recording, or None.
    """

    base: Settings
    open_sources: Callable[[Settings], Sequence[FaceSource]]
    command: str
    start: Tuning
    own_sensor: str
    real: Path | None = None
    backend: str | None = None
    gl: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "gl"))
    measuring: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "measure"))
    recorded: dict[str, Any] | None = None
    allowed: set[str] = field(default_factory=set)
    _prepared: Bench | None = None

    @cached_property
    def kept(self) -> KeptTuning:
        """The place of the last tuning on the disk."""
        return KeptTuning(self.start, self.command)

    def wanted(self, link: str) -> tuple[Tuning | None, str]:
        """Return the tuning of a link, without one that on the disk, and a message about it."""
        try:
            kept = None if link else self.kept.load()
            wanted = tuning_of_link(link) if link else kept
            if wanted is not None:  # it may name a file elsewhere
                check_link(wanted, self.own_sensor, Path.cwd())
        except ConfigError as error:
            return None, str(error)
        if kept in (None, self.start):
            return wanted, ""
        return wanted, "these are your last settings: undo (Ctrl+Z) leads to those of the command"

    def forbidden_code(self, tuning: Tuning) -> list[str]:
        """Return the Python stages that a tuning would run and nobody has allowed yet.

        Raises ConfigError if the file of its sensor cannot be read.
        """
        found = code_of(tuning, self.base, self.own_sensor)
        named = [f"{tuning.sensor}: {use}" for use in found]
        return [name for name in named if name not in self.allowed]

    def stop(self) -> None:
        """End the threads; what is drawn or measured at the moment goes on until it is done."""
        for executor in (self.gl, self.measuring):
            executor.shutdown(wait=False, cancel_futures=True)

    def prepare(self) -> None:
        """Draw the first frame on the GL thread, so that the first tab opens at once."""
        self._prepared = Bench(self.base, self.open_sources, self.backend)

        def draw(bench: Bench) -> None:
            try:
                bench.draw(self.start)
            except GlsimError as error:
                log.debug("%s", error)  # the page says it

        self.gl.submit(draw, self._prepared)

    def bench(self) -> Bench:
        """Return a bench for a new tab; the first one gets the prepared one."""
        bench, self._prepared = self._prepared, None
        return bench or Bench(self.base, self.open_sources, self.backend)

    async def on_gl(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """Run a function on the GL thread."""
        return await asyncio.get_running_loop().run_in_executor(self.gl, function, *arguments)

    async def measure(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """Run a function beside the GL thread."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self.measuring, function, *arguments)

    async def read_recording(self) -> None:
        """Measure the real recording once, on a thread of its own: it takes seconds."""
        if self.real is None or self.recorded is not None:
            return
        from glsim.tune.recording import recording_figures  # takes 0.3 s

        try:
            self.recorded = await asyncio.to_thread(recording_figures, self.real)
        except GlsimError as error:
            log.warning("%s", error)
