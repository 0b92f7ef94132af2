"""Hair: a rough cap over the scalp, and several hundred locks that lie on it or hang from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glsim.core.array_types import Array, Floats, Reals, Triangles, Whole
from glsim.core.products import product
from glsim.core.seeds import keyed_rng
from glsim.looks.anatomy import Anatomy
from glsim.looks.binding import Rooted
from glsim.looks.locks import CROWN, Head, Obstacle, all_locks
from glsim.looks.noise import openings, ridges, smooth_noise
from glsim.looks.skin_grid import Anchors, make_grid
from glsim.looks.styles import HairStyle

#: Longest edge of the scalp's grid, mm. Most are 3 to 5 mm, 1.5 pixels of a Kinect V2 at 0.9 m.
_EDGE_MM = 7.5
#: Largest distance outside the mean hairline at which hair grows, mm.
_MARGIN_MM = 14.0
#: Frequency of the relief along strands relative to across them. The value was chosen.
_ALONG = 0.16
#: Radius of a mean skull, mm; it converts angles to lengths.
_SKULL_MM = 90.0
#: Wavelengths of the relief across strands, mm: ridges, fine relief, clumps. Chosen: locks of hair
#: are 5 to 15 mm wide.
_RIDGE_MM, _FINE_MM, _CLUMP_MM = 15.0, 8.0, 45.0
#: Mean distance that light travels into hair, mm. Derived: there are 2 hairs/mm2 of scalp (1.5 to
#: 2.3: Birnbaum, Skin Appendage Disord. 4, 304, 2018), 0.07 mm thick and 40 mm long (chosen). They
#: fill 1.5 % of 20 mm. Light at right angles meets one after pi * 0.07 mm / (4 * 0.015) = 3.6 mm.
_WAY_MM = 3.6
#: Number of these distances after which 1 / e of the light is left: hair scatters more light than
#: it absorbs, blond hair most. Chosen between dark and light hair.
_LOST = 3.0
#: Distance between gaps in the hair across strands, mm; largest depth of a gap, as share of the
#: hair's thickness. The values were chosen, not measured.
_OPENING_MM, _DEEPEST = 9.0, 0.75
#: Thickness of hair at its edge, mm, and distance from the edge to the full thickness, mm. Chosen.
_RIM_THICKNESS_MM, _RIM_MM = 1.2, 24.0


class Scalp(NamedTuple):
    """The grid of the scalp of a source, fine enough for the relief of hair.

    Args:
        anchors: N points on the triangles of the source.
        directions: (N, 3) unit vectors from the centre of the skull to the points.
        faces: (F, 3) triangles of the points.
        inside_mm: (N,) distance inside the hairline.
    """

    anchors: Anchors
    directions: Floats
    faces: Whole
    inside_mm: Floats


class Hair(NamedTuple):
    """The hair mesh of a subject, rooted on the scalp.

    ``light`` is (N,), the share of the light that returns from between the strands.
    """

    binding: Rooted
    faces: Triangles
    light: Array


def make_scalp(anatomy: Anatomy) -> Scalp:
    """Make the grid of the scalp on the reference head of a source."""
    near = anatomy.above_hairline_mm(anatomy.vertices_mm) > -_MARGIN_MM
    skin = anatomy.outside & ~anatomy.is_in("ear") & ~anatomy.body & near
    chosen = np.asarray(skin[anatomy.faces].all(axis=1))
    grid = make_grid(anatomy.faces, chosen, anatomy.vertices_mm, _EDGE_MM)
    anchors = Anchors(grid.base[grid.anchors.corners], grid.anchors.weights)
    points = anchors.place(anatomy.vertices_mm)
    out = points - anatomy.centre
    directions = (out / np.linalg.norm(out, axis=1, keepdims=True)).astype(np.float32)
    inside = anatomy.above_hairline_mm(points).astype(np.float32)
    return Scalp(anchors, directions, grid.faces, inside)


def make_hair(anatomy: Anatomy, scalp: Scalp, skin_mm: Floats, style: HairStyle, seed: int) -> Hair:
    """Make the hair mesh of a subject; ``skin_mm`` is the resting head, (V, 3)."""
    base = scalp.anchors.place(skin_mm)
    inside = _inside_mm(anatomy, scalp, style, base)
    thickness = _thickness_mm(anatomy, scalp, style, base, inside, seed)
    strands = _strand_coordinates(anatomy, style, base)
    relief = 0.65 * ridges(strands / _RIDGE_MM, seed)
    relief = relief + 0.35 * smooth_noise(strands / _FINE_MM, seed + 1)
    rough = np.minimum(style.relief, 0.8 * thickness)
    way = _WAY_MM * openings(strands / _OPENING_MM, seed + 7)
    way = np.minimum(way, _DEEPEST * thickness).astype(np.float64)
    height = np.maximum(thickness + rough * relief - way, 0.6)
    ragged = inside + 5.0 * smooth_noise(base / 9.0, seed + 2)
    ragged = ragged + 2.5 * smooth_noise(strands / 5.0, seed + 3)
    out = scalp.directions.copy()  # hair that points down stands out less
    out[:, 1] = np.where(out[:, 1] < 0, 0.35 * out[:, 1], out[:, 1])
    offsets = height[:, None] * (out / np.linalg.norm(out, axis=1, keepdims=True))
    rng, obstacle = keyed_rng(seed, 0x4A1), Obstacle(anatomy, skin_mm)
    head = Head(anatomy, obstacle, style, rng, scalp.directions, base, thickness, ragged)
    # Join cap and locks, without the vertices of the cap that no triangle uses.
    cap = scalp.faces[(ragged > 0)[scalp.faces].all(axis=1)]
    used, inverse = np.unique(cap, return_inverse=True)
    roots, shifts = [used], [offsets[used]]
    triangles, lights = [inverse.reshape(-1, 3)], [np.exp(-way / _WAY_MM / _LOST)[used]]
    for locks in all_locks(head):
        triangles.append(locks.faces + sum(map(len, roots)))
        roots.append(locks.roots)
        shifts.append(locks.points_mm - base[locks.roots])
        lights.append(np.ones(len(locks.roots)))
    used_roots, root_of = np.unique(np.concatenate(roots), return_inverse=True)
    return Hair(
        Rooted(scalp.anchors.taken(used_roots), root_of, np.concatenate(shifts)),
        np.ascontiguousarray(np.concatenate(triangles), np.int32),
        np.concatenate(lights),
    )


def _strand_coordinates(anatomy: Anatomy, style: HairStyle, points: Reals) -> Reals:
    """Compute coordinates (N, 3), mm, in a frame with one axis along the strands, two across."""
    out = points - anatomy.centre
    length = np.linalg.norm(out, axis=1)
    if style.comb == "curls":
        return np.asarray(out)
    if style.comb == "crown":
        angle = np.arctan2(product(out, np.cross(CROWN, [1.0, 0.0, 0.0])), out[:, 0])
        polar = np.arccos(np.clip(product(out, CROWN) / length, -1, 1)) * _SKULL_MM
        ring = np.maximum(np.sin(polar / _SKULL_MM), 0.25) * _SKULL_MM
        columns = (ring * np.cos(angle), ring * np.sin(angle), _ALONG * polar)
    elif style.comb == "back":
        angle = np.arctan2(out[:, 0], out[:, 1] + 40.0)
        columns = (angle * _SKULL_MM, _ALONG * out[:, 2], 0.0 * length)
    else:
        parting = style.parting * anatomy.scale
        angle = np.arctan2(out[:, 0] - parting, out[:, 1] + 40.0)
        columns = (out[:, 2], _ALONG * angle * _SKULL_MM, 60.0 * np.sign(angle))
    return np.stack(columns, axis=1)


def _inside_mm(anatomy: Anatomy, scalp: Scalp, style: HairStyle, base: Reals) -> Reals:
    """Compute distances inside a subject's hairline, (N,) mm; negative on ears, bald areas."""
    scale = anatomy.scale
    inside = scalp.inside_mm.astype(np.float64).copy()
    local = (base - anatomy.eye) / scale
    front = np.clip((local[:, 2] + 110) / 60, 0, 1) * np.clip((local[:, 1] - 20) / 30, 0, 1)
    corners = np.exp(-(((np.abs(local[:, 0]) - 34) / 17) ** 2))
    inside -= style.recede * front * (14 + 26 * corners) * scale
    if style.bald:
        crown = np.array([0.0, 95.0, -120.0])
        inside = np.minimum(inside, np.linalg.norm(local - crown, axis=1) * scale - style.bald)
    for ear in anatomy.ears:
        beside = (base - ear)[:, 1:] / (34 * scale, 22 * scale)
        same = np.sign(local[:, 0]) == np.sign(ear[0] - anatomy.eye[0])
        radius = np.hypot(beside[:, 0], beside[:, 1])
        inside = np.where(same, np.minimum(inside, 24 * scale * (radius - 1)), inside)
    return np.asarray(inside)


def _thickness_mm(
    anatomy: Anatomy, scalp: Scalp, style: HairStyle, base: Reals, inside: Reals, seed: int
) -> Reals:
    """Compute the thickness of the hair, (N,) mm, without relief of strands; thin at the edge."""
    to_top = np.clip((scalp.directions[:, 1].astype(np.float64) - 0.1) / 0.6, 0, 1)
    to_top *= to_top * (3 - 2 * to_top)
    low = style.side + (style.back - style.side) * np.clip(-scalp.directions[:, 2], 0, 1)
    full = low + (style.top - low) * to_top
    if style.comb == "back" and not style.extra:  # a quiff is highest over the forehead
        full *= 1 + 0.25 * to_top * np.clip(scalp.directions[:, 2] * 1.5, 0, 1)
    rim = np.clip(inside / max(_RIM_MM, 0.7 * style.top), 0, 1)
    first = np.minimum(_RIM_THICKNESS_MM / full, 0.4)
    rim = first + (1 - first) * np.sqrt(rim)
    clumps = 1 + 0.16 * smooth_noise(base / _CLUMP_MM, seed + 4)
    return np.asarray(full * rim * clumps * anatomy.scale)
