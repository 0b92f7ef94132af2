"""The points of a source at which cloth can lie, and of a subject: skin, trunk and limbs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from glsim.appearance.anatomy import Anatomy, Array, Mask
from glsim.appearance.binding import Points
from glsim.appearance.skin_grid import SkinGrid, make_grid, point_normals
from glsim.appearance.tubes import Tube, make_tube
from glsim.geometry.products import principal_axis, product

#: Longest edge of the grid on heads and on whole people, mm: folds are 40 mm apart and more.
_EDGE_MM: Final = {"head": 11.0, "body": 25.0}
#: The collar's plane falls forward: the back of the neck is covered higher; chosen.
_SLOPE: Final = 0.42
#: Away from the middle of the neck, along it: normal to the collar's plane.
UP: Final = np.array([0.0, 1.0, _SLOPE]) / np.hypot(1.0, _SLOPE)
#: Base of the neck of a mean adult: mm under the mouth; chosen on the procedural mean head.
_NECK_BASE_MM: Final = 92.0
#: Height of the middle of a foot over its sole, mm; chosen.
_FOOT_MM: Final = 45.0
#: Columns around a trunk, an arm or a leg, and a foot: 10 to 15 mm wide.
_COLUMNS: Final = {"trunk": 72, "limb": 30, "foot": 24}


@dataclass(frozen=True, eq=False)
class ClothGrid:
    """The points at which cloth can lie on the heads or people of a source.

    Args:
        points: (N, 3) mm, on the reference mesh of the source.
        neck: (3,) mm, the middle of the neck where it meets the torso.
        above_neck: (N,) height over the base of the neck, mm, along the collar's plane.
        arm, leg: (N,) place along the limb, 0 at its root and 1 at its end; NaN elsewhere.
        foot: (N,) whether the point is on a foot.
        front: (N,) 1 in front, 0 at the side, -1 behind.
    """

    grid: SkinGrid
    points: Array
    neck: Array
    above_neck: Array
    arm: Array
    leg: Array
    foot: Mask
    front: Array

    @property
    def has_body(self) -> bool:
        """Whether the source has people with arms, not heads alone."""
        return bool(np.isfinite(self.arm).any())


@dataclass(frozen=True, eq=False)
class ClothBody:
    """A subject at the points of a grid.

    Args:
        rest_mm: (V, 3) vertices at rest.
        skin, normal: (N, 3) mm and unit normals.
        trunk: from the neck down to the crotch.
        arms, legs, feet: the subject's left one first; none for a head.
        neck: (3,) mm, the middle of the neck at its base.
        crotch_mm: height (y); of a head that of a mean adult below its neck.
        armpits: (2, 3) mm, left and right; of a head those of a mean adult.
    """

    cloth: ClothGrid
    rest_mm: Points
    skin: Array
    normal: Array
    trunk: Tube
    arms: tuple[Tube, ...]
    legs: tuple[Tube, ...]
    feet: tuple[Tube, ...]
    neck: Array
    crotch_mm: float
    armpits: Array

    @property
    def waist_mm(self) -> float:
        """Height (y) at which trousers and skirts are worn; chosen."""
        return self.crotch_mm + 0.28 * (float(self.neck[1]) - self.crotch_mm)


def make_cloth_grid(anatomy: Anatomy) -> ClothGrid | None:
    """Find where cloth can be on a source; None if its meshes end above the base of the neck."""
    points = anatomy.vertices_mm.astype(np.float64)
    has_body = bool(anatomy.body.any())
    base = _neck_base(anatomy)
    above = _above_neck(points, base)
    skin = anatomy.outside & ~anatomy.is_in("hand", "ear", "lips", "nose")
    chosen = skin[anatomy.faces].all(axis=1) & (above[anatomy.faces] < 60).all(axis=1)
    jaw = anatomy.mouth[1] - 52 * anatomy.scale
    chosen &= (points[:, 1] < jaw)[anatomy.faces].all(axis=1) | (
        points[:, 2] < anatomy.ears[:, 2].mean() - 10
    )[anatomy.faces].all(axis=1)
    if chosen.sum() < 50:
        return None
    edge = _EDGE_MM["body" if has_body else "head"]
    grid = make_grid(anatomy.faces, chosen, points, edge)
    own = grid.anchors.place(anatomy.vertices_mm[grid.base]).astype(np.float64)
    limbs = []
    for name in ("arm", "leg"):
        share = np.full(len(points), np.nan)
        for side in (1.0, -1.0):
            limb = anatomy.is_in(name) & (side * (points[:, 0] - anatomy.eye[0]) > 0)
            if limb.any():
                share[limb] = _along(points[limb], base)
        limbs.append(_spread(grid, share))
    on_foot = np.isfinite(_spread(grid, np.where(anatomy.is_in("foot"), 1.0, np.nan)))
    out = own - base
    front = out[:, 2] / np.maximum(np.hypot(out[:, 0], out[:, 2]), 1.0)
    return ClothGrid(grid, own, base, _above_neck(own, base), limbs[0], limbs[1], on_foot, front)


def _spread(grid: SkinGrid, values: Array) -> Array:
    """Return (N,) values at the points of a grid; NaN where less than half of it is known.

    Args:
        values: (V,) of the source's vertices, NaN where unknown.
    """
    own = values[grid.base]
    known = np.isfinite(own)
    both = np.stack([np.where(known, own, 0.0), known, known], axis=1).astype(np.float32)
    total, share, _ = grid.anchors.place(both).T
    return np.where(share >= 0.5, total / np.maximum(share, 1e-6), np.nan)


#: Height of crotch and armpit of a mean adult under the base of the neck, and half the width
#: between the armpits, mm (DIN 33402: shoulders 1430 mm, crotch 770 mm); for heads without a body.
_CROTCH_MM, _ARMPIT_MM, _HALF_MM = -640.0, -170.0, 165.0


def fit_cloth(cloth: ClothGrid, vertices_mm: Points) -> ClothBody:
    """Return the trunk and limbs of a subject.

    Args:
        cloth: the grid of the subject's source.
        vertices_mm: (V, 3) at rest.
    """
    base = vertices_mm[cloth.grid.base]
    skin = cloth.grid.anchors.place(base).astype(np.float64)
    normal = point_normals(cloth.grid, base.astype(np.float64))
    near = np.abs(cloth.above_neck) < 8.0
    neck = skin[near].mean(axis=0) if near.any() else cloth.neck
    on_arm, on_leg = np.isfinite(cloth.arm), np.isfinite(cloth.leg)
    left = cloth.points[:, 0] > cloth.neck[0]
    ahead = np.array([0.0, 0.0, 1.0])
    down = np.array([0.0, -1.0, 0.0])
    torso = ~on_arm & ~on_leg & ~cloth.foot
    if cloth.has_body:
        crotch = float(skin[torso, 1].min())
        roots = [skin[on_arm & side & (cloth.arm < 0.12)] for side in (left, ~left)]
        armpits = np.stack([root[root[:, 1].argmin()] for root in roots])
    else:
        crotch = float(neck[1]) + _CROTCH_MM
        armpits = neck + np.array([[side * _HALF_MM, _ARMPIT_MM, 0.0] for side in (1.0, -1.0)])
    chosen = np.flatnonzero((torso | on_leg) & (skin[:, 1] > crotch) & (cloth.above_neck < 12))
    depth = skin[chosen, 2]
    top = np.array([neck[0], neck[1] + 10.0, 0.5 * (depth.min() + depth.max())])
    trunk = make_tube(chosen, skin[chosen], top, top + down, ahead, _COLUMNS["trunk"])

    def limb(share: Array, side: Mask) -> Tube:
        index = np.flatnonzero(np.isfinite(share) & side)
        first, last = (skin[index[near]] for near in (share[index] < 0.15, share[index] > 0.85))
        start, end = _middle(first), _middle(last)
        start = start - 0.075 * (end - start)
        return make_tube(index, skin[index], start, end, ahead, _COLUMNS["limb"], bends=True)

    def foot(side: Mask) -> Tube:
        index = np.flatnonzero(cloth.foot & side)
        heel, toe = (skin[index[f(skin[index, 2])]] for f in (np.argmin, np.argmax))
        middle = 0.5 * (skin[index, 1].min() + skin[index, 1].min() + 90.0)
        start, end = (np.array([p[0], middle, p[2]]) for p in (heel, toe))
        return make_tube(
            index, skin[index], start, end, np.array([0.0, 1.0, 0.0]), _COLUMNS["foot"]
        )

    sides = (left, ~left)
    return ClothBody(
        cloth,
        vertices_mm,
        skin,
        normal,
        trunk,
        tuple(limb(cloth.arm, side) for side in sides) if on_arm.any() else (),
        tuple(limb(cloth.leg, side) for side in sides) if on_leg.any() else (),
        tuple(foot(side) for side in sides) if cloth.foot.any() else (),
        neck,
        crotch,
        armpits,
    )


def _middle(points: Array) -> Array:
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _neck_base(anatomy: Anatomy) -> Array:
    """Return (3,) the middle of the neck where it meets the torso."""
    if anatomy.body.any():
        neck, torso = anatomy.is_in("neck"), anatomy.is_in("torso")
        border = neck[anatomy.faces].any(axis=1) & torso[anatomy.faces].any(axis=1)
        return np.asarray(anatomy.vertices_mm[anatomy.faces[border]].mean(axis=(0, 1)), np.float64)
    below = anatomy.mouth[1] - _NECK_BASE_MM * anatomy.scale
    return np.array([anatomy.eye[0], below, anatomy.ears[:, 2].mean() + 12 * anatomy.scale])


def _above_neck(points: Array, base: Array) -> Array:
    out = points - base
    return np.asarray((out[:, 1] + _SLOPE * out[:, 2]) / np.hypot(1.0, _SLOPE))


def _along(limb: Array, base: Array) -> Array:
    """Return (N,) the share of a limb, 0 at the end that is nearer to the neck, 1 at the other."""
    middle, axis = limb.mean(axis=0), principal_axis(limb)
    place = product(limb - middle, axis)
    if product(base - middle, axis) > 0:
        place = -place
    return np.asarray((place - place.min()) / np.ptp(place))
