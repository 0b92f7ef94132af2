"""Make furniture from the table furniture.toml, and curtains and coats with folds.

A piece of furniture stands on y = 0 at the origin and faces +z. Its size, its materials and the
small objects on it are sampled.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from glsim.looks.shapes import (
    Points,
    Shape,
    bounds_mm,
    box,
    joined,
    mirrored,
    moved,
    rod,
    sheet,
    turned_body,
)

Rng = np.random.Generator
Part = Mapping[str, Any]

#: Distance from the centre of a chair to the front of its backrest, mm.
BACKREST_MM = 205.0
#: Materials that have a region in the layer "regions" -> the region's name.
_REGIONS = {"screen": "screen", "leaves": "plant", "glass": "window"}
#: Number of straight segments of a hanging cable.
_PIECES = 6
#: Height of the earth in a flower pot, mm. The value was chosen.
_EARTH_MM = 245.0


@lru_cache(maxsize=1)
def catalogue() -> Mapping[str, Any]:
    """Read furniture.toml: furniture by name, its shares by kind of room, and material albedos."""
    return tomllib.loads(files("glsim.looks.room").joinpath("furniture.toml").read_text("utf-8"))


def sample_albedo(rng: Rng, material: str) -> float:
    """Sample the albedo of a material at 860 nm, relative to a white wall."""
    return float(rng.uniform(*catalogue()["albedos"][material]))


def choose(rng: Rng, shares: Mapping[str, float]) -> str:
    """Sample a name with a probability in proportion to its share."""
    weights = np.array(list(shares.values()))
    return list(shares)[int(rng.choice(len(weights), p=weights / weights.sum()))]


def make_thing(
    rng: Rng, name: str, clutter: float = 0.6, fit_mm: Sequence[float | None] = ()
) -> list[Shape]:
    """Make the shapes of a piece of furniture; ``clutter``: share of small objects, 0 to 1.

    ``fit_mm``: width and height of the opening that it fills, or height of its seat; or sampled.
    """
    thing = catalogue()["things"][name]
    scale = 1 + rng.uniform(-1, 1, 3) * thing.get("stretch", (0.0, 0.0, 0.0))
    for axis, wanted in enumerate(fit_mm):
        if wanted is not None:
            scale[axis] = wanted / thing["fits"][axis]
    shapes = _parts(rng, name, scale, clutter, {})
    region = thing.get("region", "furniture")
    return [s if s.region != "furniture" else replace(s, region=region) for s in shapes]


def _parts(
    rng: Rng, name: str, scale: Points, clutter: float, albedos: dict[str, float]
) -> list[Shape]:
    """Build the shapes of a piece of furniture; ``scale``: (3,) factors of its size.

    ``clutter``: share of possible small objects, 0 to 1. ``albedos``: of materials; grows.
    """
    shapes: list[Shape] = []
    for number, part in enumerate(catalogue()["things"][name]["parts"]):
        if "share" in part and rng.random() > part["share"]:
            continue
        copies: list[Shape]
        if "thing" in part:
            copies = _parts(rng, part["thing"], scale, clutter, albedos)
        elif "things" in part:
            width, depth = part["things"] * scale[[0, 2]]
            copies = _small_things(rng, round(part["count"] * clutter), width, depth)
        elif "books" in part:
            filled = rng.random() < 0.25 + 0.75 * clutter
            copies = _books(rng, *(part["books"] * scale)) if filled else []
        else:
            if "cable" in part:
                solid = _cable(rng, *part["cable"])
            else:
                solid = _leaves(rng, part) if "leaves" in part else _solid(name, number)
            material = part.get("of", "black plastic")
            if material not in albedos:
                kind = str(rng.choice(material.split(":")[0].split("/")))
                albedos[material] = sample_albedo(rng, kind)
            region = _REGIONS.get(material, "furniture")
            shapes.append(Shape(solid.vertices_mm * scale, solid.faces, albedos[material], region))
            continue
        x, y, z = part.get("at", (0.0, 0.0, 0.0)) * scale
        count, *step = part.get("repeat", (1, 0, 0, 0))
        dx, dy, dz = np.multiply(step, scale)
        for n in range(count):
            if n and "thing" in part:
                copies = _parts(rng, part["thing"], scale, clutter, albedos)
            position = x + n * dx, y + n * dy, z + n * dz
            shapes += moved(copies, *position, turn_deg=part.get("turn", 0.0))
    return shapes


@lru_cache(maxsize=256)
def _solid(name: str, number: int) -> Shape:
    """Make a part of fixed dimensions, with mirror images and copies, before scaling."""
    part = catalogue()["things"][name]["parts"][number]
    if "box" in part:
        edge_mm, plump_mm = part.get("edge", 0.0), part.get("plump", 0.0)
        shape = box(part["box"], edge_mm=edge_mm, cells=part.get("cells", 3), plump_mm=plump_mm)
    elif "rod" in part:
        first, last = np.broadcast_to(part["r"], 2)
        start, end = part["rod"]
        shape = rod(start, end, float(first), end_radius_mm=last, sides=part.get("sides", 8))
    else:
        shape = turned_body(part["turned"], segments=part.get("segments", 12))
    shapes = [shape.leaned(part.get("lean", 0.0)).moved(*part.get("at", ()))]
    for axis in part.get("mirror", ""):
        shapes += [mirrored(shape, "xyz".index(axis)) for shape in shapes]
    count, *step = part.get("repeat", (1, 0, 0, 0))
    shapes = [s.moved(*np.multiply(n, step)) for n in range(count) for s in shapes]
    turns = 360 * np.arange(part.get("around", 1)) / part.get("around", 1)
    return joined([s.moved(turn_deg=turn) for turn in turns for s in shapes])


def _small_things(rng: Rng, count: int, width_mm: float, depth_mm: float) -> list[Shape]:
    """Place small objects on a board without overlap; leave out those that do not fit."""
    small = {n: t["small"] for n, t in catalogue()["things"].items() if "small" in t}
    taken: list[tuple[Points, Points]] = []
    shapes: list[Shape] = []
    for _ in range(count):
        thing = make_thing(rng, choose(rng, small))
        x, z = rng.uniform(-0.5, 0.5) * width_mm, rng.uniform(-0.5, 0.5) * depth_mm
        thing = moved(thing, x, z=z, turn_deg=rng.uniform(-40, 40))
        low, high = (corner[[0, 2]] for corner in bounds_mm(thing))
        inside = (np.maximum(-low, high) < (width_mm / 2, depth_mm / 2)).all()
        if inside and not any((low < b).all() and (a < high).all() for a, b in taken):
            taken.append((low, high))
            shapes += thing
    return shapes


def _books(rng: Rng, width: float, height: float, depth: float) -> list[Shape]:
    """Fill a shelf board with rows of books and gaps, 15 to 60 mm behind its front edge."""
    shapes = []
    x, right = -width / 2 + 4, width / 2 - 4
    while x < right - 60:
        for _ in range(int(rng.integers(3, 10)) if rng.random() < 0.75 else 0):
            thick, high = rng.uniform(14, 48), min(height - 15, rng.uniform(170, 310))
            deep = min(depth - 20, rng.uniform(130, 240))
            if x + thick > right:
                break
            z = depth / 2 - rng.uniform(15, 60) - deep / 2
            albedo = sample_albedo(rng, "paper")
            shapes.append(box((thick, high, deep), (x + thick / 2, 0, z), albedo))
            x += thick + 0.5
        x += rng.uniform(20, 160)
    return shapes


def _cable(rng: Rng, start_mm: ArrayLike, end_mm: ArrayLike) -> Shape:
    """Make a cable 4 to 8 mm thick between two points, which sags 20 to 160 mm."""
    start, end = np.asarray(start_mm, np.float64), np.asarray(end_mm, np.float64)
    slack, radius = rng.uniform(20, 160), float(rng.uniform(2, 4))
    along = np.linspace(0, 1, _PIECES + 1)[:, None]
    points = start + along * (end - start)
    points[:, 1] -= 4 * slack * (along * (1 - along))[:, 0]
    points[:, 1] = np.maximum(points[:, 1], radius)  # not below the floor
    return joined([rod(a, b, radius, sides=4) for a, b in pairwise(points)])


def _leaves(rng: Rng, part: Part) -> Shape:
    """Make leaves of 6 x 3 vertices along the stems of a plant; stems rise, then bend down."""
    count, root = int(part["leaves"]), np.array([0.0, _EARTH_MM, 0.0])
    least, most = part["rise"]
    turn, rise = rng.uniform(0, 2 * np.pi, count), rng.uniform(least, most, count)
    size, along = rng.uniform(0.75, 1.25, count), np.linspace(0, 1, 6)
    start = np.tile(root, (count, 1))
    if part["stems"]:
        tips = np.asarray(part["stems"], np.float64)
        place = np.sqrt(rng.uniform(0.12, 1.0, count))[:, None]
        start += place * (tips[np.arange(count) % len(tips)] - root)
    angle = rise[:, None] - 1.5 * along[:-1]  # chosen: a leaf hangs down at its tip
    steps = np.stack([np.cos(angle), np.sin(angle)]) * part["length"] / 5 * size[:, None]
    out, up = np.concatenate([np.zeros((2, count, 1)), np.cumsum(steps, axis=2)], axis=2)[..., None]
    half = (part["width"] / 2 * np.sin(np.pi * (0.08 + 0.86 * along)) ** 0.7)[:, None]
    across = half * np.array([-1.0, 0.0, 1.0])
    sine, cosine = np.sin(turn)[:, None, None], np.cos(turn)[:, None, None]
    x, z = out * sine + across * cosine, out * cosine - across * sine
    points = np.stack([x, up + 0.25 * np.abs(across), z], axis=3) + start[:, None, None]
    stems = [rod(root, tip, 7, end_radius_mm=3, sides=5) for tip in part["stems"]]
    return joined([*(sheet(leaf) for leaf in points), *stems])


def curtain(rng: Rng, width_mm: float, top_mm: float, bottom_mm: float) -> list[Shape]:
    """Make a folded curtain, centred on x = 0, in front of a wall at z = 0."""
    folds = width_mm / rng.uniform(90, 150)  # chosen: one fold per 90 to 150 mm
    x, drop = np.linspace(-0.5, 0.5, int(folds * 10) + 2)[None], np.linspace(0, 1, 6)[:, None]
    phase, second = rng.uniform(0, 2 * np.pi, 2)
    swing = 2 * np.pi * folds * x + phase + 0.8 * drop * np.sin(9 * x + second)
    depth = rng.uniform(22, 45) * (0.5 + 0.5 * drop)  # folds open towards the bottom
    across = width_mm * x * (0.92 + 0.08 * drop) + 10 * np.sin(2 * swing)
    down = top_mm + (bottom_mm - top_mm) * drop
    away = 90 + depth * np.sin(swing) + 8 * np.sin(0.37 * swing + second)
    points = np.stack(np.broadcast_arrays(across, down, away), axis=2)
    return [replace(sheet(points), albedo=sample_albedo(rng, "cloth"))]


def coat(rng: Rng) -> list[Shape]:
    """Make a coat that hangs from a hook at the origin, on a wall at z = 0."""
    length, half = rng.uniform(650, 1000), rng.uniform(150, 210)
    v, u = np.linspace(0, 1, 12)[:, None], np.linspace(-1, 1, 28)[None]
    phase, ends = rng.uniform(0, 2 * np.pi), np.sqrt(np.clip(1 - u**2, 0, 1))
    across = half * (0.35 + 0.65 * np.minimum(1, 3.2 * v)) * u
    down = -length * v * (1 - 0.05 * np.cos(5 * u + phase))
    folds = 14 * np.minimum(1, 2 * v) * np.sin(9 * u + phase + 1.5 * v)
    away = 4 + ends * (130 * np.minimum(1, 2.5 * v + 0.25) + folds)
    cloth = sheet(np.stack(np.broadcast_arrays(across, down, away), axis=2))
    return [replace(cloth, albedo=sample_albedo(rng, "cloth")), rod((0, -8, 0), (0, 8, 60), 7, 0.5)]


def make_seat(rng: Rng, kind: str, seat: Sequence[float]) -> list[Shape]:
    """Make a chair of a kind of room; ``seat`` is its height and the backrest's z, mm."""
    height_mm, back_z = seat
    name = choose(rng, catalogue()["rooms"][kind]["seats"])
    return moved(make_thing(rng, name, fit_mm=(None, height_mm)), z=back_z + BACKREST_MM - 15.0)
