"""Chairs, office chairs and sofas. Sizes are those of EN 1729, EN 1335 and EN 12520, or chosen.

Each function returns shapes that stand on the floor at the origin and face +z, drawn from ``rng``.
"""

from __future__ import annotations

import numpy as np

from glsim.scene.materials import draw_albedo
from glsim.scene.shapes import Shape, box, rod

Rng = np.random.Generator


#: From the middle of a chair to the front of its back, mm.
BACKREST_MM = 205.0


def chair(rng: Rng, seat_mm: float | None = None) -> list[Shape]:
    """A wooden chair: four legs, rails, a seat, and a back with slats.

    Args:
        seat_mm: height of the seat; default: drawn.
    """
    wood = draw_albedo(rng, "painted wood" if rng.random() < 0.5 else "wood")
    drawn = rng.uniform(430, 460)  # EN 12520: 400 to 480
    seat_mm = drawn if seat_mm is None else seat_mm
    width, depth = rng.uniform(390, 450), rng.uniform(390, 430)
    top_mm, leg = seat_mm + rng.uniform(390, 490), rng.uniform(28, 42)
    x, front, back = width / 2 - leg / 2, depth / 2 - leg / 2, -depth / 2 + leg / 2
    lean = rng.uniform(20, 70)  # how far the back leans at its top
    shapes = [box((width, 22, depth), (0, seat_mm - 22, 0), wood, edge_mm=8)]
    for side in (-1, 1):
        shapes.append(box((leg, seat_mm - 22, leg), (side * x, 0, front), wood))
        shapes.append(box((leg, seat_mm - 22, leg), (side * x, 0, back), wood))
        post = rod((side * x, seat_mm - 40, back), (side * x, top_mm, back - lean), 0.7 * leg, wood,
                   end_radius_mm=0.5 * leg, sides=4)  # fmt: skip
        shapes.append(post)
        shapes.append(box((leg * 0.5, 40, front - back - leg), (side * x, 150, 0), wood))
    for z in (front, back):
        shapes.append(box((2 * x - leg, 55, leg * 0.5), (0, seat_mm - 80, z), wood))
    shapes += _slats(rng, wood, seat_mm, top_mm, x, back, lean)
    if rng.random() < 0.3 and seat_mm == drawn:
        cloth = draw_albedo(rng, "cloth")
        pad = box((width - 40, 40, depth - 40), (0, seat_mm, 10), cloth, edge_mm=18, cells=5)
        shapes.append(pad)
    return shapes


def _slats(
    rng: Rng, wood: float, seat_mm: float, top_mm: float, x: float, back: float, lean: float
) -> list[Shape]:
    """The back of a chair: horizontal slats, or upright bars under a rail."""

    def z_at(y: float) -> float:
        return back - lean * (y - seat_mm) / (top_mm - seat_mm)

    rail = box((2 * x, 75, 20), (0, top_mm - 75, z_at(top_mm - 37)), wood, edge_mm=7)
    if rng.random() < 0.5:
        count, height = int(rng.integers(2, 4)), rng.uniform(40, 65)
        heights = np.linspace(seat_mm + 110, top_mm - 110, count) - height / 2
        return [rail, *(box((2 * x, height, 14), (0, y, z_at(y)), wood) for y in heights)]
    count = int(rng.integers(4, 8))
    bars = np.linspace(-x, x, count + 2)[1:-1]
    low, high = seat_mm, top_mm - 60
    return [
        rail,
        *(rod((b, low, z_at(low)), (b, high, z_at(high)), 8, wood, sides=6) for b in bars),
    ]


def office_chair(rng: Rng, seat_mm: float | None = None) -> list[Shape]:
    """A swivel chair: five feet with castors, a column, a seat, a padded back, armrests.

    Args:
        seat_mm: height of the seat under a person, then without armrests; default: drawn.
    """
    cloth = draw_albedo(rng, "cloth" if rng.random() < 0.7 else "leather")
    plastic, metal = draw_albedo(rng, "black plastic"), draw_albedo(rng, "metal")
    drawn, width = rng.uniform(430, 510), rng.uniform(470, 520)  # EN 1335: 400 to 510
    seat_mm = drawn if seat_mm is None else seat_mm
    back_mm = rng.uniform(500, 700)
    shapes = [
        rod((0, 90, 0), (0, seat_mm - 60, 0), 26, metal),
        box((width, 75, 470), (0, seat_mm - 65, 0), cloth, edge_mm=32, cells=5, plump_mm=12),
        rod((0, seat_mm - 40, -190), (0, seat_mm + 190, -265), 22, plastic),
    ]
    for angle in np.arange(5) * 2 * np.pi / 5 + rng.uniform(0, 1):
        foot = np.array([np.sin(angle), 0, np.cos(angle)])
        shapes.append(rod((0, 105, 0), 300 * foot + (0, 75, 0), 24, plastic, end_radius_mm=15))
        caster = rod(300 * foot + (-22, 28, 0), 300 * foot + (22, 28, 0), 28, plastic, sides=10)
        shapes.append(caster)
    back = box((width - 40, back_mm, 65), (0, 0, 0), cloth, edge_mm=30, cells=5, plump_mm=14)
    shapes.append(back.leaned(rng.uniform(4, 14)).moved(0, seat_mm + 100, -235))
    if rng.random() < 0.7 and seat_mm == drawn:
        for side in (-1, 1):
            x, y = side * (width / 2 + 35), seat_mm + rng.uniform(170, 220)
            shapes.append(rod((x, seat_mm - 30, -60), (x, y, -60), 18, plastic, sides=4))
            shapes.append(box((70, 28, 260), (x, y, -30), plastic, edge_mm=12))
            shapes.append(box((abs(x), 25, 40), (x / 2, seat_mm - 80, -60), plastic))
    return shapes


def sofa(rng: Rng) -> list[Shape]:
    """A sofa or an armchair: a base on feet, seat and back cushions, armrests, loose cushions."""
    cloth = draw_albedo(rng, "cloth" if rng.random() < 0.75 else "leather")
    seats = int(rng.integers(1, 4))
    each, arm = rng.uniform(580, 680), rng.uniform(110, 230)
    depth, seat_mm = rng.uniform(820, 950), rng.uniform(400, 450)  # EN 12520; depth chosen
    back_mm, arm_mm = seat_mm + rng.uniform(340, 450), seat_mm + rng.uniform(120, 220)
    width, thick = seats * each + 2 * arm, rng.uniform(130, 180)
    inner = depth - 180
    shapes = [
        box((seats * each, seat_mm - thick - 60, depth - 40), (0, 60, 0), cloth, edge_mm=20),
        box((width - 20, back_mm - 90, 170), (0, 60, -depth / 2 + 90), cloth, edge_mm=50),
    ]
    for n in range(seats):
        x = (n - (seats - 1) / 2) * each
        seat = box((each - 6, thick, inner), (x, seat_mm - thick, 80), cloth,
                   edge_mm=45, cells=5, plump_mm=18)  # fmt: skip
        shapes.append(seat)
        high = back_mm - seat_mm + 20
        back = box((each - 14, high, 170), (0, 0, 0), cloth, edge_mm=55, cells=5, plump_mm=25)
        shapes.append(back.leaned(10).moved(x, seat_mm - 10, -depth / 2 + 230))
    for side in (-1, 1):
        x = side * (width / 2 - arm / 2)
        shapes.append(box((arm, arm_mm - 50, depth), (x, 50, 0), cloth, edge_mm=45, cells=5))
        for z in (-1, 1):
            at = side * (width / 2 - 60), z * (depth / 2 - 60)
            shapes.append(rod((at[0], 0, at[1]), (at[0], 62, at[1]), 22, 0.5))
    for _ in range(int(rng.integers(0, seats + 1))):
        other = draw_albedo(rng, "cloth")
        pillow = box((430, 400, 140), (0, 0, 0), other, edge_mm=62, cells=7, plump_mm=35)
        x = rng.uniform(-0.5, 0.5) * (seats * each - 430)
        turn = rng.uniform(-15, 15)
        shapes.append(pillow.leaned(22).moved(x, seat_mm + 12, -depth / 2 + 420, turn_deg=turn))
    return shapes
