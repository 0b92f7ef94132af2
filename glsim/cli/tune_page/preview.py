"""Drawing of a tuning's frame, and its packing for the browser; OpenGL is bound to a thread.

A packet is a JSON head, then the raw bytes of the frame's layers:

    4 bytes   length of the head, little-endian, padded to a multiple of 4
    head      {"width", "height", "window": [left, top, w, h], "layers": [[name, type], ...], ...}
    layers    (h, w) of the window, uint16, uint8 or float32, little-endian, each padded to 4 bytes

The layers are clean, noisy, reason and infrared of all sensors, infrared_right of stereo cameras,
and disparity (pixels) of cameras that match images. Outside the window every layer is 0 and the
reason is NO_SURFACE.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.cli.tune_page.tuning import StageCode, Tuning
from glsim.core.errors import GlsimError
from glsim.core.rect import Rect
from glsim.faces.face_source import FaceSource
from glsim.gl.context import open_context
from glsim.noise.layer_names import DISPARITY_LAYER, INFRARED_RIGHT
from glsim.noise.registry import shipped_stage
from glsim.sensors.sensor import Sensor
from glsim.settings.schema import Settings, with_assignments
from glsim.simulation.frame import LAYERS, Frame
from glsim.simulation.pipeline import Simulator
from glsim.simulation.plan.tasks import Task, make_tasks

#: Layers that the page measures or shows besides the images.
_EXTRA_LAYERS = ("normal", DISPARITY_LAYER)
#: Values that change the faces or the plan, and so need another simulator.
_OF_PLAN = ("seed", "devices")
_TYPES = {"uint8": "u1", "uint16": "u2", "float32": "f4"}
_PLACE = re.compile(r"(?P<file>[^\s;:]+\.\w+):(?P<line>\d+):\s*")


@dataclass(frozen=True, eq=False)
class Picture:
    """A frame that the tuner's page shows: its settings, sensor, number of frames and time, ms."""

    tuning: Tuning
    frame: Frame
    sensor: Sensor
    frames: int
    milliseconds: float


class Preview:
    """Renderer of tunings with its own OpenGL context; use it on one thread only."""

    def __init__(
        self, base: Settings, open_sources: Callable[[Settings], Sequence[FaceSource]]
    ) -> None:
        """Store the settings that tunings change, and the function that opens face sources."""
        self._base, self._open_sources = base, open_sources
        self._context: moderngl.Context | None = None
        self._plan: tuple[str, Mapping[str, Any]] | None = None
        self._tasks: Sequence[Task] = ()
        self._plain: Simulator | None = None
        #: Code of changed stages, and the last simulator with this code that drew a frame. Its
        #: programs stay linked while the code is edited.
        self._coded: tuple[Mapping[str, StageCode], Simulator] | None = None
        self._last: Simulator | None = None

    def draw(self, tuning: Tuning) -> Picture:
        """Draw a tuning's frame. Raises GlsimError, after which the preview still works."""
        coded = self._with_code(tuning)
        values = {name: value for name, value in tuning.values.items() if name not in _OF_PLAN}
        simulator = coded.with_values(values) if values else coded
        start = time.perf_counter()
        (frame,) = simulator.frames([self._tasks[tuning.frame % len(self._tasks)]])
        elapsed = 1000 * (time.perf_counter() - start)
        if not isinstance(frame, Frame):
            raise GlsimError(frame.why)
        self._last = simulator
        return Picture(tuning, frame, simulator.sensor, len(self._tasks), elapsed)

    def _with_code(self, tuning: Tuning) -> Simulator:
        of_plan = {n: tuning.values[n] for n in _OF_PLAN if n in tuning.values}
        if self._plain is None or self._plan != (tuning.sensor, of_plan):
            settings = with_assignments(self._base, {"sensor": tuning.sensor, **of_plan})
            sources = self._open_sources(settings)
            self._tasks = make_tasks(settings, list(sources))
            if self._context is None:
                self._context = open_context()
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
        """Forget the sensor's files and GLSL, so that the next frame reads them again."""
        shipped_stage.cache_clear()
        self._plan = None


def pack(frame: Frame, number: int) -> bytes:
    """Pack a frame for the browser; the head of the packet contains ``number``."""
    camera, layers = frame.intrinsics, shown_layers(frame)
    tree = {
        "number": number,
        "width": camera.width,
        "height": camera.height,
        "window": list(frame.window),
        "focal_px": [camera.fx, camera.fy],
        "centre_px": [camera.cx, camera.cy],
        "depth_unit_mm": frame.depth_unit_mm,
        "layers": [[name, _TYPES[layer.dtype.name]] for name, layer in layers.items()],
    }
    head = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    head += b" " * (-len(head) % 4)
    images = (np.ascontiguousarray(i, i.dtype.newbyteorder("<")) for i in layers.values())
    parts = (raw + b"\0" * (-len(raw) % 4) for raw in (image.tobytes() for image in images))
    return b"".join([len(head).to_bytes(4, "little"), head, *parts])


def shown_layers(frame: Frame) -> dict[str, NDArray[Any]]:
    """Return name -> (h, w) layer of a frame, within its window."""
    stereo = frame.infrared_right_counts is not None
    names = (*LAYERS, INFRARED_RIGHT) if stereo else LAYERS
    _, _, width, height = frame.window
    image = frame.intrinsics.cropped(*frame.window)
    seen = replace(frame, intrinsics=image, window=Rect(0, 0, width, height))
    layers = {name: seen.image(name) for name in names}
    extra = {n: frame.extra[n] for n in (DISPARITY_LAYER,) if n in frame.extra}
    return layers | extra


def marked_lines(message: str, file: str) -> dict[int, str]:
    """Parse the driver's message about a file: line number -> text."""
    found = list(_PLACE.finditer(message))
    ends = [*(m.start() for m in found), len(message)][1:]
    lines: dict[int, str] = {}
    for match, end in zip(found, ends, strict=True):
        if file.endswith(match["file"]) or match["file"].endswith(file):
            text = message[match.end() : end].strip(" ;")
            number = int(match["line"])
            lines[number] = f"{lines[number]}; {text}" if number in lines else text
    return lines
