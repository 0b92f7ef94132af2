"""Build a room around a person: walls, floor, ceiling, furniture, positions of other people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glsim.core.seeds import pcg_rng
from glsim.looks.room import layout
from glsim.looks.room.furniture import make_seat, sample_albedo
from glsim.looks.shapes import Shape, moved, plate, turned

Rng = np.random.Generator

#: Radius of the free floor around a person, mm: half the distance between an adult's elbows is
#: 0.25 m (DIN 33402), and arms move.
PERSON_RADIUS_MM = 480.0
#: Half the width of the free way at the camera, mm. Chosen for the camera and its stand.
_CAMERA_RADIUS_MM = 250.0
#: Smallest gap between the way and a wall, mm. The value was chosen.
_WALL_GAP_MM = 120.0


@dataclass(frozen=True)
class RoomNumbers:
    """All numbers that determine a room, in room axes: mm, origin on the floor below the face.

    Args:
        behind_mm: distance from the face to the back wall.
        turn_deg: rotation of the room about the vertical axis.
        camera_mm: (x, z) of the camera before the rotation.
        reach_mm: area that the person needs: x of its left and right end, depth behind the face.
        clutter: share of the possible small objects, 0 to 1.
        seat_mm: height of the seat above the floor, and z of the backrest; None: a person stands.
    """

    kind: str
    seed: int
    behind_mm: float
    width_mm: float
    height_mm: float
    turn_deg: float
    clutter: float
    people: int
    seat_mm: tuple[float, float] | None
    camera_mm: tuple[float, float]
    reach_mm: tuple[float, float, float]


def build_room(n: RoomNumbers) -> tuple[list[Shape], list[tuple[float, float, float]]]:
    """Build a room: return its shapes, and (x, z, turn) of other people in mm and degrees.

    It is a pure function of the numbers. Axes: mm, origin on the floor below the face, +z towards
    the camera, before the rotation of the room.
    """
    way = _way(n)
    # The walls of a convex room that contains the whole way.
    share = _rng(n, "extent").uniform(0.3, 0.7)
    left = min(-share * n.width_mm, *(x - r - _WALL_GAP_MM for x, _, r in way))
    right = max((1 - share) * n.width_mm, *(x + r + _WALL_GAP_MM for x, _, r in way))
    back = min(-n.behind_mm, *(z - r for _, z, r in way))
    front = max(z + r for _, z, r in way) + 600.0
    walls = _walls(n, left, back, right, front)
    paint = sample_albedo(_rng(n, "paint"), "wall paint")
    shapes: list[Shape] = []
    for wall in walls:
        shapes += layout.build_wall(_rng(n, "shell", wall.name), wall, n.height_mm, paint)
    corners = [(left, back), (left, front), (right, front), (right, back)]
    rng = _rng(n, "levels")
    ground = "carpet" if rng.random() < 0.3 else "floor"
    floor = [(x, 0.0, z) for x, z in corners]  # counter-clockwise from above
    shapes.append(plate(floor, sample_albedo(rng, ground), region="floor"))
    ceiling = [(x, n.height_mm, z) for x, z in corners[::-1]]
    shapes.append(plate(ceiling, sample_albedo(rng, "ceiling paint"), region="ceiling"))
    plan = layout.FloorPlan((left, back, right, front), [*way])
    people = _places(n, plan)
    for wall in walls:
        shapes += layout.furnish_wall(_rng(n, "wall", wall.name), n.kind, wall, plan, n.clutter)
    shapes += layout.stand_free(_rng(n, "free"), n.kind, plan, n.clutter)
    if n.seat_mm is not None:
        seat = make_seat(_rng(n, "seat"), n.kind, n.seat_mm)
        shapes += moved(seat, turn_deg=-n.turn_deg)  # it faces the camera
    return moved(shapes, turn_deg=n.turn_deg), people


def _rng(numbers: RoomNumbers, *words: str) -> Rng:
    return pcg_rng("room", numbers.seed, *words)


def _way(n: RoomNumbers) -> list[tuple[float, float, float]]:
    """Return the discs (x, z, radius), mm, of the free way, in the rotated room."""
    left, right, back = n.reach_mm
    camera = np.array([n.camera_mm[0], 0.0, n.camera_mm[1]])
    person = np.array([(left + right) / 2, 0.0, -back])
    radius = PERSON_RADIUS_MM + (right - left) / 2
    steps = np.linspace(0, 1, 24)[:, None]
    points = turned(camera + steps * (person - camera), -n.turn_deg)
    # The way has its full width in the person's area, and is narrower towards the camera.
    radii = _CAMERA_RADIUS_MM + np.clip(steps[:, 0] * 1.3, 0, 1) * (radius - _CAMERA_RADIUS_MM)
    return [(float(p[0]), float(p[2]), float(r)) for p, r in zip(points, radii, strict=True)]


def _walls(
    n: RoomNumbers, left: float, back: float, right: float, front: float
) -> list[layout.Wall]:
    places = (
        ("back", (left, back), 0.0, right - left),
        ("left", (left, front), 90.0, front - back),
        ("right", (right, back), -90.0, front - back),
    )
    walls = []
    for name, start, turn, length in places:
        rng = _rng(n, "openings", name)
        doors, windows = int(rng.random() < 0.45), int(rng.choice([0, 1, 1, 2]))
        if n.kind == "empty":
            doors, windows = int(name == "left"), int(name == "right")
        openings = layout.sample_openings(rng, length, n.height_mm, doors, windows)
        walls.append(layout.Wall(name, start, turn, length, tuple(openings)))
    return walls


def _places(n: RoomNumbers, plan: layout.FloorPlan) -> list[tuple[float, float, float]]:
    """Sample positions (x, z, turn) of other people, 1 to 3 m from the person, in the room."""
    rng, found = _rng(n, "people"), []
    for _ in range(n.people):
        for _ in range(30):
            angle, far = rng.uniform(-1.1, 1.1), rng.uniform(1000, 3000)
            at = turned(np.array([[far * np.sin(angle), 0.0, -far * np.cos(angle)]]), -n.turn_deg)
            if plan.take_disc(float(at[0, 0]), float(at[0, 2]), 350.0):
                x, _, z = turned(at, n.turn_deg)[0].tolist()
                found.append((x, z, float(rng.uniform(-70, 70)) + n.turn_deg))
                break
    return found
