"""What all tabs share: the faces, and the threads that draw and measure."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from glsim.errors import GlsimError
from glsim.faces.base import FaceSource
from glsim.settings.schema import Settings
from glsim.tune.recording import measure_recording
from glsim.tune.state import Tuning

log = logging.getLogger(__name__)

_T = TypeVar("_T")


@dataclass
class Workshop:
    """What all tabs share.

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
