"""Hair: sheets of strands over the scalp, one above the other, and hair that hangs or is tied."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from glsim.core.array_types import Floats, Reals, Whole
from glsim.core.products import product, units
from glsim.core.seeds import keyed_rng
from glsim.looks.anatomy import Anatomy
from glsim.looks.binding import Hair, Rooted
from glsim.looks.locks import LOST_MM, Head, Obstacle, Sheet, combed, hanging, strands_of, tied
from glsim.looks.noise import smooth_noise, smooth_step
from glsim.looks.skin_grid import Anchors, thinned
from glsim.looks.styles import CROWN, HALO_MM, HairStyle

#: Mean edge of the scalp's triangles, mm. Chosen: locks are 5 to 15 mm wide; strands are finer.
_EDGE_MM = 11.0
#: Largest distance outside the mean hairline at which hair grows, mm.
_MARGIN_MM = 14.0
#: Radius of a mean skull, mm; it converts angles to lengths.
_SKULL_MM = 90.0
#: Depth of each sheet below the top of the hair: as a share of the thickness, and at most, mm; and
#: the share of it that strands cover. Light meets a strand after some millimetres, however thick
#: the hair is. Chosen so that hair is as rough as on real heads. The first is the halo of stray
#: hairs, which casts no shadow.
_SHEETS: Final = ((-1e3, HALO_MM, 1.0), (0.0, 0.0, 0.32), (0.5, 10.0, 0.55), (0.92, 23.0, 2.5))
#: Distance inside the edge of the hair at which it is as dense as elsewhere, mm; thickness of the
#: hair at its edge, mm, and distance from the edge to the full thickness, mm. Chosen.
_SPARSE_MM, _RIM_THICKNESS_MM, _RIM_MM = 14.0, 1.2, 24.0
#: Wavelengths of the relief across strands and of clumps, mm. Chosen: locks are 5 to 15 mm wide.
_RELIEF_MM, _CLUMP_MM = 15.0, 45.0
#: Frequency of locks along strands relative to across them. The value was chosen.
_ALONG = 0.3
#: Largest way by which the tips lie beside the roots, mm: further on, sheets would be torn.
_LEAN_MM = 22.0


class Scalp(NamedTuple):
    """Grid of N points on the scalp, with triangles and distances inside the hairline, mm.

    ``directions``: (N, 3) unit vectors from the centre of the skull to the points.
    """

    anchors: Anchors
    directions: Floats
    faces: Whole
    inside_mm: Floats


def make_scalp(anatomy: Anatomy) -> Scalp:
    """Make the grid of the scalp on the reference head of a source."""
    near = anatomy.above_hairline_mm(anatomy.vertices_mm) > -_MARGIN_MM
    skin = anatomy.outside & ~anatomy.is_in("ear") & ~anatomy.body & near
    chosen = np.asarray(skin[anatomy.faces].all(axis=1))
    grid = thinned(anatomy.faces, chosen, anatomy.vertices_mm, _EDGE_MM)
    anchors = Anchors(grid.base[grid.anchors.corners], grid.anchors.weights)
    points = anchors.place(anatomy.vertices_mm)
    out = points - anatomy.centre
    inside = anatomy.above_hairline_mm(points).astype(np.float32)
    return Scalp(anchors, units(out).astype(np.float32), grid.faces, inside)


def make_hair(anatomy: Anatomy, scalp: Scalp, skin_mm: Floats, style: HairStyle, seed: int) -> Hair:
    """Make the hair mesh of a subject; ``skin_mm`` is the resting head, (V, 3)."""
    base = scalp.anchors.place(skin_mm)
    inside = _inside_mm(anatomy, scalp, style, base)
    thickness = _thickness_mm(anatomy, scalp, style, base, inside, seed)
    ragged = inside + 5.0 * smooth_noise(base / 9.0, seed + 2)
    rng, obstacle = keyed_rng(seed, 0x4A1), Obstacle(anatomy, skin_mm)
    head = Head(anatomy, obstacle, style, rng, scalp.directions, base, thickness, ragged, seed)
    sheets = [*_cap(head, scalp), *hanging(head), *tied(head)]
    starts = np.cumsum([0] + [len(sheet.roots) for sheet in sheets])
    used, root_of = np.unique(np.concatenate([s.roots for s in sheets]), return_inverse=True)
    offsets = np.concatenate([s.points_mm - base[s.roots] for s in sheets])
    faces = [sheet.faces + start for sheet, start in zip(sheets, starts, strict=False)]
    shading = [f for f, sheet in zip(faces, sheets, strict=True) if sheet.strands[0, 4] >= 0]
    # Beyond the horizon of a head the backs of its far sheets are seen; they cast no shadow here.
    faces += [f[:, ::-1] for f in shading]
    return Hair(
        Rooted(scalp.anchors.taken(used), root_of, offsets),
        np.ascontiguousarray(np.concatenate(faces), np.int32),
        np.ascontiguousarray(np.concatenate(shading), np.int32),
        np.concatenate([sheet.strands for sheet in sheets]).astype(np.float32),
        np.concatenate([sheet.light for sheet in sheets]),
    )


def _cap(head: Head, scalp: Scalp) -> list[Sheet]:
    """Make the sheets that lie on the head, the outermost first."""
    style, thickness, base = head.style, head.thickness, head.base
    faces = scalp.faces[(head.ragged > 0)[scalp.faces].all(axis=1)]
    used, inverse = np.unique(faces, return_inverse=True)
    faces, base = inverse.reshape(-1, 3), base[used]
    thickness, ragged = thickness[used], head.ragged[used]
    places = _strand_coordinates(head.anatomy, style, base)
    locks = smooth_noise(places * (1, 1, _ALONG) / _RELIEF_MM, head.seed)
    relief = np.minimum(1.5 * style.relief, 0.4 * thickness) * locks
    dense = style.density * np.clip(ragged / _SPARSE_MM, 0.05, 1.0)
    top = thickness + relief
    deep = [np.clip(share * thickness, -most, most) for share, most, _ in _SHEETS]
    out = head.directions[used].astype(np.float64)
    out[:, 1] = np.where(out[:, 1] < 0, 0.35 * out[:, 1], out[:, 1])  # it stands out less
    out, sheets = units(out), []
    stray = style.stray * np.clip(thickness / 10.0, 0, 1)  # stubble does not stray
    for here, below, (_, _, cover) in zip(deep, [*deep[1:], top], _SHEETS, strict=True):
        height = np.maximum(top - here, 0.3)
        points, sink = _leaning(head, used, height / thickness), below - here
        if here is deep[0]:
            points, height, sink, cover = base, thickness - here, here, stray
        points = points + height[:, None] * out
        strands = strands_of(style, places, cover * dense, sink, head.seed)
        light = np.exp(-np.maximum(here, 0.0) / LOST_MM)
        sheets.append(Sheet(used, points, faces, strands, light))
    return sheets


def _leaning(head: Head, used: Whole, share: Reals) -> Reals:
    """Move points of the scalp as far as strands lean at a share of their length, (N,)."""
    base, style, scale = head.base[used], head.style, head.anatomy.scale
    x, y, z = ((base - head.anatomy.eye) / scale).T
    brow = (z > -62) & (np.abs(x) < 52) & (y > 40)
    way = np.minimum(np.full(len(base), 0.5 * sum(style.lock)) * scale * (1 - style.lift), _LEAN_MM)
    along = combed(head, base)
    if style.fringe:
        along[brow] = (0.0, -0.2, 1.0)
        way = np.where(brow, style.fringe * scale, way)
    else:
        way = np.where(brow, 0.3 * way, way)
    best = base
    for part in (0.25, 0.5, 0.75, 1.0):
        there = head.obstacle.along(base, along * (way * share * part)[:, None])
        local = (there - head.anatomy.eye) / scale
        low = 16.0 if style.fringe else 50.0
        face = (np.abs(local[:, 0]) < 58) & (local[:, 2] > -48) & (local[:, 1] < low)
        best = np.where(face[:, None], best, there)
    return best


def _strand_coordinates(anatomy: Anatomy, style: HairStyle, points: Reals) -> Reals:
    """Compute coordinates (N, 3), mm, in a frame with one axis along the strands, two across."""
    out = points - anatomy.centre
    length = np.linalg.norm(out, axis=1)
    if style.comb == "curls":
        return np.asarray(out)
    if style.comb == "crown":
        angle = np.arctan2(product(out, np.cross(CROWN, [1.0, 0.0, 0.0])), out[:, 0])
        polar = np.arccos(np.clip(product(out, CROWN) / length, -1, 1)) * _SKULL_MM
        columns = (_SKULL_MM * np.cos(angle), _SKULL_MM * np.sin(angle), polar)
    elif style.comb == "back":
        angle = np.arctan2(out[:, 0], out[:, 1] + 40.0)
        columns = (angle * _SKULL_MM, 0.0 * length, out[:, 2])
    else:
        parting = style.parting * anatomy.scale
        angle = np.arctan2(out[:, 0] - parting, out[:, 1] + 40.0)
        columns = (out[:, 2], 60.0 * np.sign(angle), angle * _SKULL_MM)
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
    to_top = smooth_step(scalp.directions[:, 1].astype(np.float64), 0.1, 0.7)
    low = style.side + (style.back - style.side) * np.clip(-scalp.directions[:, 2], 0, 1)
    full = low + (style.top - low) * to_top
    if style.comb == "back" and not style.extra:  # a quiff is highest over the forehead
        full *= 1 + 0.25 * to_top * np.clip(scalp.directions[:, 2] * 1.5, 0, 1)
    rim = np.clip(inside / max(_RIM_MM, 0.7 * style.top), 0, 1)
    first = np.minimum(_RIM_THICKNESS_MM / full, 0.4)
    rim = first + (1 - first) * np.sqrt(rim)
    clumps = 1 + 0.16 * smooth_noise(base / _CLUMP_MM, seed + 4)
    return np.asarray(full * rim * clumps * anatomy.scale)
