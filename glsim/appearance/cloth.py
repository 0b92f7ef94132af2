"""Cloth: shells with folds over neck, torso, arms and legs, cut at collar, sleeves and hem."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Anatomy, Array, Mask
from glsim.appearance.noise import ridges, smooth_noise
from glsim.appearance.shell import Shell, SkinGrid, make_grid, point_normals
from glsim.geometry.products import principal_axis, product

_EDGE_MM: Final = {"head": 4.5, "body": 15.0}
#: Passes of smoothing that find hollows, about 90 mm wide on a grid of 9 mm, and the deepest, mm.
_SMOOTHING: Final = 60
_DEEPEST_MM: Final = 45.0
#: The collar's plane falls forward: the back of the neck is covered higher; chosen.
_SLOPE: Final = 0.42
#: Cloth is seen from both sides this far from its edges, mm: the width of a collar; chosen.
_OPEN_MM: Final = {"plain": 10.0, "v": 10.0, "band": 28.0, "roll": 30.0, "hood": 58.0}
#: Base of the neck of a mean adult: mm under the mouth; chosen on the procedural mean head.
_NECK_BASE_MM: Final = 92.0


@dataclass(frozen=True)
class Garment:
    """One garment for the upper body.

    Args:
        ease: mm between skin and cloth.
        fold: height of the folds, mm.
        sleeve: covered share of the arm.
        collar: its kind.
        neckline: mm over the base of the neck.
        rise: height of the collar, mm.
    """

    name: str
    weight: float
    ease: float
    fold: float
    sleeve: float
    collar: Literal["plain", "v", "band", "roll", "hood"] = "plain"
    neckline: float = 0.0
    rise: float = 0.0


#: Chosen: folds and relief of 2 to 4 mm on thin cloth, up to 7 mm on thick; ease of 5 to 20 mm.
GARMENTS: Final = (
    Garment("T-shirt", 6, 6, 2.5, 0.38, neckline=4),
    Garment("T-shirt, V-neck", 2, 6, 2.5, 0.36, "v", neckline=2),
    Garment("long-sleeved shirt", 3, 6, 2.8, 0.95, neckline=6),
    Garment("shirt", 5, 9, 3.5, 0.95, "band", neckline=20, rise=6),
    Garment("polo shirt", 2, 8, 3.0, 0.38, "band", neckline=16, rise=5),
    Garment("sweater", 4, 13, 4.0, 0.97, neckline=8, rise=3),
    Garment("turtleneck", 2, 9, 2.8, 0.97, "roll", neckline=42, rise=6),
    Garment("jacket", 3, 18, 5.0, 0.98, "band", neckline=22, rise=10),
    Garment("hooded sweater", 3, 15, 5.0, 0.97, "hood", neckline=20, rise=32),
    Garment("tank top", 1, 4, 2.0, 0.0, neckline=-14),
)


@dataclass(frozen=True, eq=False)
class ClothGrid:
    """The points at which cloth can lie on the heads or people of a source.

    Args:
        points: (N, 3) mm, on the reference mesh of the source.
        above_neck: (N,) height over the base of the neck, mm, along the collar's plane.
        arm, leg: (N,) place along the limb, 0 at its root and 1 at its end; NaN elsewhere.
        foot: (N,) whether the point is on a foot.
        front: (N,) 1 in front, 0 at the side, -1 behind.
        rest_mm: (V, 3) vertices at rest, of the reference mesh or of one subject.
        hollow: (N,) distance of cloth that spans a hollow from the skin, mm; subjects with a body.
        normal: (N, 3) normals of the skin; subjects with a body.
    """

    grid: SkinGrid
    points: Array
    above_neck: Array
    arm: Array
    leg: Array
    foot: Mask
    front: Array
    rest_mm: NDArray[np.float32]
    hollow: Array | None = None
    normal: Array | None = None


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
        spread = np.repeat(share[grid.base].astype(np.float32)[:, None], 3, axis=1)
        limbs.append(grid.anchors.place(spread)[:, 0])
    feet = np.repeat(anatomy.is_in("foot")[grid.base].astype(np.float32)[:, None], 3, axis=1)
    on_foot = grid.anchors.place(feet)[:, 0] > 0.5
    out = own - base
    front = out[:, 2] / np.maximum(np.hypot(out[:, 0], out[:, 2]), 1.0)
    return ClothGrid(
        grid, own, _above_neck(own, base), limbs[0], limbs[1], on_foot, front, anatomy.vertices_mm
    )


def fit_cloth(cloth: ClothGrid, vertices_mm: NDArray[np.float32]) -> ClothGrid:
    """Return the grid of a subject, (V, 3) mm at rest: with its hollows on a source with bodies.

    Cloth hangs from shoulders and hips and spans what lies between: where a smoothed surface is
    outside of the skin, the cloth follows it.
    """
    if not np.isfinite(cloth.arm).any():
        return replace(cloth, rest_mm=vertices_mm)
    count = len(cloth.points)
    skin = cloth.grid.anchors.place(vertices_mm[cloth.grid.base])
    normal = point_normals(cloth.grid, vertices_mm[cloth.grid.base].astype(np.float64))
    edges = cloth.grid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    degree = np.maximum(np.bincount(edges[:, 0], minlength=count), 1)
    smooth = skin.astype(np.float64)
    for _ in range(_SMOOTHING):
        columns = [np.bincount(edges[:, 0], smooth[edges[:, 1], k], count) for k in range(3)]
        smooth = 0.3 * smooth + 0.7 * np.stack(columns, axis=1) / degree[:, None]
    hollow = np.clip(((smooth - skin) * normal).sum(axis=1), 0.0, _DEEPEST_MM)
    return replace(cloth, rest_mm=vertices_mm, hollow=hollow, normal=normal)


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


def make_cloth(
    cloth: ClothGrid, garment: Garment, scale: float, seed: int
) -> tuple[Shell, NDArray[np.int32]] | None:
    """Return the shell and the triangles of a garment; None if it covers nothing."""
    grid, points = cloth.grid, cloth.points
    inside = garment.neckline * scale - cloth.above_neck
    if garment.collar == "v":
        beside = np.abs(points[:, 0] - points[:, 0].mean())
        inside -= np.clip(cloth.front, 0, 1) * np.clip(75 - 1.6 * beside, 0, None) * scale
    sleeve = 400 * (garment.sleeve - np.nan_to_num(cloth.arm))
    inside = np.where(np.isfinite(cloth.arm), np.minimum(inside, sleeve), inside)
    hem = 600 * (0.12 - np.nan_to_num(cloth.leg))
    inside = np.where(np.isfinite(cloth.leg), np.minimum(inside, hem), inside)
    inside = np.where(cloth.foot, -1.0, inside)
    keep: Mask = np.all(inside[grid.faces] > 0, axis=1)
    if keep.sum() < 20:
        return None
    kept, used = grid.taken(keep)
    height = _height(cloth, garment, inside, scale, seed)[used]
    # Hoods and collars stand open: their inner side shows near the edge.
    edge = kept.faces[(inside[used] < _OPEN_MM[garment.collar] * scale)[kept.faces].any(axis=1)]
    faces = np.concatenate([kept.faces, edge[:, ::-1]])
    return Shell(kept, cloth.rest_mm, height), np.ascontiguousarray(faces, np.int32)


def _height(
    cloth: ClothGrid, garment: Garment, inside: Array, scale: float, seed: int
) -> NDArray[np.float64]:
    """Return (N,) mm of cloth over the skin: ease, folds, and the collar."""
    points = cloth.points
    # Folds run across the pull: level round arms and waist, falling from the shoulders.
    turn = np.array([[0.9, 0.3, 0.0], [-0.45, 1.0, 0.25], [0.0, 0.2, 0.9]])
    folds = 0.7 * ridges(product(points, turn.T) / (70.0, 38.0, 70.0), seed)
    folds += 0.5 * smooth_noise(points / (45.0, 20.0, 45.0), seed + 1)
    folds += 0.3 * smooth_noise(points / 16.0, seed + 2)
    height = garment.ease + garment.fold * folds
    if cloth.hollow is not None:
        drape = 1 + 0.5 * smooth_noise(points / 110.0, seed + 3)
        height = height + 0.35 * garment.ease * drape + cloth.hollow
    if garment.rise:
        width = {"hood": 58.0, "roll": 34.0}.get(garment.collar, 30.0) * scale
        edge = np.clip(inside / width, 0, 1)
        bulge = np.sqrt(np.clip(1 - edge, 0, 1)) * np.clip(4 * edge + 0.25, 0, 1)
        around = 1.0 if garment.collar != "hood" else 0.35 + 0.65 * np.clip(0.4 - cloth.front, 0, 1)
        height = height + garment.rise * bulge * around
    return np.asarray(np.maximum(height, 2.5))


def make_trousers(
    cloth: ClothGrid, length: float, seed: int
) -> tuple[Shell, NDArray[np.int32]] | None:
    """Return trousers that cover a share of the legs; None for a source without legs."""
    if not np.isfinite(cloth.leg).any():
        return None
    leg = cloth.leg
    on_leg = np.isfinite(leg)
    top = np.nanmax(np.where(on_leg, cloth.points[:, 1], np.nan))
    inside = np.where(on_leg, 800 * (length - np.nan_to_num(leg)), top + 90 - cloth.points[:, 1])
    inside = np.where(np.isfinite(cloth.arm) | cloth.foot, -1.0, inside)
    keep: Mask = np.all(inside[cloth.grid.faces] > 0, axis=1)
    kept, used = cloth.grid.taken(keep)
    points = cloth.points[used]
    folds = 0.6 * ridges(points / (60.0, 42.0, 60.0), seed)
    folds += 0.5 * smooth_noise(points / (45, 20, 45), seed + 1)
    # The waist is under the garment; legs are wider towards the hem.
    ease = np.where(on_leg, 7.0 + 9.0 * np.nan_to_num(leg), 2.0)[used]
    hollow = 0.0 if cloth.hollow is None else cloth.hollow[used]
    height = np.maximum(ease + np.where(on_leg[used], 4.0, 1.0) * folds, 1.5) + hollow
    return Shell(kept, cloth.rest_mm, height), np.ascontiguousarray(kept.faces, np.int32)


def make_shoes(cloth: ClothGrid, seed: int) -> tuple[Shell, NDArray[np.int32]] | None:
    """Return shoes; None for a source without feet. Their soles stay on the floor."""
    if cloth.hollow is None or cloth.normal is None or not cloth.foot.any():
        return None
    keep: Mask = np.all(cloth.foot[cloth.grid.faces], axis=1)
    kept, used = cloth.grid.taken(keep)
    up = np.clip(cloth.normal[used, 1] + 0.8, 0.0, 1.0)
    seams = smooth_noise(cloth.points[used] / 18.0, seed + 5)
    height = (6.0 + 1.0 * seams + np.minimum(cloth.hollow[used], 18.0)) * up
    return Shell(kept, cloth.rest_mm, height), np.ascontiguousarray(kept.faces, np.int32)
