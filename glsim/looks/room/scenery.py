"""Build the scenery of a frame from the settings [scene]: nothing, a plain wall, or a room.

A room is sampled once per subject (or sequence, or frame: ``scene.per``) and cut to the camera's
view. It is kept: its arrays are the same objects in every frame, and so they are uploaded once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from glsim.core.array_types import Floats
from glsim.core.camera import SensorRig
from glsim.core.errors import MeshError
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.products import product
from glsim.core.units import MM_PER_M
from glsim.faces.face_source import Face
from glsim.looks.room.room import RoomNumbers, build_room
from glsim.looks.room.view import camera_place, camera_tilt_deg, room_view, visible_mesh
from glsim.looks.shapes import Shape
from glsim.settings.distribution import Distribution, ScopeSeeds
from glsim.settings.schema import PoseSettings, SceneSettings

#: Half the side of the square plain wall, mm: it fills the view up to 12 m.
_WALL_MM = 20_000.0
#: A person with eyes below this height, mm, sits. It lies between the eyes of standing adults,
#: above 1.4 m (DIN 33402, 5th percentile of women), and of sitting adults, below 1.35 m.
_SITTING_MM = 1380.0
#: Seat of a head without a body, mm: its height (EN 12520), and z of the backrest behind the head
#: (chosen).
_SEAT_MM = (450.0, -330.0)
#: A mesh that reaches this far below its origin, mm, has a body. Chosen: heads and busts end above,
#: a sitting child of four years below.
_BODY_MM = 550.0
#: Heights of floor and seat are rounded to this step, mm: breathing shall not change the room.
_STEP_MM = 4.0
#: Number of rooms in memory, 0.5 MB each; neighbouring tasks share a room.
_KEPT_ROOMS = 8
#: Regions of a room and of the other people in it.
ROOM_REGIONS = (
    "wall", "floor", "ceiling", "door", "window", "furniture", "screen", "plant", "person",
)  # fmt: skip
_SCOPES = ("frame", "sequence", "subject", "device")


class Prop(NamedTuple):
    """A mesh of the scenery, its (4, 4) matrix from mm to camera m, and its region or ""."""

    mesh: Mesh
    view: Floats
    region: str = ""


class Scenery(NamedTuple):
    """All meshes around the person of a frame, with the camera's tilt.

    ``sampled``: entries of the manifest, "scene.name" -> number; ``tilt_deg``: upward; ``places``:
    for each other person a (4, 4) matrix to camera axes, m, from canonical axes with the origin at
    the feet, mm, and +z in the direction of view.
    """

    props: tuple[Prop, ...] = ()
    sampled: Mapping[str, float] = {}
    tilt_deg: float = 0.0
    places: tuple[Floats, ...] = ()


class Body(NamedTuple):
    """Heights y of a person's floor and seat, and z of the backrest, mm; None if standing."""

    floor_mm: float
    seat_mm: tuple[float, float] | None = None


def body_of(face: Face) -> Body | None:
    """Find floor and seat of a person; None for a head without a body."""
    # ``Face.notes`` may hold "floor_mm" and "sitting"; by default the lowest vertex is the floor.
    lowest = float(face.mesh.vertices_mm[:, 1].min())
    noted = face.notes.get("floor_mm")
    if not isinstance(noted, int | float) and not lowest <= -_BODY_MM:  # NaN: no body
        return None
    floor = _rounded(float(noted) if isinstance(noted, int | float) else lowest)
    return Body(floor, _seat(face, floor) if face.notes.get("sitting") else None)


def _seat(face: Face, floor_mm: float) -> tuple[float, float] | None:
    """Find the seat's height and z of the backrest of a sitting body, mm; None without hips."""
    x, y, z = face.mesh.vertices_mm.T
    height = (y - floor_mm) / -floor_mm
    trunk = (np.abs(x) < 110) & (height > 0.55) & (height < 0.85)
    if not trunk.any():
        return None
    back = float(np.percentile(z[trunk], 2))
    hips = (np.abs(x) < 160) & (z > back) & (z < back + 250) & (height > 0.2) & (height < 0.6)
    return (_rounded(float(y[hips].min())), _rounded(back)) if hips.any() else None


def _rounded(place_mm: float) -> float:
    return round(place_mm / _STEP_MM) * _STEP_MM


def scene_regions(settings: SceneSettings) -> tuple[str, ...]:
    """Return the region names that the scenery may have."""
    if settings.room != "none":
        return ROOM_REGIONS
    return () if settings.wall_mm is None else ("wall",)


def build_scenery(
    settings: SceneSettings, pose: PoseSettings, seeds: ScopeSeeds, rig: SensorRig,
    body: Body | None = None,
) -> Scenery:  # fmt: skip
    """Build a frame's scenery, a pure function; a head without body has ``scene.eye_mm``."""
    if settings.room != "none":
        return _room_scenery(settings, pose, seeds, rig, body)
    if settings.wall_mm is None:
        return Scenery()
    wall_mm = settings.wall_mm.sample(seeds, "scene.wall_mm")
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * _WALL_MM
    albedo = np.full(4, settings.wall_albedo, np.float32)
    mesh = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), albedo)
    wall = Prop(mesh, pose_matrix({"distance_mm": wall_mm}), "wall")
    return Scenery((wall,), {"scene.wall_mm": wall_mm})


def check_behind(scenery: Scenery, meshes: Sequence[Mesh], view: Floats) -> None:
    """Raise MeshError unless the plain wall is behind the face and all that it wears."""
    wall_mm = scenery.sampled.get("scene.wall_mm")
    if wall_mm is None:
        return
    depths = [MM_PER_M * (product(mesh.vertices_mm, view[2, :3]) + view[2, 3]) for mesh in meshes]
    low, high = min(float(d.min()) for d in depths), max(float(d.max()) for d in depths)
    if wall_mm <= high:
        where = "in front of" if wall_mm <= low else "inside"
        raise MeshError(
            f"the wall at {wall_mm:.0f} mm stands {where} the face, which reaches from "
            f"{low:.0f} to {high:.0f} mm: set scene.wall_mm beyond {high:.0f} mm"
        )


def _room_scenery(
    settings: SceneSettings, pose: PoseSettings, seeds: ScopeSeeds, rig: SensorRig,
    body: Body | None,
) -> Scenery:  # fmt: skip
    """Sample the numbers of a room, and return the part of the room that the camera sees."""
    key = getattr(seeds, settings.per)
    keys = ScopeSeeds(key, key, key)

    def sample(name: str) -> float:
        number: Distribution = getattr(settings, name)
        return number.sample(keys, f"scene.{name}")

    face, reach = [], []  # the face's position, and its range while a room stays
    for name in ("x_mm", "y_mm", "distance_mm"):
        setting: Distribution = getattr(pose, name)
        stays = _SCOPES.index(setting.per) >= _SCOPES.index(settings.per)
        value = setting.sample(seeds if stays else keys, f"pose.{name}")
        face.append(value)
        reach.append([0.0 if stays else end - value for end in setting.bounds()])
    if body is None:
        eye_mm = sample("eye_mm")
        seat_mm = _SEAT_MM if eye_mm < _SITTING_MM and settings.room != "empty" else None
    else:
        eye_mm, seat_mm = -body.floor_mm, None
        if body.seat_mm is not None:
            seat_mm = body.seat_mm[0] - body.floor_mm, body.seat_mm[1]
    wanted = eye_mm if settings.camera_mm is None else sample("camera_mm")
    tilt = camera_tilt_deg(face, eye_mm - wanted)
    camera = camera_place(face, eye_mm, tilt)
    numbers = RoomNumbers(
        kind=settings.room, seed=key, seat_mm=seat_mm, people=round(sample("people")),
        behind_mm=sample("behind_mm"), width_mm=sample("width_mm"), turn_deg=sample("turn_deg"),
        height_mm=max(sample("height_mm"), float(camera[1]) + 200.0, eye_mm + 250.0),
        clutter=sample("clutter"), camera_mm=(float(camera[0]), float(camera[2])),
        reach_mm=(reach[0][0], reach[0][1], max(0.0, reach[2][1])),
    )  # fmt: skip
    props, places = _visible_room(numbers, tuple(camera), tilt, rig, sample("albedo"))
    sampled = {
        f"scene.{name}": float(getattr(numbers, name))
        for name in ("behind_mm", "width_mm", "height_mm", "turn_deg", "clutter")
    }
    sampled |= {"scene.eye_mm": eye_mm, "scene.camera_mm": float(camera[1]), "scene.tilt_deg": tilt}
    sampled["scene.people"] = float(len(places)) if body is not None else 0.0
    return Scenery(props, sampled, tilt, places)


@lru_cache(maxsize=_KEPT_ROOMS)
def _visible_room(
    numbers: RoomNumbers, camera_mm: tuple[float, ...], tilt_deg: float, rig: SensorRig,
    albedo: float,
) -> tuple[tuple[Prop, ...], tuple[Floats, ...]]:  # fmt: skip
    """Build a room, cut it to the view; return its meshes and the positions of other people."""
    room, people = build_room(numbers)
    view = room_view(np.asarray(camera_mm), tilt_deg)
    regions: dict[str, list[Shape]] = {}
    for shape in room:
        regions.setdefault(shape.region, []).append(shape)
    props = []
    for region, shapes in regions.items():
        mesh = visible_mesh(shapes, view, rig, albedo)
        if mesh is not None:
            props.append(Prop(mesh, pose_matrix({}), region))
    places = []
    for x, z, turn in people:
        stand = np.eye(4)
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        stand[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        stand[:3, 3] = x, 0.0, z
        places.append(product(view, stand).astype(np.float32))
    return tuple(props), tuple(places)
