"""Things that return little light, and thin ones: cables, loudspeakers, bags, a piano, telephones.

A camera that measures with its own light loses these first. Each stands on y = 0 at the origin, its
front faces +z. Sizes are chosen if no source stands beside them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from glsim.scene.materials import draw_albedo
from glsim.scene.shapes import Shape, bounds_mm, box, moved, rod, turned_body

Rng = np.random.Generator

#: Straight pieces of a hanging cable.
_PIECES = 6


def cable(
    rng: Rng, start_mm: ArrayLike, end_mm: ArrayLike, *, slack_mm: float | None = None
) -> list[Shape]:
    """A black cable of 4 to 8 mm that hangs between two points, (3,) mm each.

    Args:
        slack_mm: how far its middle hangs below the straight line; drawn if None.
    """
    start, end = np.asarray(start_mm, np.float64), np.asarray(end_mm, np.float64)
    slack = float(rng.uniform(20, 160)) if slack_mm is None else slack_mm
    albedo, radius = draw_albedo(rng, "black plastic"), float(rng.uniform(2, 4))
    along = np.linspace(0, 1, _PIECES + 1)[:, None]
    points = start + along * (end - start)
    points[:, 1] -= 4 * slack * (along * (1 - along))[:, 0]
    points[:, 1] = np.maximum(points[:, 1], radius)  # it lies on the floor
    return [rod(a, b, radius, albedo, sides=4) for a, b in pairwise(points)]


def cables_behind(
    rng: Rng, count: int, width_mm: float, back_mm: float, height_mm: float
) -> list[Shape]:
    """Cables that hang from the back edge of a table to a socket strip on the floor.

    Args:
        width_mm, height_mm: of the table, whose middle is at x = 0.
        back_mm: z of its back edge.
    """
    x = rng.uniform(-0.3, 0.3) * width_mm
    shapes = [box((260, 40, 55), (x, 0, back_mm + 40), draw_albedo(rng, "black plastic"))]
    for _ in range(count):
        top = (rng.uniform(-0.45, 0.45) * width_mm, height_mm, back_mm)
        shapes += cable(rng, top, (x + rng.uniform(-110, 110), 45.0, back_mm + 40))
    return shapes


def loudspeaker(rng: Rng) -> list[Shape]:
    """A lacquered loudspeaker on the floor, with two cones behind which no light returns."""
    width, depth, height = rng.uniform(180, 260), rng.uniform(230, 330), rng.uniform(750, 1100)
    lacquer, cone = draw_albedo(rng, "lacquer"), draw_albedo(rng, "black plastic")
    shapes = [box((width, height, depth), (0, 0, 0), lacquer, edge_mm=6)]
    for share, radius in ((0.62, 0.40 * width), (0.84, 0.22 * width)):
        dish = turned_body([(0.25 * radius, 0), (radius, 14), (radius + 9, 14)], cone, segments=16)
        shapes.append(dish.leaned(-90).moved(0, share * height, depth / 2 + 1))
    return shapes


def bag(rng: Rng) -> list[Shape]:
    """A rucksack of dark leather or plastic on the floor, with a pocket and two straps."""
    skin = draw_albedo(rng, "leather" if rng.random() < 0.5 else "black plastic")
    width, depth, height = rng.uniform(270, 340), rng.uniform(140, 200), rng.uniform(400, 500)
    body = box((width, height, depth), (0, 0, 0), skin, edge_mm=60, cells=7, plump_mm=18)
    pocket = box((0.75 * width, 0.45 * height, 60), (0, 25, depth / 2), skin * 0.9, edge_mm=25,
                 cells=5, plump_mm=8)  # fmt: skip
    straps = [
        rod(
            (s * 60, 0.9 * height, -depth / 2 - 25),
            (s * 75, 60, -depth / 2 - 25),
            14,
            skin,
            sides=6,
        )
        for s in (-1, 1)
    ]
    lean_deg = rng.uniform(4, 10)
    shapes = [shape.leaned(lean_deg) for shape in (body, pocket, *straps)]
    return moved(shapes, y=-float(bounds_mm(shapes)[0][1]))


def piano(rng: Rng) -> list[Shape]:
    """An upright piano in black lacquer with white and black keys."""
    width, height = 1480.0, rng.uniform(1100, 1310)  # makers' data sheets: 1.10 to 1.31 m high
    lacquer, ivory = draw_albedo(rng, "lacquer"), draw_albedo(rng, "painted wood")
    upper, lower, bed_mm = 300.0, 360.0, 620.0
    shapes = [
        box((width, height, upper), (0, 0, -upper / 2), lacquer, edge_mm=5),
        box((width, 110, lower - 60), (0, bed_mm, lower / 2 - 30), lacquer, edge_mm=5),
        box((1230, 22, 150), (0, bed_mm + 110, 75), ivory),  # 52 white keys of 23.6 mm
    ]
    for side in (-1, 1):
        cheek = box(
            (60, 230, lower - 60), (side * (width / 2 - 30), bed_mm, lower / 2 - 30), lacquer
        )
        leg = box((60, bed_mm, 60), (side * (width / 2 - 30), 0, lower - 110), lacquer)
        shapes += [cheek, leg]
    for key in range(51):
        if key % 7 not in (1, 4):  # from A: no black key after B and E
            x = -615 + 23.65 * (key + 1)
            shapes.append(box((11, 12, 95), (x, bed_mm + 132, 50), lacquer))
    return shapes


def telephone(rng: Rng) -> list[Shape]:
    """A telephone or tablet that lies on its back: glass that returns no light, 8 mm thick."""
    size = (75, 8, 155) if rng.random() < 0.6 else (170, 8, 245)
    glass = box(
        (size[0] - 6, 1, size[2] - 6), (0, 8, 0), draw_albedo(rng, "screen"), region="screen"
    )
    return [box(size, (0, 0, 0), draw_albedo(rng, "lacquer"), edge_mm=3), glass]
