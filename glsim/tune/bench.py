"""Draw the frame of a tuning. OpenGL is bound to a thread: all of a bench runs on one."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.errors import GlsimError
from glsim.faces.base import FaceSource
from glsim.frame import LAYERS, Frame
from glsim.gl.context import open_context
from glsim.noise.layer_names import DISPARITY_LAYER, INFRARED_RIGHT
from glsim.noise.registry import shipped_stages
from glsim.pipeline import Simulator
from glsim.plan.tasks import Task, make_tasks
from glsim.sensors.sensor import Sensor
from glsim.settings.schema import Settings, with_assignments
from glsim.tune.state import StageCode, Tuning

#: Layers that the page measures or shows besides the images.
_EXTRA_LAYERS = ("normal", DISPARITY_LAYER)

#: Values that need other faces or another plan, and so a simulator of their own.
_OF_PLAN = ("seed", "devices")

_PLACE = re.compile(r"(?P<file>[^\s;:]+\.\w+):(?P<line>\d+):\s*")


@dataclass(frozen=True, eq=False)
class DrawnFrame:
    """A drawn tuning.

    Attributes:
        normal: (h, w, 4) of the frame's window.
        milliseconds: to draw it.
    """

    tuning: Tuning
    frame: Frame
    sensor: Sensor
    settings: Settings
    frames: int
    normal: NDArray[np.float32]
    milliseconds: float


class Bench:
    """The simulators of one page, on a context of its own. Use it on one thread."""

    def __init__(
        self,
        base: Settings,
        open_sources: Callable[[Settings], Sequence[FaceSource]],
        backend: str | None = None,
    ) -> None:
        """Take the settings that tunings change, and what opens the faces of some settings."""
        self._base, self._open_sources, self._backend = base, open_sources, backend
        self._context: moderngl.Context | None = None
        self._plan: tuple[str, Mapping[str, Any]] | None = None
        self._tasks: Sequence[Task] = ()
        self._plain: Simulator | None = None
        #: The simulator with the code of some stages, and the last that drew a frame: its programs
        #: stay linked while its code is edited.
        self._coded: tuple[Mapping[str, StageCode], Simulator] | None = None
        self._last: Simulator | None = None

    def draw(self, tuning: Tuning, noise_of: int | None = None) -> DrawnFrame:
        """Draw a tuning's frame.

        Raises GlsimError: the bench serves on with what it has.

        Args:
            noise_of: number of the frame whose noise it has; None: its own.
        """
        coded = self._with_code(tuning)
        values = {name: value for name, value in tuning.values.items() if name not in _OF_PLAN}
        simulator = coded.with_values(values) if values else coded
        task = self._tasks[tuning.frame % len(self._tasks)]
        if noise_of is not None:
            noise = self._tasks[noise_of % len(self._tasks)].seeds.frame
            task = replace(task, seeds=task.seeds._replace(frame=noise))
        start = time.perf_counter()
        (frame,) = simulator.frames([task])
        elapsed = 1000 * (time.perf_counter() - start)
        if not isinstance(frame, Frame):
            raise GlsimError(frame.why)
        self._last = simulator
        return DrawnFrame(
            tuning,
            frame,
            simulator.sensor,
            simulator.settings,
            len(self._tasks),
            frame.extra["normal"],
            elapsed,
        )

    def _with_code(self, tuning: Tuning) -> Simulator:
        """Return the simulator of the tuning's sensor, plan and code."""
        of_plan = {n: tuning.values[n] for n in _OF_PLAN if n in tuning.values}
        if self._plain is None or self._plan != (tuning.sensor, of_plan):
            settings = with_assignments(self._base, {"sensor": tuning.sensor, **of_plan})
            sources = self._open_sources(settings)
            self._tasks = make_tasks(settings, list(sources))
            if self._context is None:
                self._context = open_context(self._backend)
            plain = Simulator(settings, sources, self._context, _EXTRA_LAYERS)
            if len(plain.sensor.rig.imagers_m) > 1:
                plain = plain.with_layers((*LAYERS, INFRARED_RIGHT), _EXTRA_LAYERS)
            self._plain = plain
            self._plan, self._coded = (tuning.sensor, of_plan), None
        if self._coded is None or self._coded[0] != tuning.code:
            simulator = self._plain
            for stage, code in tuning.code.items():
                simulator = simulator.with_stage(stage, code.text, code.before)
            self._coded = dict(tuning.code), simulator
        return self._coded[1]

    def reload(self) -> None:
        """Read the sensor's files and the stages' GLSL anew at the next frame."""
        shipped_stages.cache_clear()
        self._plan = None

    def close(self) -> None:
        """Release the context; the next frame opens another one."""
        self._plan = None
        self._plain = self._coded = self._last = None
        if self._context is not None:
            self._context.release()
            self._context = None


def marked_lines(message: str, file: str) -> dict[int, str]:
    """Return line -> what the driver says of it, of a ShaderError about a file."""
    found = list(_PLACE.finditer(message))
    ends = [*(m.start() for m in found), len(message)][1:]
    lines: dict[int, str] = {}
    for match, end in zip(found, ends, strict=True):
        if file.endswith(match["file"]) or match["file"].endswith(file):
            text = message[match.end() : end].strip(" ;")
            number = int(match["line"])
            lines[number] = f"{lines[number]}; {text}" if number in lines else text
    return lines
