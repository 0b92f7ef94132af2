"""The shell of a room: floor, ceiling, and walls with openings for doors and windows."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glsim.looks.room.furniture import draw_albedo, make_thing
from glsim.looks.room.shapes import Shape, box, moved, plate

Rng = np.random.Generator


@dataclass(frozen=True)
class Opening:
    """A door or a window in a wall, mm.

    Args:
        kind: "door" or "window".
        left, right: along the wall.
        low, high: above the floor.
    """

    kind: str
    left: float
    right: float
    low: float
    high: float


@dataclass(frozen=True)
class Wall:
    """A wall as a plane z = 0 from x = 0 to ``length`` that faces +z, and its place in the room.

    Args:
        start: (x, z) of its left end in the room, mm.
        turn_deg: about the vertical axis.
        openings: its doors and windows.
    """

    name: str
    start: tuple[float, float]
    turn_deg: float
    length: float
    openings: tuple[Opening, ...] = ()

    def placed(self, shapes: Sequence[Shape]) -> list[Shape]:
        """Move shapes from the wall's axes to the room's."""
        return moved(shapes, self.start[0], 0.0, self.start[1], turn_deg=self.turn_deg)


def draw_openings(
    rng: Rng, length: float, height: float, doors: int, windows: int
) -> list[Opening]:
    """Draw doors and windows that fit into a wall without touching each other.

    Doors: DIN 18101 (735 to 985 by 1985 to 2110 mm); sizes of windows chosen.
    """
    found: list[Opening] = []
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
            if all(right + 250 < o.left or left - 250 > o.right for o in found):
                found.append(Opening(kind, left, right, low, high))
                break
    return found


def build_wall(rng: Rng, wall: Wall, height: float, paint: float) -> list[Shape]:
    """Return the shapes of a wall in the room's axes, with its doors, windows and skirting."""
    shapes = _pierced(wall, height, paint)
    trim = draw_albedo(rng, "painted wood")
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
            strip = box((right - left, 70, 14), ((left + right) / 2, 0, 7), trim, region="wall")
            shapes.append(strip)
    return wall.placed(shapes)


def _pierced(wall: Wall, height: float, paint: float) -> list[Shape]:
    """The wall's plane without its openings: a grid of rectangles that share all corners."""
    columns = sorted({0.0, wall.length, *(x for o in wall.openings for x in (o.left, o.right))})
    rows = sorted({0.0, height, *(y for o in wall.openings for y in (o.low, o.high))})
    shapes = []
    for a, b in itertools.pairwise(columns):
        for c, d in itertools.pairwise(rows):
            x, y = (a + b) / 2, (c + d) / 2
            if not any(o.left < x < o.right and o.low < y < o.high for o in wall.openings):
                corners = [(a, c, 0), (b, c, 0), (b, d, 0), (a, d, 0)]
                shapes.append(plate(corners, paint, region="wall"))
    return shapes


def build_level(corners_mm: Sequence[tuple[float, float]], y: float, albedo: float) -> Shape:
    """A floor (y = 0) or a ceiling (y > 0) with (x, z) corners, counter-clockwise from above."""
    points = np.array([(x, y, z) for x, z in corners_mm])
    if y > 0:
        return plate(points[::-1], albedo, region="ceiling")
    return plate(points, albedo, region="floor")
