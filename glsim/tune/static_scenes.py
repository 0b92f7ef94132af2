"""The faces and scenes of the page without a server, captured with every sensor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from glsim.errors import MeshError
from glsim.faces.people.files import has_people
from glsim.frame import Frame
from glsim.gl.context import borrowed_context
from glsim.pipeline import Simulator, open_sources
from glsim.plan.tasks import Task, make_tasks
from glsim.settings.schema import load_settings
from glsim.tune.static_captures import CAPTURED_LAYERS, pack_capture

#: Of the heads and of what they wear.
_SEED = 3
#: Poses of ten heads: distance mm, yaw, pitch, roll in degrees. Chosen: near and far, from all
#: sides; farther heads take fewer bytes.
_POSES = (
    (1200, 0, 0, 0), (1400, 25, 0, 0), (1100, -15, 8, 0), (1700, 40, -5, 0), (1500, -35, 0, 0),
    (2000, 10, 5, 0), (1600, -60, 0, 0), (1450, 0, -20, 0), (1800, 15, 10, 12), (2400, 0, 0, 0),
)  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """A frame to capture.

    Attributes:
        base: settings as tables; values: by the names of ``--set``.
        name: of its file.
        subject: its number in the plan of ``base``.
    """

    name: str
    title: str
    base: Mapping[str, Any]
    values: Mapping[str, Any] = field(default_factory=dict)
    subject: int = 0


def default_scenes() -> list[Scene]:
    """Return ten heads before nothing, a head before a wall, and a living room.

    In the room are people if this machine has their data, otherwise a head.
    """
    heads = {
        "seed": _SEED,
        "source": {"kind": "procedural", "subjects": len(_POSES), "frames_per_subject": 1},
        "appearance": {"wear": "always", "glasses": 0.5, "cloth": 0.0},
        "pose": {"motion": 0},
    }
    scenes = []
    for number, (distance, yaw, pitch, roll) in enumerate(_POSES):
        turned = f", turned {yaw}°" if yaw else ""
        scenes.append(
            Scene(
                f"head-{number + 1}",
                f"head {number + 1}: {distance / 1000:g} m{turned}",
                heads,
                _pose(distance, yaw, pitch, roll),
                number,
            )
        )
    wall = {**_pose(900, -20, 0, 0), "scene.wall_mm": 1500}
    scenes.append(Scene("wall", "head before a wall", heads, wall, 0))
    room = {"seed": _SEED, "source": {"subjects": 1, "frames_per_subject": 1}}
    if has_people():
        scene = Scene("room", "living room", {**room, "preset": "living-room"})
    else:
        furnished = {"scene": {"room": "living-room"}, "pose": {"distance_mm": 1100, "motion": 0}}
        scene = Scene("room", "head in a living room", {**heads, **furnished})
    return [*scenes, scene]


def _pose(distance: float, yaw: float, pitch: float, roll: float) -> dict[str, float]:
    names = ("distance_mm", "yaw_deg", "pitch_deg", "roll_deg")
    return {f"pose.{n}": v for n, v in zip(names, (distance, yaw, pitch, roll), strict=True)}


def capture_scenes(
    scenes: Sequence[Scene], sensors: Sequence[str], backend: str | None = None
) -> Iterator[tuple[Scene, dict[str, Any]]]:
    """Yield each scene with its captures as JSON values: {name, captures: {sensor: ...}, blobs}.

    Raises MeshError if a sensor does not see the face.
    """
    with borrowed_context(backend) as context:
        made: tuple[str, Sequence[Task], dict[str, Simulator]] = ("", [], {})
        for scene in scenes:
            if made[0] != repr(scene.base):
                made = (repr(scene.base), *_simulators(scene, sensors, context))
            _, tasks, simulators = made
            blobs: dict[str, Any] = {}
            captures = {}
            for simulator in simulators.values():
                frame = capture(simulator, tasks[scene.subject], scene)
                sensor = simulator.sensor
                captures[sensor.name] = pack_capture(frame, sensor, scene.name, blobs)
            yield scene, {"name": scene.name, "captures": captures, "blobs": blobs}


def capture(simulator: Simulator, task: Task, scene: Scene) -> Frame:
    """Return the frame of a scene with the layers that its capture needs. Raises MeshError."""
    (frame,) = simulator.with_values(scene.values).frames([task])
    if not isinstance(frame, Frame):
        raise MeshError(f"{scene.name}: {frame.why}")
    return frame


def _simulators(
    scene: Scene, sensors: Sequence[str], context: Any
) -> tuple[Sequence[Task], dict[str, Simulator]]:
    """Return a plan and a simulator per sensor; they share sources, programs and what is worn."""
    tables = {key: value for key, value in scene.base.items() if key != "preset"}
    settings = load_settings(overrides=tables, preset=scene.base.get("preset"))
    sources = open_sources(settings)
    first = Simulator(settings, sources, context, CAPTURED_LAYERS)
    return make_tasks(settings, sources), {
        name: first.with_values({"sensor": name}) for name in sensors
    }
