"""Build the scenery of one frame from the settings [scene]: nothing, a wall, or a room.

A room is drawn once per subject (or sequence, or frame: ``scene.per``), cut to what the camera
sees, and kept: its arrays are the same objects in every frame, so the GPU gets them once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import SensorRig
from glsim.core.errors import MeshError
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.products import product
from glsim.looks.room.body import Body
from glsim.looks.room.room import RoomNumbers, build_room
from glsim.looks.room.shapes import Shape
from glsim.looks.room.view import (
    camera_place,
    camera_tilt_deg,
    room_view,
    tilted,
    visible_mesh,
    visible_part,
)
from glsim.settings.distribution import Distribution, DrawKeys
from glsim.settings.scene_settings import SceneSettings
from glsim.settings.schema import PoseSettings

#: Half the side of the square wall, mm; it fills any view up to 12 m.
_WALL_MM = 20_000.0

_WALL_FACES = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)

#: Eyes below this height, mm, belong to somebody who sits: standing adults have theirs above 1.4 m
#: (DIN 33402, 5th percentile of women), sitting ones below 1.35 m. Between the two.
_SITTING_MM = 1380.0

#: Seat and z of its back for a head without a body: EN 12520, and behind the head (chosen).
_SEAT_MM = (450.0, -330.0)

#: Rooms that stay in memory; neighbouring tasks share one. A room takes half a megabyte.
_KEPT_ROOMS = 8

#: Regions of a room, other people in it included.
ROOM_REGIONS = (
    "wall", "floor", "ceiling", "door", "window", "furniture", "screen", "plant", "person",
)  # fmt: skip

#: Where the shapes of a room are: canonical axes around the camera, mm.
_AROUND_CAMERA = pose_matrix({})


@dataclass(frozen=True, eq=False)
class Prop:
    """A mesh of the scenery.

    Args:
        mesh: millimetres.
        view: (4, 4) float32, the mesh's millimetres to camera metres.
        region: name in the layer of regions; "" for none.
    """

    mesh: Mesh
    view: NDArray[np.float32]
    region: str = ""


@dataclass(frozen=True, eq=False)
class Scenery:
    """The scenery of one frame.

    Args:
        drawn: "scene.name" -> number, for the manifest.
        tilt_deg: how far the camera looks up.
        places: (4, 4) matrices, mm to camera m, of points on the floor where other people may
            stand, in canonical axes: +z is where they look.
    """

    props: tuple[Prop, ...] = ()
    drawn: Mapping[str, float] = field(default_factory=dict)
    tilt_deg: float = 0.0
    places: tuple[NDArray[np.float32], ...] = ()

    def stands(self, view: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the view matrix of a person who is upright in this scenery."""
        return tilted(view, self.tilt_deg)


def scene_regions(settings: SceneSettings) -> tuple[str, ...]:
    """Names of the regions that the scenery may have."""
    if settings.room != "none":
        return ROOM_REGIONS
    return () if settings.wall_mm is None else ("wall",)


def build_scenery(
    settings: SceneSettings,
    pose: PoseSettings,
    seeds: DrawKeys,
    rig: SensorRig,
    body: Body | None = None,
) -> Scenery:
    """Return the scenery of a frame; a pure function of the arguments.

    Args:
        body: floor and seat of the person; None for a head without a body, whose height is
            ``scene.eye_mm``.
    """
    if settings.room != "none":
        return _room_scenery(settings, pose, seeds, rig, body)
    if settings.wall_mm is None:
        return Scenery()
    wall_mm = settings.wall_mm.draw(seeds, "scene.wall_mm")
    wall = Prop(_wall(settings.wall_albedo), pose_matrix({"distance_mm": wall_mm}), "wall")
    return Scenery((wall,), {"scene.wall_mm": wall_mm})


def check_behind(scenery: Scenery, meshes: Sequence[Mesh], view: NDArray[np.float32]) -> None:
    """Raise MeshError if the plain wall does not lie behind all of the face.

    Args:
        meshes, view: the face and what it wears, and their (4, 4) matrix, canonical mm to camera m.
    """
    wall_mm = scenery.drawn.get("scene.wall_mm")
    if wall_mm is None:
        return
    depths = [1000.0 * (product(mesh.vertices_mm, view[2, :3]) + view[2, 3]) for mesh in meshes]
    low, high = min(float(d.min()) for d in depths), max(float(d.max()) for d in depths)
    if wall_mm <= high:
        where = "in front of" if wall_mm <= low else "inside"
        raise MeshError(
            f"the wall at {wall_mm:.0f} mm stands {where} the face, which reaches from "
            f"{low:.0f} to {high:.0f} mm: set scene.wall_mm beyond {high:.0f} mm"
        )


def _wall(albedo: float) -> Mesh:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
    return Mesh(corners * _WALL_MM, _WALL_FACES, np.full(4, albedo, dtype=np.float32))


def _room_scenery(
    settings: SceneSettings,
    pose: PoseSettings,
    seeds: DrawKeys,
    rig: SensorRig,
    body: Body | None,
) -> Scenery:
    """Draw the numbers of a room and place the camera in it; the room itself is kept."""
    key = getattr(seeds, settings.per)
    keys = DrawKeys(key, key, key)

    def draw(name: str) -> float:
        number: Distribution = getattr(settings, name)
        return number.draw(keys, f"scene.{name}")

    place = {name: getattr(pose, name) for name in ("x_mm", "y_mm", "distance_mm")}
    face = {name: setting.draw(_held(setting, seeds, settings), f"pose.{name}")
            for name, setting in place.items()}  # fmt: skip
    moves = {name: _moves(setting, settings, face[name]) for name, setting in place.items()}
    if body is None:
        eye_mm = draw("eye_mm")
        seat_mm = _SEAT_MM if eye_mm < _SITTING_MM and settings.room != "empty" else None
    else:
        eye_mm, seat_mm = -body.floor_mm, None
        if body.seat_mm is not None:
            seat_mm = body.seat_mm[0] - body.floor_mm, body.seat_mm[1]
    wanted = eye_mm if settings.camera_mm is None else draw("camera_mm")
    at = face["x_mm"], face["y_mm"], face["distance_mm"]
    tilt = camera_tilt_deg(at, eye_mm - wanted)
    camera = camera_place(at, eye_mm, tilt)
    numbers = RoomNumbers(
        kind=settings.room,
        seed=key,
        behind_mm=draw("behind_mm"),
        width_mm=draw("width_mm"),
        height_mm=max(draw("height_mm"), float(camera[1]) + 200.0, eye_mm + 250.0),
        turn_deg=draw("turn_deg"),
        clutter=draw("clutter"),
        people=round(draw("people")),
        seat_mm=seat_mm,
        camera_mm=(float(camera[0]), float(camera[2])),
        reach_mm=(moves["x_mm"][0], moves["x_mm"][1], max(0.0, moves["distance_mm"][1])),
    )
    props, places = _visible_room(numbers, tuple(camera), tilt, rig, draw("albedo"))
    drawn = {
        f"scene.{name}": float(getattr(numbers, name))
        for name in ("behind_mm", "width_mm", "height_mm", "turn_deg", "clutter")
    }
    drawn |= {"scene.eye_mm": eye_mm, "scene.camera_mm": float(camera[1]), "scene.tilt_deg": tilt}
    drawn["scene.people"] = float(len(places)) if body is not None else 0.0
    return Scenery(props, drawn, tilt, places)


_SCOPES = ("frame", "sequence", "subject", "device")


def _held(setting: Distribution, seeds: DrawKeys, settings: SceneSettings) -> DrawKeys:
    """The seeds of a pose setting in a room: its own if it is constant there, else the room's."""
    if _SCOPES.index(setting.per) >= _SCOPES.index(settings.per):
        return seeds
    return DrawKeys(*[getattr(seeds, settings.per)] * 3)


def _moves(setting: Distribution, settings: SceneSettings, value: float) -> tuple[float, float]:
    """How far a setting of the pose goes below and above ``value`` while a room stays."""
    if _SCOPES.index(setting.per) >= _SCOPES.index(settings.per):
        return 0.0, 0.0
    low, high = setting.bounds()
    return low - value, high - value


@lru_cache(maxsize=_KEPT_ROOMS)
def _visible_room(
    numbers: RoomNumbers,
    camera_mm: tuple[float, ...],
    tilt_deg: float,
    rig: SensorRig,
    albedo: float,
) -> tuple[tuple[Prop, ...], tuple[NDArray[np.float32], ...]]:
    """Build a room, cut to the view; one prop for each region that is in view."""
    room = build_room(numbers)
    view = room_view(np.asarray(camera_mm), tilt_deg)
    regions: dict[str, list[Shape]] = {}
    for shape in room.shapes:
        regions.setdefault(shape.region, []).append(shape)
    props = []
    for region, shapes in regions.items():
        mesh = visible_mesh(shapes, view, rig, albedo)
        if mesh is not None:
            props.append(Prop(mesh, _AROUND_CAMERA, region))
    places = []
    for x, z, turn in room.people:
        stand = np.eye(4)
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        stand[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        stand[:3, 3] = x, 0.0, z
        places.append(product(view, stand).astype(np.float32))
    return tuple(props), tuple(places)


def standing_prop(
    mesh: Mesh, floor_mm: float, place: NDArray[np.float32], rig: SensorRig
) -> Prop | None:
    """Return another person on one of the places, or None if nothing of them is in view.

    Args:
        mesh: canonical mm.
        floor_mm: y of the floor below the feet.
        place: of ``Scenery.places``.
    """
    lift = np.eye(4, dtype=np.float32)
    lift[1, 3] = -floor_mm
    view = product(place, lift)
    part = visible_part(mesh, view, rig)
    return None if part is None else Prop(part, view, "person")
