"""Plants, lamps, pictures, curtains, clothes on hooks, radiators."""

from __future__ import annotations

import numpy as np

from glsim.scene.materials import draw_albedo
from glsim.scene.shapes import Shape, box, plate, rod, sheet, turned_body

Rng = np.random.Generator


def plant(rng: Rng, height_mm: float | None = None) -> list[Shape]:
    """A plant in a pot: stems, and leaves that are bent along their length. Sizes chosen.

    Leaves grow broad on stems, long from the earth (a third of the plants), or thin on stems: 5 to
    12 mm, narrower than a pixel beyond 2 to 4 m.
    """
    height = float(rng.uniform(500, 1500)) if height_mm is None else height_mm
    r, pot_mm = rng.uniform(0.10, 0.15) * max(height, 500), 0.22 * height + 60
    pot = [(0, 0), (0.75 * r, 0), (r, pot_mm), (r - 8, pot_mm), (r - 12, pot_mm - 25)]
    shapes = [turned_body(pot, draw_albedo(rng, "pot"), segments=18)]
    earth = turned_body([(r - 9, pot_mm - 26), (0, pot_mm - 20)], draw_albedo(rng, "earth"))
    shapes.append(earth)
    green, count = draw_albedo(rng, "leaves"), int(rng.integers(35, 70))
    habit = rng.choice(["long", "thin", "broad"], p=[0.3, 0.25, 0.45])
    grassy = habit == "long"
    count = 2 * count if habit == "thin" else count
    stems = 1 if grassy else int(rng.integers(2, 6))
    tips = [
        np.array([rng.normal(0, 0.10), rng.uniform(0.75, 1.0), rng.normal(0, 0.10)]) * height
        for _ in range(stems)
    ]
    root = np.array([0, pot_mm - 25, 0])
    if not grassy:
        shapes += [
            rod(root, tip, 7, green * 0.8, end_radius_mm=3, sides=5, region="plant") for tip in tips
        ]
    for n in range(count):
        turn = rng.uniform(0, 2 * np.pi)
        if grassy:
            start, length = root, rng.uniform(0.6, 1.0) * height
            width, rise = rng.uniform(20, 45), rng.uniform(0.9, 1.4)
        else:
            tip = tips[n % stems]
            start = root + (tip - root) * np.sqrt(rng.uniform(0.12, 1.0))
            length, rise = rng.uniform(0.14, 0.26) * height, rng.uniform(-0.1, 0.9)
            width = rng.uniform(5, 12) if habit == "thin" else length * rng.uniform(0.35, 0.6)
        shapes.append(_leaf(start, turn, rise, length, width, green * rng.uniform(0.9, 1.1)))
    return shapes


def _leaf(
    start: np.ndarray, turn: float, rise: float, length: float, width: float, albedo: float
) -> Shape:
    """A leaf of 5 x 3 vertices: it leaves upwards by ``rise`` radians and bends down."""
    along = np.linspace(0, 1, 6)
    angle = rise - 1.5 * along  # chosen: a leaf hangs at its tip
    out = np.concatenate([[0], np.cumsum(np.cos(angle[:-1]))]) * length / 5
    up = np.concatenate([[0], np.cumsum(np.sin(angle[:-1]))]) * length / 5
    half = width / 2 * np.sin(np.pi * (0.08 + 0.86 * along)) ** 0.7
    across = np.array([-1.0, 0.0, 1.0])
    points = np.empty((6, 3, 3))
    points[..., 0] = out[:, None] * np.sin(turn) + half[:, None] * across * np.cos(turn)
    points[..., 2] = out[:, None] * np.cos(turn) - half[:, None] * across * np.sin(turn)
    points[..., 1] = up[:, None] + 0.25 * half[:, None] * np.abs(across)
    return sheet(points + start, albedo, region="plant")


def floor_lamp(rng: Rng) -> list[Shape]:
    """A standard lamp: foot, pole, shade."""
    metal, shade = draw_albedo(rng, "metal"), draw_albedo(rng, "lamp shade")
    high, r = rng.uniform(1450, 1750), rng.uniform(150, 230)
    low, top = high - rng.uniform(220, 320), rng.uniform(0.5, 0.95) * r
    cone = [(r, low), (top, high), (top - 4, high), (r - 4, low)]
    return [
        turned_body([(0, 0), (140, 0), (140, 15), (14, 30), (0, 30)], metal, segments=18),
        rod((0, 20, 0), (0, high - 60, 0), 12, metal),
        turned_body([*cone, (r, low)], shade, segments=20),
    ]


def picture(rng: Rng) -> list[Shape]:
    """A framed picture that hangs on a wall at z = 0, its middle at the origin."""
    width, height = rng.uniform(300, 1000), rng.uniform(300, 750)
    bar, deep = rng.uniform(15, 45), rng.uniform(15, 35)
    frame, image = draw_albedo(rng, "painted wood"), draw_albedo(rng, "picture")
    w, h = width / 2, height / 2
    inside = plate([(-w, -h, 8), (w, -h, 8), (w, h, 8), (-w, h, 8)], image)
    level = [box((width, bar, deep), (0, y, deep / 2), frame) for y in (-h, h - bar)]
    upright = [
        box((bar, height - 2 * bar, deep), (s * (w - bar / 2), -h + bar, deep / 2), frame)
        for s in (-1, 1)
    ]
    return [inside, *level, *upright]


def curtain(rng: Rng, width_mm: float, top_mm: float, bottom_mm: float) -> list[Shape]:
    """A curtain with folds in front of a wall at z = 0; x from -width / 2 to width / 2."""
    cloth = draw_albedo(rng, "cloth")
    folds = width_mm / rng.uniform(90, 150)  # chosen: a fold each 90 to 150 mm
    columns, rows = int(folds * 10) + 2, 6
    x = np.linspace(-0.5, 0.5, columns)
    y = np.linspace(top_mm, bottom_mm, rows)
    phase, second = rng.uniform(0, 2 * np.pi, 2)
    drop = np.linspace(0, 1, rows)[:, None]
    swing = 2 * np.pi * folds * x[None] + phase + 0.8 * drop * np.sin(9 * x[None] + second)
    depth = rng.uniform(22, 45) * (0.5 + 0.5 * drop)  # folds open towards the bottom
    points = np.empty((rows, columns, 3))
    points[..., 0] = width_mm * x[None] * (0.92 + 0.08 * drop) + 10 * np.sin(2 * swing)
    points[..., 1] = y[:, None]
    points[..., 2] = 90 + depth * np.sin(swing) + 8 * np.sin(0.37 * swing + second)
    return [sheet(points, cloth)]


def rail(width_mm: float, top_mm: float) -> list[Shape]:
    """A curtain rail."""
    return [rod((-width_mm / 2, top_mm + 15, 90), (width_mm / 2, top_mm + 15, 90), 13, 0.6)]


def clothes_hook(rng: Rng) -> list[Shape]:
    """A coat on a hook at a wall, z = 0; it hangs down from the origin."""
    cloth = draw_albedo(rng, "cloth")
    length, half = rng.uniform(650, 1000), rng.uniform(150, 210)
    v, u = np.linspace(0, 1, 12), np.linspace(-1, 1, 28)
    phase = rng.uniform(0, 2 * np.pi)
    width = half * (0.35 + 0.65 * np.minimum(1, 3.2 * v))[:, None]
    points = np.empty((12, 28, 3))
    points[..., 0] = width * u[None]
    points[..., 1] = -length * v[:, None] * (1 - 0.05 * np.cos(5 * u[None] + phase))
    body = 130 * np.sqrt(np.clip(1 - u**2, 0, 1))[None] * np.minimum(1, 2.5 * v + 0.25)[:, None]
    folds = 14 * np.minimum(1, 2 * v)[:, None] * np.sin(9 * u[None] + phase + 1.5 * v[:, None])
    points[..., 2] = 4 + body + folds * np.sqrt(np.clip(1 - u**2, 0, 1))[None]
    return [sheet(points, cloth, region="furniture"), rod((0, -8, 0), (0, 8, 60), 7, 0.5)]


def radiator(rng: Rng, width_mm: float) -> list[Shape]:
    """A radiator with upright ribs before a wall at z = 0, its lower edge at the origin."""
    height, paint = rng.uniform(450, 600), draw_albedo(rng, "painted wood")
    ribs = max(3, int(width_mm / 60))
    x = np.linspace(-width_mm / 2, width_mm / 2, 4 * ribs + 1)
    profile = 90 + np.tile([0.0, 0.0, 16.0, 16.0], ribs + 1)[: len(x)]
    points = np.empty((2, len(x), 3))
    points[..., 0], points[0, :, 1], points[1, :, 1] = x, height, 0
    points[..., 2] = profile
    back = box((width_mm, height, 50), (0, 0, 60), paint)
    return [sheet(points, paint, both=False), back]
