"""Build the walls of a room, and place furniture along walls, on walls and in the middle.

The way from the camera to the person stays free: no object hides the face. Room axes are in
millimetres, with the origin on the floor below the face and +y up; the back wall is at -z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from glsim.looks.room.furniture import catalogue, choose, coat, curtain, make_thing, sample_albedo
from glsim.looks.shapes import Shape, bounds_mm, box, moved, plate, rod

Rng = np.random.Generator
#: Left end, right end and top of a piece of furniture at a wall, mm.
Span = tuple[float, float, float]


class Opening(NamedTuple):
    """A "door" or "window": its ends along the wall, and its heights above the floor, mm."""

    kind: str
    left: float
    right: float
    low: float
    high: float


class Wall(NamedTuple):
    """A wall in its own axes (plane z = 0, x from 0 to ``length``, facing +z), placed in a room.

    ``start`` is its left end, (x, z) mm. ``turn_deg`` is its rotation about the vertical axis.
    """

    name: str
    start: tuple[float, float]
    turn_deg: float
    length: float
    openings: Sequence[Opening] = ()

    def placed(self, shapes: Sequence[Shape]) -> list[Shape]:
        """Move shapes from the wall's axes to the room's axes."""
        return moved(shapes, self.start[0], 0.0, self.start[1], turn_deg=self.turn_deg)


def sample_openings(
    rng: Rng, length: float, height: float, doors: int, windows: int
) -> list[Opening]:
    """Sample up to ``doors`` doors and ``windows`` windows of a wall, mm, without overlap."""
    # Doors: DIN 18101 (735 to 985 by 1985 to 2110 mm). Sizes of windows were chosen.
    openings: list[Opening] = []
    for kind in ["door"] * doors + ["window"] * windows:
        if kind == "door":
            width, low, high = rng.uniform(760, 985), 0.0, rng.uniform(1985, 2110)
        else:
            width, low = rng.uniform(800, 1700), rng.uniform(750, 950)
            high = min(height - 250, rng.uniform(2050, 2250))
        for _ in range(8):
            left = rng.uniform(150, max(151, length - width - 150))
            right = left + width
            if right > length - 100:
                continue
            if all(right + 250 < o.left or left - 250 > o.right for o in openings):
                openings.append(Opening(kind, left, right, low, high))
                break
    return openings


def build_wall(rng: Rng, wall: Wall, height: float, paint: float) -> list[Shape]:
    """Make a wall of ``height`` with its doors, windows and skirting, in room axes, mm."""
    shapes: list[Shape] = []
    columns = sorted({0.0, wall.length, *(x for o in wall.openings for x in (o.left, o.right))})
    rows = sorted({0.0, height, *(y for o in wall.openings for y in (o.low, o.high))})
    for (a, b), (c, d) in product(pairwise(columns), pairwise(rows)):
        x, y = (a + b) / 2, (c + d) / 2
        if not any(o.left < x < o.right and o.low < y < o.high for o in wall.openings):
            corners = [(a, c, 0), (b, c, 0), (b, d, 0), (a, d, 0)]
            shapes.append(plate(corners, paint, region="wall"))
    trim = sample_albedo(rng, "painted wood")
    for o in wall.openings:
        if o.kind == "door":
            name = "panelled door" if rng.random() < 0.6 else "door"
        else:
            name = "double window" if o.right - o.left > 1100 else "window"
        thing = make_thing(rng, name, fit_mm=(o.right - o.left, o.high - o.low))
        shapes += moved(thing, (o.left + o.right) / 2, o.low)
    doors = sorted((o for o in wall.openings if o.kind == "door"), key=lambda o: o.left)
    ends = [0.0, *(x for o in doors for x in (o.left - 70, o.right + 70)), wall.length]
    for left, right in zip(ends[::2], ends[1::2], strict=True):
        if right - left > 20:
            at = (left + right) / 2, 0, 7
            shapes.append(box((right - left, 70, 14), at, trim, region="wall"))
    return wall.placed(shapes)


@dataclass
class FloorPlan:
    """The floor of a room: its extent and its occupied areas.

    ``extent``: (left, back, right, front), mm; ``discs``: (x, z, radius) on the way from the camera
    to the person, and around other people; ``areas``: (x0, z0, x1, z1) covered by furniture.
    """

    extent: tuple[float, float, float, float]
    discs: list[tuple[float, float, float]] = field(default_factory=list)
    areas: list[tuple[float, float, float, float]] = field(default_factory=list)

    def take(self, shapes: Sequence[Shape], gap_mm: float = 20.0) -> bool:
        """Reserve the floor under shapes in room axes; return False if it is occupied."""
        low, high = bounds_mm(shapes)
        a = low[0] - gap_mm, low[2] - gap_mm, high[0] + gap_mm, high[2] + gap_mm
        left, back, right, front = self.extent
        if low[0] < left or low[2] < back or high[0] > right or high[2] > front:
            return False
        if any(a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] for b in self.areas):
            return False
        for x, z, radius in self.discs:
            dx = max(a[0] - x, 0.0, x - a[2])
            dz = max(a[1] - z, 0.0, z - a[3])
            if dx * dx + dz * dz < radius * radius:
                return False
        self.areas.append((float(a[0]), float(a[1]), float(a[2]), float(a[3])))
        return True

    def take_disc(self, x: float, z: float, radius: float) -> bool:
        """Reserve a disc of the floor, mm; return False if it is occupied."""
        left, back, right, front = self.extent
        if not (left + radius < x < right - radius and back + radius < z < front - radius):
            return False
        if any((x - u) ** 2 + (z - v) ** 2 < (radius + r) ** 2 for u, v, r in self.discs):
            return False
        self.discs.append((x, z, radius))
        return True


def furnish_wall(rng: Rng, kind: str, wall: Wall, plan: FloorPlan, clutter: float) -> list[Shape]:
    """Make furniture, pictures and coats at a wall, in room axes; ``clutter``: share, 0 to 1."""
    shapes: list[Shape] = []
    spans: list[Span] = []
    x, choices = rng.uniform(20, 500), catalogue()["rooms"][kind]["wall"]
    while choices and x < wall.length - 300:
        if rng.random() > 0.25 + 0.75 * clutter:
            x += rng.uniform(500, 1200)
            continue
        name = choose(rng, choices)
        thing = make_thing(rng, name, clutter)
        low, high = bounds_mm(thing)
        right = x + high[0] - low[0]
        blocking = [o for o in wall.openings if _blocks(o, x, right, float(high[1]))]
        if blocking:
            x = max(o.right for o in blocking) + rng.uniform(100, 250)
            continue
        if right > wall.length - 20:
            break
        placed = wall.placed(moved(thing, x - low[0], z=rng.uniform(18, 40) - low[2]))
        if plan.take(placed):
            shapes += placed
            spans.append((x, right, float(high[1])))
            if name == "desk" and rng.random() < 0.7:
                away = float(high[2] - low[2]) + rng.uniform(250, 420)
                chair, turn = make_thing(rng, "office armchair"), 180 + rng.uniform(-50, 50)
                chair = wall.placed(moved(chair, (x + right) / 2, z=away, turn_deg=turn))
                shapes += chair if plan.take(chair, 0.0) else []
        x = right + rng.choice([rng.uniform(0, 60), rng.uniform(200, 900)])
    for opening in wall.openings:
        if opening.kind == "window":
            shapes += _at_window(rng, wall, opening, plan, spans)
    return shapes + (_on_wall(rng, wall, spans, clutter) if choices else [])


def _blocks(opening: Opening, left: float, right: float, top: float) -> bool:
    """Return whether an object from ``left`` to ``right`` blocks a door or hides a window."""
    margin = 120 if (is_door := opening.kind == "door") else 20
    apart = right < opening.left - margin or left > opening.right + margin
    return not apart and (is_door or top > opening.low + 150)


def _at_window(
    rng: Rng, wall: Wall, window: Opening, plan: FloorPlan, spans: Sequence[Span]
) -> list[Shape]:
    """Make curtains beside a window and, if the floor is free, a radiator below it."""
    shapes: list[Shape] = []
    middle, width = (window.left + window.right) / 2, window.right - window.left
    clear = all(right < window.left - 150 or left > window.right + 150 for left, right, _ in spans)
    if clear and rng.random() < 0.7:
        radiator = wall.placed(moved(make_thing(rng, "radiator"), middle, 130.0))
        shapes += radiator if plan.take(radiator, 0.0) else []
    if rng.random() < 0.6:
        top, cloth = window.high + rng.uniform(60, 140), rng.uniform(280, 480)
        bottom = 25.0 if clear and rng.random() < 0.6 else window.low - 120
        start, end = ((middle + side * (width / 2 + cloth), top + 15, 90) for side in (-1, 1))
        shapes += wall.placed([rod(start, end, 13, 0.6)])
        for side in (-1, 1):
            at = middle + side * (width / 2 + 0.15 * cloth)
            if cloth / 2 < at < wall.length - cloth / 2:
                shapes += wall.placed(moved(curtain(rng, cloth, top, bottom), at))
    return shapes


def _on_wall(rng: Rng, wall: Wall, spans: Sequence[Span], clutter: float) -> list[Shape]:
    """Make pictures and coats on the free parts of a wall."""
    shapes: list[Shape] = []
    taken = [(o.left - 90, o.right + 90) for o in wall.openings]
    for _ in range(round(rng.uniform(0.5, 1.5) * clutter * wall.length / 1400)):
        hook = rng.random() < 0.2
        thing = coat(rng) if hook else make_thing(rng, "picture")
        low, high = bounds_mm(thing)
        x = rng.uniform(100, wall.length - 100)
        y = 1700.0 if hook else rng.uniform(1450, 1650) - high[1] / 2
        left, right, bottom = x + low[0] - 40, x + high[0] + 40, y + low[1]
        if left < 0 or right > wall.length:
            continue
        under = [top for a, b, top in spans if a < right and left < b]
        if any(a < right and left < b for a, b in taken) or max(under, default=0) > bottom - 60:
            continue
        taken.append((left, right))
        shapes += wall.placed(moved(thing, x, y))
    return shapes


def stand_free(rng: Rng, kind: str, plan: FloorPlan, clutter: float) -> list[Shape]:
    """Make the furniture in the middle of a room; arguments as in ``furnish_wall``."""
    shapes: list[Shape] = []
    left, back, right, front = plan.extent
    choices = catalogue()["rooms"][kind]["free"]
    for _ in range(round(7 * clutter) if choices else 0):
        thing = make_thing(rng, choose(rng, choices), clutter)
        for _ in range(10):
            x, z = rng.uniform(left + 250, right - 250), rng.uniform(back + 250, min(front, 400))
            placed = moved(thing, x, z=z, turn_deg=rng.uniform(-180, 180))
            if plan.take(placed):
                shapes += placed
                break
    return shapes
