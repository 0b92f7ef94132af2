"""Tables and desks, and the things that stand on them. Sizes: EN 527 (desks), else chosen.

A table stands on the floor at the origin; its front, where a person would sit, faces +z. A thing
stands on y = 0 at the origin.
"""

from __future__ import annotations

import numpy as np

from glsim.scene.dark_things import cable, cables_behind, telephone
from glsim.scene.materials import draw_albedo
from glsim.scene.shapes import Shape, bounds_mm, box, moved, plate, rod, turned_body

Rng = np.random.Generator


def table(rng: Rng, width_mm: float, depth_mm: float, height_mm: float) -> list[Shape]:
    """A table: a top with rounded edges, an apron, four legs or two end panels."""
    wood = draw_albedo(rng, "wood" if rng.random() < 0.6 else "painted wood")
    frame = wood if rng.random() < 0.5 else draw_albedo(rng, "metal")
    top, leg = rng.uniform(20, 34), rng.uniform(35, 60)
    shapes = [box((width_mm, top, depth_mm), (0, height_mm - top, 0), wood, edge_mm=6)]
    under, x, z = height_mm - top, width_mm / 2 - leg, depth_mm / 2 - leg
    if rng.random() < 0.75:
        for sx in (-1, 1):
            for sz in (-1, 1):
                shapes.append(box((leg, under, leg), (sx * x, 0, sz * z), frame))
            shapes.append(box((20, 70, 2 * z - leg), (sx * x, under - 70, 0), frame))
    else:
        shapes += [box((25, under, depth_mm - 80), (sx * x, 0, 0), wood) for sx in (-1, 1)]
    shapes.append(box((2 * x - leg, 70, 20), (0, under - 70, -z), frame))
    return shapes


def desk(rng: Rng, clutter: float) -> list[Shape]:
    """A desk with a monitor or a laptop, papers, cups, books and a lamp."""
    width, depth = rng.uniform(1200, 1800), rng.uniform(650, 800)  # EN 527: 1200 to 1800 x 600+
    height = rng.uniform(720, 760)  # EN 527: 740 +- 20
    shapes = table(rng, width, depth, height)
    if rng.random() < 0.6:
        drawers = box((400, height - 90, depth - 120), (width / 2 - 270, 40, 0), 0.8, edge_mm=4)
        shapes.append(drawers)
        for row in range(3):
            y = 60 + row * (height - 130) / 3
            size = 376, (height - 130) / 3 - 14, 14
            shapes.append(box(size, (width / 2 - 270, y, depth / 2 - 55), 0.75, edge_mm=4))
    things = [moved(screen(rng), rng.uniform(-0.2, 0.1) * width, z=-depth / 2 + 210)]
    if rng.random() < 0.5:
        things.append(moved(screen(rng), 0.33 * width, z=-depth / 2 + 220, turn_deg=-20))
    things.append([box((440, 18, 140), (0, 0, 60), draw_albedo(rng, "black plastic"), edge_mm=5)])
    for _ in range(round(8 * clutter)):
        thing = small_thing(rng)
        x, z = rng.uniform(-0.45, 0.45) * width, rng.uniform(-0.3, 0.38) * depth
        things.append(moved(thing, x, z=z, turn_deg=rng.uniform(-40, 40)))
    shapes += cables_behind(rng, int(rng.integers(1, 5)), width, -depth / 2, height)
    if rng.random() < 0.5:  # a charger's cable hangs over the front or a side
        edge = rng.uniform(-0.4, 0.4) * width
        shapes += cable(rng, (edge, height + 3, depth / 2 + 4), (edge, 200.0, depth / 2 + 30))
    return shapes + _apart(things, width, depth, height)


def low_table(rng: Rng, clutter: float) -> list[Shape]:
    """A sofa table with small things on it."""
    width, depth, height = rng.uniform(700, 1200), rng.uniform(450, 650), rng.uniform(380, 460)
    shapes = table(rng, width, depth, height)
    things = []
    for _ in range(round(6 * clutter)):
        x, z = rng.uniform(-0.4, 0.4) * width, rng.uniform(-0.4, 0.4) * depth
        things.append(moved(small_thing(rng), x, z=z, turn_deg=rng.uniform(-60, 60)))
    return shapes + _apart(things, width, depth, height)


def _apart(
    things: list[list[Shape]], width_mm: float, depth_mm: float, height_mm: float
) -> list[Shape]:
    """The things that lie on the table without touching an earlier one, at its height."""
    taken: list[tuple[float, float, float, float]] = []
    kept: list[Shape] = []
    for thing in things:
        low, high = bounds_mm(thing)
        a = float(low[0]), float(low[2]), float(high[0]), float(high[2])
        inside = max(-a[0], a[2]) < width_mm / 2 and max(-a[1], a[3]) < depth_mm / 2
        if inside and not any(
            a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] for b in taken
        ):
            taken.append(a)
            kept += moved(thing, y=height_mm)
    return kept


def screen(rng: Rng) -> list[Shape]:
    """A monitor on a foot; its screen returns no light."""
    width = rng.uniform(490, 620)  # 22 to 28 inches
    height, plastic = width * 0.5625, draw_albedo(rng, "black plastic")
    lift = rng.uniform(90, 160)
    glass = draw_albedo(rng, "screen")
    w, h = width / 2 - 9, height - 9
    pane = plate([(-w, 14, 0), (w, 14, 0), (w, h, 0), (-w, h, 0)], glass, region="screen")
    frame = box((width, height, 34), (0, lift, -18), plastic, edge_mm=5)
    return [
        frame,
        pane.moved(0, lift, 1.5),
        box((90, lift + 80, 22), (0, 6, -48), plastic),
        box((230, 12, 180), (0, 0, -40), plastic, edge_mm=5),
    ]


def television(rng: Rng) -> list[Shape]:
    """A television on two feet."""
    width = rng.uniform(900, 1300)  # 40 to 58 inches
    height, plastic = width * 0.5625, draw_albedo(rng, "lacquer")
    w, h, glass = width / 2 - 10, height - 10, draw_albedo(rng, "screen")
    pane = plate([(-w, 10, 0), (w, 10, 0), (w, h, 0), (-w, h, 0)], glass, region="screen")
    feet = [box((24, 64, 240), (s * width / 3, 0, -25), plastic) for s in (-1, 1)]
    return [box((width, height, 50), (0, 60, -27), plastic, edge_mm=8), pane.moved(0, 60, 1), *feet]


def small_thing(rng: Rng) -> list[Shape]:
    """A cup, a bottle, a pile of paper or books, a box, a telephone, or a desk lamp."""
    kind = rng.choice(["cup", "bottle", "papers", "books", "box", "telephone", "lamp"],
                      p=[0.22, 0.12, 0.2, 0.18, 0.1, 0.08, 0.1])  # fmt: skip
    if kind == "cup":
        pot, radius = draw_albedo(rng, "pot"), rng.uniform(36, 46)
        high = rng.uniform(80, 110)
        wall = [(0, 0), (radius * 0.85, 0), (radius, high), (radius - 5, high), (radius - 8, 12)]
        return [turned_body([*wall, (0, 10)], pot, segments=14)]
    if kind == "bottle":
        radius, high = rng.uniform(32, 45), rng.uniform(210, 310)
        profile = [(0, 0), (radius, 0), (radius, 0.6 * high), (14, 0.8 * high), (14, high)]
        return [turned_body([*profile, (0, high)], draw_albedo(rng, "pot"), segments=12)]
    if kind == "papers":
        return [box((210, rng.uniform(4, 40), 297), (0, 0, 0), draw_albedo(rng, "paper"))]
    if kind == "books":
        return book_pile(rng, int(rng.integers(1, 5)))
    if kind == "box":
        size = rng.uniform(90, 260), rng.uniform(60, 200), rng.uniform(80, 240)
        return [box(size, (0, 0, 0), draw_albedo(rng, "paper"), edge_mm=3)]
    return telephone(rng) if kind == "telephone" else desk_lamp(rng)


def book_pile(rng: Rng, count: int) -> list[Shape]:
    """Books that lie on each other, each a little turned."""
    shapes, y = [], 0.0
    for _ in range(count):
        size = rng.uniform(140, 230), rng.uniform(15, 45), rng.uniform(190, 300)
        book = box(size, (0, y, 0), draw_albedo(rng, "paper"))
        shapes.append(book.moved(rng.uniform(-15, 15), turn_deg=rng.uniform(-12, 12)))
        y += size[1]
    return shapes


def desk_lamp(rng: Rng) -> list[Shape]:
    """A lamp with a jointed arm."""
    metal, reach, high = draw_albedo(rng, "metal"), rng.uniform(120, 200), rng.uniform(320, 430)
    knee, head = (-reach * 0.6, 0.55 * high, 0), (reach * 0.5, high, 0)
    shade = turned_body([(65, -70), (30, 30), (0, 40), (0, 30), (60, -72)], metal, segments=12)
    base = turned_body([(0, 0), (85, 0), (85, 18), (0, 24)], metal, segments=14)
    arms = [rod((0, 10, 0), knee, 9, metal, sides=6), rod(knee, head, 9, metal, sides=6)]
    return [base, *arms, shade.moved(*head)]
