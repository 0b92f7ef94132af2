"""The body under clothes: the grid of the skin that they cover, its parts, and their axes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from glsim.core.array_types import Reals, Whole
from glsim.core.products import norm, principal_axis, product
from glsim.looks.anatomy import Anatomy
from glsim.looks.binding import Points
from glsim.looks.skin_grid import SkinGrid, make_grid, point_normals

#: Longest edge of the grid, mm; folds are drawn between its points.
_EDGE_MM: Final = 17.0
#: Slope of the plane of the neck opening, which is higher at the back. The value was chosen.
_SLOPE: Final = 0.42
#: Unit vector up along the neck, normal to the plane of the neck opening.
UP: Final = np.array([0.0, 1.0, _SLOPE]) / np.hypot(1.0, _SLOPE)
#: Height of the mouth above the base of the neck of a mean adult, mm; chosen for the procedural
#: mean head.
_NECK_BASE_MM: Final = 92.0
#: For heads without a body, mm: heights of a mean adult's crotch and armpits relative to the base
#: of the neck, and half the width between the armpits (DIN 33402: shoulders 1430, crotch 770 mm).
_CROTCH_MM, _ARMPIT_MM, _HALF_MM = -640.0, -170.0, 165.0
#: Numbers of the parts of a body; of a pair of limbs the left one is first.
TRUNK, ARMS, LEGS, FEET = 0, (1, 2), (3, 4), (5, 6)


@dataclass(frozen=True, eq=False)
class ClothGrid:
    """The grid of the skin that clothes can cover, shared by all subjects of a source.

    ``part`` (N,): TRUNK, or one of ARMS, LEGS, FEET; ``neck`` (3,) mm: centre of the border between
    neck and torso of the reference; ``above_neck`` (N,) mm: height above the neck opening's plane.
    """

    grid: SkinGrid
    part: Whole
    neck: Reals
    above_neck: Reals


@dataclass(frozen=True, eq=False)
class ClothBody:
    """Points on the resting skin of a subject: all of them, or those below a garment.

    Args:
        rest_mm: (V, 3) mm, vertices of the source.
        part: (N,) number of the body part.
        skin: (N, 3) mm, points of the grid.
        normal: (N, 3) unit normals.
        opening, rim: (N,) mm, distances below the garment's top edge and from its nearest edge; for
            a whole body below the base of the neck.
        starts, axes, lengths: for each part the root of its axis, (3,) mm; the unit vectors across,
            down along it and forward (a foot: along, up), columns of (3, 3); its length, mm.
        neck: (3,) mm, centre of the base of the neck.
        crotch_mm, armpits: height y of the crotch; left and right armpit, (2, 3) mm. For a head
            without a body those of a mean adult.
    """

    grid: SkinGrid
    rest_mm: Points
    part: Whole
    skin: Reals
    normal: Reals
    opening: Reals
    rim: Reals
    starts: Reals
    axes: Reals
    lengths: Reals
    neck: Reals
    crotch_mm: float
    armpits: Reals

    @cached_property
    def local(self) -> Reals:
        """Position across, along and before the axis of the body part, (N, 3) mm."""
        away = (self.skin - self.starts[self.part])[:, :, None]
        return np.asarray((away * self.axes[self.part]).sum(axis=1))

    @property
    def share(self) -> Reals:
        """Position along the body part, (N,), 0 at its root, 1 at its end."""
        return np.asarray(self.local[:, 1] / self.lengths[self.part])

    @property
    def waist_mm(self) -> float:
        """Height y of the waistband of trousers, mm. The value was chosen."""
        return self.crotch_mm + 0.28 * (float(self.neck[1]) - self.crotch_mm)

    def cut(self, opening: Reals, inside: Reals) -> ClothBody:
        """Cut the body at a garment's edges, where the distances ``inside``, (N,) mm, are 0."""
        rim = np.minimum(opening, inside)
        grid, blend = self.grid.clipped(rim)
        skin, normal, opening, rim = map(blend.of, (self.skin, self.normal, opening, rim))
        return replace(
            self, grid=grid, part=self.part[blend.first], skin=skin, normal=normal,
            opening=opening, rim=rim,
        )  # fmt: skip


def make_cloth_grid(anatomy: Anatomy) -> ClothGrid | None:
    """Make the grid of coverable skin; None if the meshes end above the base of the neck."""
    points = anatomy.vertices_mm.astype(np.float64)
    has_body = bool(anatomy.body.any())
    if has_body:
        both = [anatomy.is_in(n)[anatomy.faces].any(axis=1) for n in ("neck", "torso")]
        neck = points[anatomy.faces[both[0] & both[1]]].mean(axis=(0, 1))
    else:
        below = anatomy.mouth[1] - _NECK_BASE_MM * anatomy.scale
        behind = anatomy.ears[:, 2].mean() + 12 * anatomy.scale
        neck = np.array([anatomy.eye[0], below, behind])
    above = product(points - neck, UP)
    jaw = anatomy.mouth[1] - 52 * anatomy.scale
    skin = anatomy.outside & ~anatomy.is_in("hand", "ear", "lips", "nose") & (above < 60)
    low, behind = points[:, 1] < jaw, points[:, 2] < anatomy.ears[:, 2].mean() - 10
    chosen = skin[anatomy.faces].all(axis=1)
    chosen &= low[anatomy.faces].all(axis=1) | behind[anatomy.faces].all(axis=1)
    if chosen.sum() < 50:
        return None
    grid = make_grid(anatomy.faces, chosen, points, _EDGE_MM)
    on_grid = grid.anchors.place(anatomy.vertices_mm[grid.base]).astype(np.float64)
    row = np.arange(len(on_grid))
    nearest = grid.base[grid.anchors.corners[row, grid.anchors.weights.argmax(axis=1)]]
    is_right = (on_grid[:, 0] < neck[0]).astype(np.int64)
    part = np.full(len(on_grid), TRUNK)
    for name, limbs in (("arm", ARMS), ("leg", LEGS), ("foot", FEET)):
        part = np.where(anatomy.is_in(name)[nearest], limbs[0] + is_right, part)
    return ClothGrid(grid, part, neck, product(on_grid - neck, UP))


def fit_cloth(cloth: ClothGrid, vertices_mm: Points) -> ClothBody:
    """Measure the body of a subject whose resting vertices are (V, 3), mm."""
    base = vertices_mm[cloth.grid.base]
    skin = cloth.grid.anchors.place(base).astype(np.float64)
    near, part = np.abs(cloth.above_neck) < 8.0, cloth.part
    neck = skin[near].mean(axis=0) if near.any() else cloth.neck
    has_body = bool((part == ARMS[0]).any())
    crotch = float(skin[part == TRUNK, 1].min()) if has_body else float(neck[1]) + _CROTCH_MM
    armpits = neck + np.array([[side * _HALF_MM, _ARMPIT_MM, 0.0] for side in (1.0, -1.0)])
    starts, axes = np.tile(neck, (7, 1)), np.zeros((7, 3, 3))
    lengths = np.full(7, float(neck[1]) - crotch)
    for number in np.unique(part):
        part_skin = skin[part == number]
        axis, ahead = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])
        if number in (*ARMS, *LEGS):
            middle, axis = part_skin.mean(axis=0), principal_axis(part_skin)
            axis = axis if product(middle - neck, axis) > 0 else -axis
            along = product(part_skin - middle, axis)
            starts[number], lengths[number] = middle + along.min() * axis, np.ptp(along)
            if number in ARMS:
                root = part_skin[along - along.min() < 0.12 * np.ptp(along)]
                armpits[number - ARMS[0]] = root[root[:, 1].argmin()]
        elif number in FEET:
            starts[number], axis, ahead = part_skin.mean(axis=0), ahead, -axis
        side = np.cross(axis, ahead) / norm(np.cross(axis, ahead))
        axes[number] = np.stack([side, axis, np.cross(side, axis)], axis=1)
    normal, below = point_normals(cloth.grid, base.astype(np.float64)), -cloth.above_neck
    return ClothBody(
        cloth.grid, vertices_mm, part, skin, normal, below, below, starts, axes, lengths, neck,
        crotch, armpits,
    )  # fmt: skip
