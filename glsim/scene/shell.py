"""The shell of a room: floor, ceiling, and walls with doors and windows as recesses with frames."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glsim.scene.materials import draw_albedo
from glsim.scene.shapes import Shape, box, moved, plate, rod

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
    for opening in wall.openings:
        shapes += (
            _door(rng, opening, trim) if opening.kind == "door" else _window(rng, opening, trim)
        )
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


def _jamb(o: Opening, deep: float, albedo: float) -> list[Shape]:
    """The four inner sides of a recess ``deep`` mm into the wall."""
    a, b, c, d = o.left, o.right, o.low, o.high
    sides = [
        [(a, c, -deep), (a, d, -deep), (a, d, 0), (a, c, 0)],
        [(b, d, 0), (b, d, -deep), (b, c, -deep), (b, c, 0)],
        [(a, d, -deep), (b, d, -deep), (b, d, 0), (a, d, 0)],
        [(b, c, 0), (b, c, -deep), (a, c, -deep), (a, c, 0)],
    ]
    return [plate(side, albedo, region="wall") for side in sides]


def _frame(
    o: Opening, bar: float, thick: float, z: float, albedo: float, sill: bool
) -> list[Shape]:
    """Bars around an opening, on its outside."""
    a, b, c, d = o.left, o.right, o.low, o.high
    shapes = [
        box((bar, d - c + bar, thick), (a - bar / 2, c, z), albedo, region="door"),
        box((bar, d - c + bar, thick), (b + bar / 2, c, z), albedo, region="door"),
        box((b - a, bar, thick), ((a + b) / 2, d, z), albedo, region="door"),
    ]
    if sill:
        board = box((b - a + 160, 28, 150), ((a + b) / 2, c - 28, 60), albedo, edge_mm=8)
        shapes.append(board)
    return shapes


def _door(rng: Rng, o: Opening, trim: float) -> list[Shape]:
    """A closed door: jamb, leaf with raised panels or plain, architrave, handle."""
    leaf_mm = rng.uniform(10, 90)  # how deep the leaf lies in the wall
    leaf, metal = draw_albedo(rng, "painted wood"), draw_albedo(rng, "metal")
    middle, width, high = (o.left + o.right) / 2, o.right - o.left, o.high
    z = -leaf_mm
    corners = [(o.left, 0, z), (o.right, 0, z), (o.right, high, z), (o.left, high, z)]
    shapes = [*_jamb(o, leaf_mm, trim), plate(corners, leaf, region="door")]
    if rng.random() < 0.6:
        for y, tall in ((160, 0.36 * high), (0.36 * high + 320, 0.48 * high)):
            size = width - 260, tall, 12
            shapes.append(box(size, (middle, y, z + 6), leaf, edge_mm=5, region="door"))
    shapes += _frame(o, 70, 16, 8, trim, sill=False)
    x = o.right - 70 if rng.random() < 0.5 else o.left + 70
    inward = 110 if x < middle else -110
    shapes.append(rod((x, 1050, z), (x, 1050, z + 55), 9, metal, region="door"))
    shapes.append(rod((x, 1050, z + 50), (x + inward, 1050, z + 50), 9, metal, region="door"))
    return shapes


def _window(rng: Rng, o: Opening, trim: float) -> list[Shape]:
    """A window: recess, wooden sashes, panes without a return, sill."""
    deep, bar = rng.uniform(100, 220), rng.uniform(55, 80)
    a, b, c, d = o.left, o.right, o.low, o.high
    z, glass = -deep, draw_albedo(rng, "glass")
    pane = plate([(a, c, z), (b, c, z), (b, d, z), (a, d, z)], glass, region="window")
    shapes = [*_jamb(o, deep, trim), pane]
    sashes = 2 if b - a > 1100 else 1
    w = (b - a) / sashes
    for n in range(sashes):
        x = a + (n + 0.5) * w
        for y in (c, d - bar):
            shapes.append(box((w, bar, 50), (x, y, z + 25), trim, edge_mm=6, region="window"))
        for side in (-1, 1):
            at = x + side * (w - bar) / 2, c + bar, z + 25
            shapes.append(box((bar, d - c - 2 * bar, 50), at, trim, edge_mm=6, region="window"))
    return shapes + _frame(o, 0.1, 0.2, 0.1, trim, sill=True)[-1:]


def build_level(corners_mm: Sequence[tuple[float, float]], y: float, albedo: float) -> Shape:
    """A floor (y = 0) or a ceiling (y > 0) with (x, z) corners, counter-clockwise from above."""
    points = np.array([(x, y, z) for x, z in corners_mm])
    if y > 0:
        return plate(points[::-1], albedo, region="ceiling")
    return plate(points, albedo, region="floor")
