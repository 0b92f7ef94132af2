"""State that all tabs share: the faces, the start settings, and threads to draw and measure."""

from __future__ import annotations

import asyncio
import logging
import shlex
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from glsim.cli.tune_page.preview import Preview
from glsim.cli.tune_page.tuning import Tuning
from glsim.core.errors import GlsimError
from glsim.faces.face_source import FaceSource
from glsim.faces.meshes.load import load_mesh
from glsim.faces.one_mesh import OneMesh
from glsim.settings.distribution import Distribution
from glsim.settings.schema import Settings, parse_assignment
from glsim.settings.source_settings import parse_source
from glsim.simulation.pipeline import open_sources

log = logging.getLogger(__name__)
_T = TypeVar("_T")

#: Number of frames of a mesh; they show the same surface with different noise.
_MESH_FRAMES = 30


@dataclass
class TuneSession:
    """A run of ``glsim tune``, with its threads.

    Attributes:
        base: settings from which a tab starts.
        command: the part of a command line that names the faces, e.g. ``glsim render face.obj``.
    """

    base: Settings
    start: Tuning
    command: str
    preview: Preview
    real: Path | None = None
    recorded: dict[str, Any] | None = None
    _gl: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "gl"))
    _measuring: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(1, "measure"))

    def prepare(self) -> None:
        """Draw the first frame on the GL thread, so that the first tab opens at once."""
        self._gl.submit(self.preview.draw, self.start)  # the tab will report errors

    async def on_gl(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """Run a function on the GL thread."""
        return await asyncio.get_running_loop().run_in_executor(self._gl, function, *arguments)

    async def measure(self, function: Callable[..., _T], *arguments: Any) -> _T:
        """Run a function on the measuring thread, in parallel to the GL thread."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._measuring, function, *arguments)

    async def read_recording(self) -> None:
        """Measure the real recording once."""
        if self.real is None or self.recorded is not None:
            return
        from glsim.cli.tune_page.figures import recording_figures  # takes 0.3 s

        try:
            self.recorded = await asyncio.to_thread(recording_figures, self.real)
        except GlsimError as error:
            log.warning("%s", error)

    def stop(self) -> None:
        """Stop the threads; a running drawing or measurement is completed."""
        for executor in (self._gl, self._measuring):
            executor.shutdown(wait=False, cancel_futures=True)


def open_session(
    settings: Settings, assignments: Sequence[str], face: Path | None,
    command_options: dict[str, Any], real: Path | None,
) -> TuneSession:  # fmt: skip
    """Create the session from the options of a command line.

    Raises MeshError if ``face`` cannot be read.

    Args:
        command_options: option -> value or None, for the command that makes the same frames.
    """
    settings, values = _split(settings, assignments)
    start = Tuning(settings.sensor, values)
    words = ["glsim", "generate", "-o", "data"]
    opener: Callable[[Settings], Sequence[FaceSource]] = open_sources
    if face is not None:
        words = ["glsim", "render", str(face)]
        loaded = load_mesh(face)
        mesh = OneMesh(loaded.mesh, face.stem, loaded.notes)
        single = parse_source({"subjects": 1, "frames_per_subject": _MESH_FRAMES})
        settings = settings.model_copy(update={"source": (single,)})

        def opener(_: Settings) -> Sequence[FaceSource]:
            return [mesh]

    for name, value in command_options.items():
        if value is not None:
            words += [name, str(value)]
    return TuneSession(settings, start, shlex.join(words), Preview(settings, opener), real)


def _split(settings: Settings, assignments: Sequence[str]) -> tuple[Settings, dict[str, Any]]:
    """Split settings into fixed settings and values that the page shows as changed.

    Changed values are values of the rig and the stages, and ``--set`` values of pose and scene.
    """
    values: dict[str, Any] = {f"rig.{key}": value for key, value in settings.rig.items()}
    for stage, own in settings.stage.items():
        values |= {f"{stage}.{name}": plain_value(setting) for name, setting in own.items()}
    for text in assignments:
        path, value = parse_assignment(text)
        if path[0] in ("pose", "scene") and len(path) == 2:
            values[".".join(path)] = value
    return settings.model_copy(update={"rig": {}, "stage": {}}), values


def plain_value(setting: Distribution) -> Any:
    """Convert a setting to the syntax of ``--set``: a number or a table."""
    if setting.constant is not None:
        return setting.constant
    table = setting.model_dump(exclude_none=True, exclude_defaults=True)
    return {k: list(v) if isinstance(v, tuple) else v for k, v in table.items()}
