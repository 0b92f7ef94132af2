"""Beards, moustaches, stubble and brows: sheets of strands over the skin of jaw and brows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from glsim.core.array_types import Mask, Reals
from glsim.looks.anatomy import Anatomy
from glsim.looks.binding import Hair, Shell
from glsim.looks.noise import smooth_noise
from glsim.looks.skin_grid import SkinGrid, make_grid, thinned
from glsim.looks.styles import STYLE_TABLE

#: Height from mouth to eyes of a mean adult, mm (Farkas 1994: 67 from stomion to sellion).
_EYE_TO_MOUTH_MM: Final = 66.0
_EDGE_MM: Final = 6.3
#: Height of each sheet as a share of the length, and the share of it that strands cover. Chosen.
_SHEETS: Final = ((1.0, 0.5), (0.45, 0.9))
#: Distance inside the outline at which a beard is dense, mm; width of a strand, mm. Chosen.
_SPARSE_MM, _STRAND_MM = 9.0, 0.7


#: Grid of a source's brows, the grid's points on the reference, (N, 3) mm, and hair density, (N,).
BrowGrid = tuple[SkinGrid, Reals, Reals]


@dataclass(frozen=True, eq=False)
class BeardGrid:
    """The grid of the skin on which beards grow, shared by all subjects of a source.

    ``points`` are (N, 3) mm on the reference head. ``inside``, ``lip`` and ``chin`` are distances,
    (N,) mm, inside the outlines of a full beard, a moustache and the chin's hair; negative outside.
    """

    grid: SkinGrid
    points: Reals
    inside: Reals
    lip: Reals
    chin: Reals


def make_beard_grid(anatomy: Anatomy) -> BeardGrid:
    """Make the grid of the beard area on the reference head of a source."""
    points = anatomy.vertices_mm.astype(np.float64)
    skin = anatomy.outside & ~anatomy.body & ~anatomy.is_in("ear", "lips", "lids")
    inside = _outline(anatomy, points)[0]
    chosen: Mask = skin[anatomy.faces].all(axis=1) & np.any(inside[anatomy.faces] > -6.0, axis=1)
    grid = thinned(anatomy.faces, chosen, anatomy.vertices_mm, _EDGE_MM)
    on_grid = grid.anchors.place(anatomy.vertices_mm[grid.base]).astype(np.float64)
    return BeardGrid(grid, on_grid, *_outline(anatomy, on_grid))


def _outline(anatomy: Anatomy, points: Reals) -> tuple[Reals, Reals, Reals]:
    """Compute the fields ``inside``, ``lip`` and ``chin`` of BeardGrid at points (N, 3)."""
    size, outline = (anatomy.eye[1] - anatomy.mouth[1]) / _EYE_TO_MOUTH_MM, STYLE_TABLE["outline"]
    local = (points - anatomy.mouth) / size
    x, y, z = np.abs(local[:, 0]), local[:, 1], local[:, 2]
    nose = anatomy.vertices_mm[anatomy.is_in("nose")]
    nose_base = (float(nose[:, 1].min()) - anatomy.mouth[1]) / size
    # An ellipse around the lips has no hair.
    lips = anatomy.vertices_mm[anatomy.is_in("lips")]
    half, high = (0.5 * float(np.ptp(lips[:, axis])) / size for axis in (0, 1))
    off_lips = (np.hypot(x / (half + 2.0), y / (high + 1.5)) - 1) * high
    cheek = np.interp(z, outline["z"], outline["high"])
    # The upper outline is at the base of the nose up to 12 mm from the middle, and is blended to
    # the cheek line at 28 mm.
    beside = np.clip((x - 12.0) / 16.0, 0, 1)
    rise = nose_base - 1.5 + (cheek - nose_base + 1.5) * beside
    upper = np.where(z > -34, np.maximum(cheek, rise), cheek) - y
    lower = y - np.interp(z, outline["z"], outline["low"])
    ear_front = float(anatomy.ears[:, 2].mean() - anatomy.mouth[2]) / size + 14
    inside = np.minimum.reduce([upper, lower, z - ear_front])
    lip = np.minimum(half + 7.0 - x, y + 13 - 0.25 * np.abs(x - half))
    chin = np.minimum(26.0 - x - 0.1 * np.abs(y), -y - 2)
    return np.minimum(inside, off_lips) * size, lip * size, chin * size


def make_beard(
    beard: BeardGrid, rest_mm: Reals, style: Mapping[str, Any], length_mm: float, seed: int
) -> list[Hair]:
    """Make the sheets of a ``style`` of styles.toml, the outermost first, on a head (V, 3) mm."""
    inside = beard.inside.copy()
    if not style.get("cheeks", True):
        areas = [getattr(beard, area) for area in ("chin", "lip") if style.get(area, True)]
        inside = np.minimum(inside, np.max(areas, axis=0))
    elif not style.get("lip", True):
        inside = np.minimum(inside, -beard.lip)
    grid, blend = beard.grid.clipped(inside + 2.5 * smooth_noise(beard.points / 6.0, seed))
    points, inside = blend.of(beard.points), blend.of(inside)
    rim = np.clip(inside / (4.0 + 0.8 * length_mm), 0.12, 1)
    tufts = points * np.array([1.0, 0.35, 1.0])  # longer along y: hair grows down
    relief = min(0.7 * length_mm, 4.5) * smooth_noise(tufts / 8.0, seed + 1)
    height = np.maximum(length_mm * rim + relief * np.sqrt(rim), 0.3)
    drop = np.zeros((len(points), 3), np.float32)
    if hang := style.get("hang", 0):
        share = np.clip(blend.of(beard.chin) / 18.0 + 0.2, 0, 1)
        ends = 1 + 0.35 * smooth_noise(points / 7.0, seed + 3)
        drop[:, 1] = -hang * share * ends * rim**2
        drop[:, 2] = 0.15 * hang * share * rim
    dense = np.clip(inside / _SPARSE_MM, 0.1, 1)
    return [
        _sheet(Shell(grid, rest_mm, share * height, share * drop), points[:, [0, 2, 1]],
               cover * dense, 0.5 * height, seed)
        for share, cover in _SHEETS
    ]  # fmt: skip


def _sheet(shell: Shell, places: Reals, cover: Reals, sink: Reals, seed: int) -> Hair:
    """Make a sheet of strands at places (N, 3) mm: two across them, one along."""
    cells = places / (_STRAND_MM * np.array([1.0, 1.0, 6.0])) + seed % 997
    strands = np.column_stack([cells, cover, sink]).astype(np.float32)
    return Hair(shell, shell.faces, None, strands)


def make_brow_grid(anatomy: Anatomy) -> BrowGrid:
    """Make the grid of the brows on the reference head of a source."""
    if "brow" in anatomy.names:
        brow: Reals = anatomy.is_in("brow").astype(np.float64)
    else:  # without a region: two arches above the eyes
        local = (anatomy.vertices_mm - anatomy.eye) / anatomy.scale
        x, y = np.abs(local[:, 0]), local[:, 1]
        along = np.clip((x - 10) / 42, 0, 1)
        arch = 16.5 + 6.0 * np.sin(np.pi * np.minimum(0.78 * along, 1)) - 4.0 * along**3
        span = (x > 9) & (x < 52) & (local[:, 2] > -45)
        brow = np.where(span, np.exp(-(((y - arch) / (4.4 - 2.6 * along)) ** 4)), 0.0)
    skin = anatomy.outside & ~anatomy.body
    chosen: Mask = skin[anatomy.faces].all(axis=1) & np.any(brow[anatomy.faces] > 0.3, axis=1)
    grid = make_grid(anatomy.faces, chosen, anatomy.vertices_mm, 3.3)
    on_grid = grid.anchors.place(anatomy.vertices_mm[grid.base]).astype(np.float64)
    columns = np.repeat(brow[grid.base].astype(np.float32)[:, None], 3, axis=1)
    return grid, on_grid, grid.anchors.place(columns)[:, 0]


def make_brows(brows: BrowGrid, rest_mm: Reals, height_mm: float, seed: int) -> Hair:
    """Make brows, ``height_mm`` thick, on a subject at rest, (V, 3) mm."""
    grid, points, weight = brows
    grid, blend = grid.clipped(weight - 0.1)
    weight, points = blend.of(weight), blend.of(points)
    height = height_mm * np.clip(weight, 0.15, 1)
    shell, cover = Shell(grid, rest_mm, height), 0.9 * np.sqrt(weight)
    return _sheet(shell, points[:, [1, 2, 0]], cover, 0.6 * height, seed)
