"""Shelves with books, cabinets and sideboards; they stand on the floor, back at z = -depth / 2."""

from __future__ import annotations

import numpy as np

from glsim.scene.materials import draw_albedo
from glsim.scene.shapes import Shape, box, moved, rod, turned_body
from glsim.scene.tables import book_pile, small_thing, television

Rng = np.random.Generator


def shelf(rng: Rng, clutter: float) -> list[Shape]:
    """An open shelf; on its boards books of varied height and depth, boxes and small things."""
    wood = draw_albedo(rng, "wood" if rng.random() < 0.6 else "painted wood")
    width, depth = rng.uniform(600, 1000), rng.uniform(250, 380)  # chosen: common shelves
    height, board = rng.uniform(1400, 2100), rng.uniform(16, 24)
    rows = round(height / rng.uniform(320, 400))
    shapes = [box((board, height, depth), (s * (width - board) / 2, 0, 0), wood) for s in (-1, 1)]
    inner, pitch = width - 2 * board, (height - board) / rows
    if rng.random() < 0.7:
        shapes.append(box((inner, height, 6), (0, 0, -depth / 2 + 3), wood))
    for row in range(rows + 1):
        y = row * pitch if row else 0.0
        shapes.append(box((inner, board, depth - 8), (0, y, 0), wood))
        if row < rows and rng.random() < 0.25 + 0.75 * clutter:
            things = _board(rng, inner, depth, pitch - board - 15)
            shapes += moved(things, y=y + board)
    return shapes


def _board(rng: Rng, width: float, depth: float, height: float) -> list[Shape]:
    """What stands on one board of a shelf, from its left to its right."""
    shapes: list[Shape] = []
    x, front = -width / 2 + 4, depth / 2
    while x < width / 2 - 60:
        draw = rng.random()
        if draw < 0.72:  # a run of books, some leaning, their backs uneven by 5 to 40 mm
            for _ in range(int(rng.integers(3, 10))):
                thick, high = rng.uniform(14, 48), min(height, rng.uniform(170, 310))
                deep = min(depth - 20, rng.uniform(130, 240))
                if x + thick > width / 2 - 4:
                    break
                z = front - rng.uniform(15, 60) - deep / 2
                albedo = draw_albedo(rng, "paper")
                shapes.append(box((thick, high, deep), (x + thick / 2, 0, z), albedo))
                x += thick + 0.5
            x += rng.uniform(0, 60)
        elif draw < 0.86:
            pile = book_pile(rng, 2) if rng.random() < 0.4 else small_thing(rng)
            points = np.concatenate([s.vertices_mm for s in pile])
            wide, high, deep = points.max(axis=0) - points.min(axis=0)
            if x + wide < width / 2 and high < height and deep < depth:
                middle = (points.max(axis=0) + points.min(axis=0)) / 2
                shapes += moved(pile, x + wide / 2 - middle[0], z=-middle[2])
            x += wide + 20
        else:
            x += rng.uniform(60, 220)  # an empty place
    return shapes


def cabinet(rng: Rng) -> list[Shape]:
    """A cabinet or a wardrobe with doors or drawers and their handles."""
    wood = draw_albedo(rng, "wood" if rng.random() < 0.5 else "painted wood")
    tall = rng.random() < 0.5
    width = rng.uniform(700, 1100)
    depth = rng.uniform(400, 600)
    height = rng.uniform(1700, 2100) if tall else rng.uniform(700, 1100)
    shapes = [box((width, height - 60, depth), (0, 60, 0), wood, edge_mm=4)]
    shapes.append(box((width - 60, 60, depth - 60), (0, 0, -20), wood * 0.9))
    columns, rows = (2, 1) if tall or rng.random() < 0.5 else (1 + (width > 900), 3)
    metal, front = draw_albedo(rng, "metal"), depth / 2
    w, h = (width - 8) / columns, (height - 68) / rows
    for column in range(columns):
        for row in range(rows):
            x, y = -width / 2 + 4 + (column + 0.5) * w, 64 + row * h
            shapes.append(box((w - 6, h - 6, 18), (x, y + 3, front + 9), wood, edge_mm=4))
            if rows > 1:
                bar = (x - 60, y + 0.6 * h, front + 35), (x + 60, y + 0.6 * h, front + 35)
            else:
                at = x + (w / 2 - 45) * (1 if column == 0 else -1)
                bar = (at, y + 0.45 * h, front + 35), (at, y + 0.45 * h + 150, front + 35)
            shapes.append(rod(*bar, 6, metal, sides=6))
    return shapes


def sideboard(rng: Rng, clutter: float, *, with_television: bool = False) -> list[Shape]:
    """A low cabinet; on it a television or things."""
    wood = draw_albedo(rng, "wood")
    width, depth = rng.uniform(1300, 1700), rng.uniform(380, 460)
    height, doors = rng.uniform(450, 750), int(rng.integers(2, 5))
    shapes = [box((width, height - 120, depth), (0, 120, 0), wood, edge_mm=5)]
    for sx in (-1, 1):
        for sz in (-1, 1):
            x, z = sx * (width / 2 - 80), sz * (depth / 2 - 50)
            shapes.append(rod((x, 4, z), (0.97 * x, 122, 0.95 * z), 16, wood, end_radius_mm=24))
    w = width / doors
    for n in range(doors):
        x = -width / 2 + (n + 0.5) * w
        panel = box((w - 8, height - 134, 18), (x, 127, depth / 2 + 9), wood, edge_mm=4)
        shapes.append(panel)
    if with_television:
        return shapes + moved(television(rng), y=height)
    x = -width / 2 + 120
    while x < width / 2 - 150:
        if rng.random() < clutter:
            shapes += moved(small_thing(rng), x, height, rng.uniform(-60, 40))
        x += rng.uniform(260, 420)
    return shapes


def waste_bin(rng: Rng) -> list[Shape]:
    """An open waste-paper basket."""
    r, high = rng.uniform(110, 150), rng.uniform(260, 360)
    profile = [(0, 0), (0.8 * r, 0), (r, high), (r - 4, high), (0.8 * r - 4, 8), (0, 8)]
    return [turned_body(profile, draw_albedo(rng, "black plastic"), segments=16)]


def moving_box(rng: Rng) -> list[Shape]:
    """A cardboard box on the floor, sometimes with another on it."""
    shapes, y = [], 0.0
    for _ in range(int(rng.integers(1, 3))):
        size = rng.uniform(300, 550), rng.uniform(200, 380), rng.uniform(280, 400)
        cardboard = box(size, (0, y, 0), draw_albedo(rng, "paper"), edge_mm=3)
        shapes.append(cardboard.moved(turn_deg=rng.uniform(-12, 12)))
        y += size[1]
    return shapes
