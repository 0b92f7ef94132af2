"""Hair: a rough cap over the scalp and several hundred locks that lie on it or hang from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.core.seeds import keyed_rng
from glsim.looks.anatomy import Anatomy, Array
from glsim.looks.binding import Rooted
from glsim.looks.comb import Comb
from glsim.looks.curtain import hanging_hair
from glsim.looks.locks import Locks, Obstacle, grow_locks
from glsim.looks.noise import openings, ridges, smooth_noise
from glsim.looks.scalp import Scalp
from glsim.looks.styles import HairStyle
from glsim.looks.tied import tied_locks

#: Wavelengths of the relief across strands: locks of hair are 5 to 15 mm wide; chosen.
_RIDGE_MM, _FINE_MM, _CLUMP_MM = 15.0, 8.0, 45.0
#: Mean way of light into hair, mm. 2 hairs/mm2 of scalp (1.5 to 2.3: Birnbaum, Skin Appendage
#: Disord. 4, 304, 2018), 0.07 mm thick and 40 mm long (chosen), fill 1.5 % of 20 mm; light that
#: crosses them at right angles meets one after pi * 0.07 mm / (4 * 0.015) = 3.6 mm (derived).
_WAY_MM = 3.6
#: Ways after which 1 / e of the light is left: hair scatters more of it than it absorbs, less the
#: more melanin; chosen between dark and light hair.
_LOST = 3.0
#: Distance between openings across strands, mm, and the share of the thickness that one can see in.
_OPENING_MM, _DEEPEST = 9.0, 0.75
#: Hair begins with this thickness at its rim, mm, and is full after _RIM_MM.
_RIM_THICKNESS_MM, _RIM_MM = 1.2, 24.0


@dataclass(frozen=True, eq=False)
class Hair:
    """The mesh of a subject's hair.

    Args:
        faces: (F, 3) int32.
        light: (N,) share of the light that comes back from its depth.
    """

    binding: Rooted
    faces: NDArray[np.int32]
    light: NDArray[np.float64]


def make_hair(
    anatomy: Anatomy, scalp: Scalp, skin_mm: NDArray[np.float32], style: HairStyle, seed: int
) -> Hair:
    """Make the hair of a subject.

    Args:
        skin_mm: (V, 3) the subject's reference head.
        seed: of everything that is random.
    """
    rng = keyed_rng(seed, 0x4A1)
    base = scalp.anchors.place(skin_mm)
    comb = Comb(style.comb, anatomy, style.parting)
    thickness = thickness_mm(anatomy, scalp, style, base, seed)
    strands = comb.strand_coordinates(base)
    relief = 0.65 * ridges(strands / _RIDGE_MM, seed) + 0.35 * smooth_noise(
        strands / _FINE_MM, seed + 1
    )
    rough = np.minimum(style.relief, 0.8 * thickness)
    way = np.minimum(
        _WAY_MM * openings(strands / _OPENING_MM, seed + 7), _DEEPEST * thickness
    ).astype(np.float64)
    height = np.maximum(thickness + rough * relief - way, 0.6)
    inside = bare_line_mm(anatomy, scalp, style, base)
    ragged = (
        inside
        + 5.0 * smooth_noise(base / 9.0, seed + 2)
        + 2.5 * smooth_noise(strands / 5.0, seed + 3)
    )
    faces = scalp.faces[(ragged > 0)[scalp.faces].all(axis=1)]
    out = outward(scalp.directions)
    offsets = height[:, None] * out
    obstacle = Obstacle(anatomy, skin_mm)
    parts = [grow_locks(anatomy, base, thickness, ragged, comb, obstacle, style, rng)]
    if style.hang:
        parts.append(hanging_hair(anatomy, scalp, base, thickness, obstacle, style, rng))
    parts += tied_locks(anatomy, base, style, rng)
    light = np.exp(-way / _WAY_MM / _LOST)
    return _joined(scalp, base, offsets, faces, light, [part for part in parts if len(part.faces)])


def outward(directions: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (N, 3) the way hair stands: away from the middle, level below the middle."""
    out = directions.copy()
    out[:, 1] = np.where(out[:, 1] < 0, 0.35 * out[:, 1], out[:, 1])
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def bare_line_mm(anatomy: Anatomy, scalp: Scalp, style: HairStyle, base: Array) -> Array:
    """Return (N,) mm inside the subject's own hairline, ears and bald places left out."""
    scale = anatomy.scale
    inside = scalp.inside_mm.astype(np.float64).copy()
    local = (base - anatomy.eye) / scale
    side = np.abs(local[:, 0])
    front = np.clip((local[:, 2] + 110) / 60, 0, 1) * np.clip((local[:, 1] - 20) / 30, 0, 1)
    corners = np.exp(-(((side - 34) / 17) ** 2))
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


def thickness_mm(anatomy: Anatomy, scalp: Scalp, style: HairStyle, base: Array, seed: int) -> Array:
    """Return (N,) mm of hair over the skull, thin at the rim, without the relief of strands."""
    up = scalp.directions[:, 1].astype(np.float64)
    to_top = np.clip((up - 0.1) / 0.6, 0, 1)
    to_top *= to_top * (3 - 2 * to_top)
    to_back = np.clip(-scalp.directions[:, 2], 0, 1)
    low = style.side + (style.back - style.side) * to_back
    full = low + (style.top - low) * to_top
    if style.comb == "back" and not style.extra:  # a quiff is highest over the forehead
        full *= 1 + 0.25 * to_top * np.clip(scalp.directions[:, 2] * 1.5, 0, 1)
    inside = bare_line_mm(anatomy, scalp, style, base)
    rim = np.clip(inside / max(_RIM_MM, 0.7 * style.top), 0, 1)
    first = np.minimum(_RIM_THICKNESS_MM / full, 0.4)
    rim = first + (1 - first) * np.sqrt(rim)
    clumps = 1 + 0.16 * smooth_noise(base / _CLUMP_MM, seed + 4)
    return np.asarray(full * rim * clumps * anatomy.scale)


def _joined(
    scalp: Scalp,
    base: Array,
    offsets: Array,
    faces: NDArray[np.int64],
    light: Array,
    parts: list[Locks],
) -> Hair:
    """Join cap and locks, without the vertices of the cap that no triangle uses."""
    used, inverse = np.unique(faces, return_inverse=True)
    roots, shifts = [used], [offsets[used]]
    triangles, lights = [inverse.reshape(-1, 3)], [light[used]]
    count = len(used)
    for part in parts:
        roots.append(part.roots)
        shifts.append(part.points_mm - base[part.roots])
        triangles.append(part.faces + count)
        lights.append(np.ones(len(part.roots)))
        count += len(part.roots)
    own, root_of = np.unique(np.concatenate(roots), return_inverse=True)
    return Hair(
        Rooted(scalp.anchors.taken(own), root_of, np.concatenate(shifts)),
        np.ascontiguousarray(np.concatenate(triangles), np.int32),
        np.concatenate(lights),
    )
