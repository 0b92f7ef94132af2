"""Hats and headphones, fitted to a subject's skull and ears."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from glsim.core.array_types import Floats, Reals
from glsim.core.products import units
from glsim.core.seeds import keyed_rng
from glsim.looks.anatomy import Anatomy, beside_line
from glsim.looks.locks import hull_mm
from glsim.looks.noise import smooth_noise, smooth_step
from glsim.looks.shapes import Shape, joined, tube
from glsim.looks.skin_grid import grid_triangles
from glsim.looks.styles import HairStyle

#: Columns around a hat and rows of its crown. Chosen.
_COLUMNS, _ROWS = 72, 22
#: Thickness of pressed hair below a hat and below the band of headphones, mm. Chosen.
UNDER_HAT_MM, UNDER_BAND_MM = 4.0, 12.0
#: Thickness of a brim and of a cuff, distance and height of the ribs of knitted wool, mm. Chosen.
_BRIM_MM, _CUFF_MM, _RIB_MM, _RIB_HIGH_MM = 2.5, 4.0, 7.0, 1.2
#: A cup round the ear: half the width and height, depth beyond the ear, mm; profile from the skin
#: outwards, rows of (share of the radius, share of the depth). Band: thickness and width, mm.
#: Chosen from those that shops sell: cups of 75 to 85 by 90 to 100 mm.
_CUP_MM, _BEYOND_MM, _BAND_MM = (39.0, 47.0), 16.0, (9.0, 30.0)
_CUP: Final = (
    (0.5, 0.0), (0.92, 0.0), (1.0, 0.2), (0.98, 0.42), (0.88, 0.5), (0.9, 0.56), (0.95, 0.6),
    (0.93, 0.8), (0.8, 0.93), (0.5, 1.0), (0.0, 1.02),
)  # fmt: skip


def pressed(style: HairStyle, most_mm: float) -> HairStyle:
    """Return a hair style below a hat or a band: flat, untied, without fringe or stray hairs."""
    most = {"top": most_mm, "side": most_mm, "back": most_mm, "relief": 0.3 * most_mm,
            "wave": 0.25 * most_mm, "flare": 0.004 * most_mm}  # fmt: skip
    flat = {name: min(getattr(style, name), value) for name, value in most.items()}
    return replace(style, **flat, fringe=0.0, stray=0.0, extra="")


def make_hat(
    anatomy: Anatomy, style: Mapping[str, Any], hair_mm: float, seed: int
) -> tuple[Shape, Floats]:
    """Fit a hat of a ``style`` of styles.toml over hair of ``hair_mm`` to a subject's head.

    Returns its mesh, and the ribs of knitted wool, as ``folds`` of ``Mesh``.
    """
    scale, centre, skin_mm = anatomy.scale, anatomy.centre, anatomy.vertices_mm
    front, side, back = style["rim"]
    brim_mm, all_round = style.get("brim", 0), style.get("all_round", False)
    lump_mm, cuff_mm = style.get("front", 0), style.get("cuff", 0)
    is_ear = anatomy.is_in("ear")
    if side > 0 and is_ear.any():  # the edge lies on the ears
        side = max(side, (float(skin_mm[is_ear, 1].max()) - anatomy.eye[1]) / scale + 3.0)

    def edge_mm(cosine: Reals) -> Reals:  # height over the centre of the skull
        ends = np.where(cosine > 0, front - side, back - side) * np.abs(cosine) ** 1.5
        return np.asarray(anatomy.eye[1] - centre[1] + scale * (side + ends))

    points = skin_mm[anatomy.outside & ~anatomy.body & (~is_ear | (side <= 0))] - centre
    level = np.maximum(np.hypot(points[:, 0], points[:, 2]), 1.0)
    points = points[points[:, 1] > edge_mm(points[:, 2] / level) - 6.0]
    turn = np.linspace(0, 2 * np.pi, _COLUMNS + 1)
    sine, cosine, share = np.sin(turn), np.cos(turn), np.linspace(0, 1, _ROWS)[:, None]
    low = np.arctan2(edge_mm(cosine), 92.0 * scale)
    up = low + share * (np.pi / 2 - low)
    ways = np.stack([np.cos(up) * sine, np.sin(up), np.cos(up) * cosine], axis=-1)
    ahead = np.maximum(np.sign(lump_mm) * cosine, 0.0) * np.sin(np.pi * share**0.8)
    gap = style["top"] * smooth_step(share, 0.0, 0.8) + abs(lump_mm) * ahead
    gap += _CUFF_MM * smooth_step(cuff_mm - 150.0 * share, 0.0, 8.0)
    crown = centre + (hull_mm(points, ways) + hair_mm + 2.0 + scale * gap)[..., None] * ways
    out, bent = ways[0] * (1, 0, 1), 6.0 * smooth_noise(1.3 * ways[0], seed)
    if not all_round:  # a peak is narrower than the head, and bent down at its sides
        peak = np.clip((cosine - 0.25) / 0.75, 0, 1) ** 0.45
        out = peak[:, None] * (out * (0.3, 1, 0.6) + (0, 0, 0.4))
        bent = 22.0 * ((crown[0, :, 0] - centre[0]) / (80.0 * scale)) ** 2 * peak
    out = scale * (brim_mm * out - np.outer(style.get("slope", 0) * brim_mm + bent, (0, 1, 0)))
    brim = [crown[0] + along * (brim_mm > 0) * out for along in (1.0, 0.66, 0.33, 0.0)]
    under = [row - (0, _BRIM_MM, 0) for row in brim[::-1]]
    inner = crown[0] - 7.0 * ways[0] + (0, 5, 0)
    grid = np.concatenate([np.stack([inner, *under, *brim]), crown[1:]])
    ribs = np.zeros((*grid.shape[:2], 8), np.float32)
    if cuff_mm:
        ribs[..., 4], ribs[..., 5] = turn * 95.0 / _RIB_MM, grid[..., 1] / 80.0
        ribs[..., 7] = _RIB_HIGH_MM
    faces = grid_triangles(len(grid), _COLUMNS + 1)[:, ::-1]
    return Shape(grid.reshape(-1, 3), faces), ribs.reshape(-1, 8)


def make_headphones(anatomy: Anatomy, hair_mm: float, seed: int) -> Shape:
    """Fit headphones over hair of ``hair_mm`` to a subject's head."""
    size = anatomy.scale * float(keyed_rng(seed, "headphones").uniform(0.93, 1.05))
    is_ear, skin_mm = anatomy.is_in("ear"), anatomy.vertices_mm.astype(np.float64)
    skin = skin_mm[anatomy.outside & ~anatomy.body & ~is_ear]
    turn, parts, ends = np.linspace(0, 2 * np.pi, 33), [], []
    circle = size * np.stack([0 * turn, _CUP_MM[1] * np.sin(turn), _CUP_MM[0] * np.cos(turn)], 1)
    for ear, side in zip(anatomy.ears, (1.0, -1.0), strict=True):
        out = np.array([side, 0.0, 0.0])
        base = beside_line(ear + circle, skin[side * (skin[:, 0] - ear[0]) > -60], out, 9.0)
        base = np.where(np.isfinite(base), base, base[np.isfinite(base)].min()) - 4.0
        pinna = side * skin_mm[is_ear & (side * skin_mm[:, 0] > 0), 0]
        far = max(pinna.max(initial=base.max() + 8.0), base.max() + 8.0) + _BEYOND_MM * size
        rows = [(0, 1, 1) * ear + wide * circle + np.outer(base + deep * (far - base), out)
                for wide, deep in _CUP]  # fmt: skip
        faces = grid_triangles(len(rows), 33)[:, :: int(side)]
        parts.append(Shape(np.concatenate(rows), faces))
        ends.append((0, 1, 1) * ear + (side * (far - 7.0 * size), 16.0 * size, 0.0))
    angle = np.linspace(0, np.pi, 33)[:, None]
    middle, half = 0.5 * (ends[0] + ends[1]), 0.5 * (ends[0] - ends[1])
    high = np.array([0.0, float(skin[:, 1].max()) - middle[1], 6.0])
    line = middle + np.cos(angle) * half + np.sin(angle) * high - anatomy.centre
    away, top = np.linalg.norm(line, axis=1), skin[:, 1] > anatomy.eye[1] + 20 * anatomy.scale
    least = hull_mm(skin[top] - anatomy.centre, units(line)) + hair_mm + 0.5 * _BAND_MM[0]
    line = anatomy.centre + line * np.maximum(least / away, 1.0)[:, None]
    return joined([*parts, tube(line, *_BAND_MM, closed=False)])
