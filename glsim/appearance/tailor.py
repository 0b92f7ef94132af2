"""Make the clothes of a subject: garments with collars and cuffs, trousers, skirts and shoes."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array
from glsim.appearance.binding import Binding
from glsim.appearance.cloth import ClothBody
from glsim.appearance.drape import Fit, drape
from glsim.appearance.garments import Garment, Lower
from glsim.appearance.noise import smooth_noise
from glsim.appearance.rims import Edge, collar, find_edge, hem, rib
from glsim.appearance.scalp import Anchors
from glsim.appearance.shell import Shell, SkinGrid, surface_normals
from glsim.appearance.skirt import make_skirt
from glsim.appearance.tubes import hang

#: Lengths of an arm and a leg, mm, over which their shares count near a cut.
_ARM_MM, _LEG_MM = 520.0, 780.0
_ELBOW, _KNEE = 0.52, 0.5
#: What cuts a garment off.
_NECK, _CUFF, _HEM = 0, 1, 2

#: One can look into sleeves and legs so far, mm: cloth has an inner side there; chosen.
_SEEN_MM: Final = 130.0

Worn = tuple[Binding, NDArray[np.int32]]


def make_garment(
    body: ClothBody, garment: Garment, tucked: bool, scale: float, seed: int
) -> Worn | None:
    """Return the binding and the triangles of a garment; None if it covers nothing.

    Args:
        body: the subject.
        garment: what is worn.
        tucked: whether its hem is inside trousers or a skirt.
        scale: size of the subject over that of a mean adult.
        seed: of the folds.
    """
    cloth = body.cloth
    height = float(body.neck[1]) - body.crotch_mm
    low = body.waist_mm if tucked else body.crotch_mm + (0.03 + 0.09 * _share(seed)) * height
    fit = Fit(
        garment.ease * scale, 0.0 if tucked else garment.flare * scale, garment.slope,
        garment.sleeve_ease * scale, (-0.45 * garment.sleeve_ease if garment.sleeve > 0.5 else 4.0) * scale, 0.09,
        garment.fold * scale, garment.thick, low, garment.sleeve, garment.gathered or tucked, garment.sleeve > 0.5,
    )  # fmt: skip
    surface = drape(body, fit, body.arms, _ELBOW, seed)
    cuts = np.full((3, len(surface)), 1e3)
    cuts[_NECK] = garment.neckline * scale - cloth.above_neck
    if garment.collar == "v":
        beside = np.abs(cloth.points[:, 0] - cloth.neck[0])
        cuts[_NECK] -= np.clip(cloth.front, 0, 1) * np.clip(75 - 1.6 * beside, 0, None) * scale
    on_arm = np.isfinite(cloth.arm)
    cuts[_CUFF, on_arm] = _ARM_MM * (garment.sleeve - cloth.arm[on_arm])
    cuts[_HEM] = np.where(cloth.foot, -1.0, body.skin[:, 1] - low)
    cuts[_HEM, on_arm] = 1e3
    if garment.collar == "none":
        across = np.abs(body.skin[:, 0] - body.neck[0])
        half = float(np.abs(body.armpits[:, 0] - body.neck[0]).mean())
        over = body.skin[:, 1] - body.armpits[:, 1].mean()
        cuts[_CUFF] = np.where(over > -30, np.minimum(cuts[_CUFF], 0.82 * half - across), cuts[_CUFF])
    if garment.placket:
        front = np.exp(-(((body.skin[:, 0] - body.neck[0]) / (14 * scale)) ** 4))
        surface[:, 2] += garment.placket * front * (cloth.front > 0.3)
    piece = _cut(body, surface, cuts)
    if piece is None:
        return None
    grid, places, kind = piece
    edge = find_edge(grid.faces, places, surface_normals(grid.faces, places))
    at_neck = kind[edge.points] == _NECK
    none = np.zeros_like(at_neck)
    rows = _longest(
        (at_neck, collar(edge, garment.collar, body.neck, scale, garment.thick)),
        (~at_neck if garment.gathered else none, rib(edge, 24.0 * scale, garment.thick)),
        (none if garment.gathered else ~at_neck, hem(edge, garment.thick)),
    )
    return _sewn(body, grid, places, edge, rows)


def _longest(*choices: tuple[Array, Array]) -> Array:
    """Join the profiles of parts of an edge: (R, P, 3), shorter ones stay at their last row."""
    rows = max(len(offsets) for _, offsets in choices)
    joined = np.zeros((rows, *choices[0][1].shape[1:]))
    for chosen, offsets in choices:
        whole = np.concatenate([offsets, np.repeat(offsets[-1:], rows - len(offsets), axis=0)])
        joined[:, chosen] = whole[:, chosen]
    return joined


def _share(seed: int) -> float:
    """Return a number in [0, 1) of a seed."""
    return float(np.random.Generator(np.random.Philox(key=[seed, 0x7A1])).random())


def _cut(
    body: ClothBody, surface: Array, cuts: Array
) -> tuple[SkinGrid, Array, NDArray[np.int64]] | None:
    """Cut cloth off where one of (K, N) distances is below 0.

    Returns:
        The grid, (M, 3) places, and (M,) which distance is the smallest; None if nothing is left.
    """
    inside = cuts.min(axis=0)
    if (inside > 0)[body.cloth.grid.faces].any(axis=1).sum() < 20:
        return None
    grid, blend = body.cloth.grid.clipped(inside)
    return grid, blend.of(surface), blend.of(cuts.T).argmin(axis=1)


def _sewn(
    body: ClothBody,
    grid: SkinGrid,
    places: Array,
    edge: Edge,
    rows: Array,
) -> Worn:
    """Sew strips to the edges of cloth.

    Args:
        body: the subject.
        grid: of the cloth.
        places: (M, 3) mm of the points of the grid.
        edge: of the cloth; ``places`` move onto it.
        rows: (R, P, 3) offsets from the edge.
    """
    points, ends = edge.points, edge.ends
    places[points] = edge.places
    count, wide = len(places), len(points)
    anchors = grid.anchors
    first, second = np.searchsorted(points, ends.T)
    strips = []
    before = (ends[:, 0], ends[:, 1])
    for row in range(len(rows)):
        after = (count + row * wide + first, count + row * wide + second)
        strips += [np.stack([before[1], before[0], after[0]], 1),
                   np.stack([before[1], after[0], after[1]], 1)]  # fmt: skip
        before = after
    whole = SkinGrid(
        grid.base,
        grid.triangles,
        Anchors(
            np.concatenate([anchors.corners, *[anchors.corners[points]] * len(rows)]),
            np.concatenate([anchors.weights, *[anchors.weights[points]] * len(rows)]),
        ),
        np.concatenate([grid.faces, *strips]),
    )
    placed = np.concatenate([places, *(places[points] + row for row in rows)])
    skin = whole.anchors.place(body.rest_mm[whole.base]).astype(np.float64)
    shell = Shell(whole, body.rest_mm, placed - skin)
    away = np.linalg.norm(places[:, None] - places[points][None, ::3], axis=2).min(axis=1)
    open_to = grid.faces[(away < _SEEN_MM)[grid.faces].all(axis=1)]
    faces = np.concatenate([whole.faces, open_to[:, ::-1]])
    return shell, np.ascontiguousarray(faces, np.int32)


def make_lower(body: ClothBody, lower: Lower, over: bool, scale: float, seed: int) -> Worn | None:
    """Return trousers, shorts or a skirt; None for a source without legs.

    Args:
        body: the subject.
        lower: what is worn.
        over: whether the garment is tucked into it.
        scale: size of the subject over that of a mean adult.
        seed: of the folds.
    """
    if not body.legs:
        return None
    if lower.skirt:
        return make_skirt(body, lower, over, scale, seed)
    cloth = body.cloth
    waist = 9.0 if over else 2.0
    fit = Fit(
        waist, 3.0, 0.25, lower.ease * scale, lower.flare * scale, lower.slope,
        lower.fold * scale, 2.5, body.crotch_mm, lower.length, False, lower.name == "joggers",
    )  # fmt: skip
    surface = drape(body, fit, body.legs, _KNEE, seed + 40)
    on_leg, on_arm = np.isfinite(cloth.leg), np.isfinite(cloth.arm)
    cuts = np.full((3, len(surface)), 1e3)
    cuts[_NECK] = np.where(on_arm, -1.0, body.waist_mm + 12 - body.skin[:, 1])
    cuts[_CUFF, on_leg] = _LEG_MM * (lower.length - cloth.leg[on_leg])
    cuts[_CUFF, cloth.foot] = -1.0
    piece = _cut(body, surface, cuts)
    if piece is None:
        return None
    grid, places, kind = piece
    edge = find_edge(grid.faces, places, surface_normals(grid.faces, places))
    top = kind[edge.points] == _NECK
    rows = _longest((top, rib(edge, 26.0 * scale, 2.5)), (~top, hem(edge, 2.5)))
    return _sewn(body, grid, places, edge, rows)


def make_shoes(body: ClothBody, seed: int) -> Worn | None:
    """Return shoes; None for a source without feet. Their soles stay on the floor."""
    if not body.feet:
        return None
    cloth = body.cloth
    surface = body.skin + 3.0 * body.normal
    for foot in body.feet:
        ease = 7.0 + 2.0 * np.linspace(0, 1, 8)
        room = hang(foot, ease, 0.5, 12) - foot.radius
        room += 1.0 * smooth_noise(cloth.points[foot.index] / 18.0, seed + 5)
        surface[foot.index] = body.skin[foot.index] + room[:, None] * foot.out
        floor = body.skin[foot.index, 1].min()
        surface[foot.index, 1] = np.maximum(surface[foot.index, 1], floor)
    cuts = np.where(cloth.foot, 1.0, -1.0)[None]
    piece = _cut(body, surface, cuts)
    if piece is None:
        return None
    grid, places, _ = piece
    edge = find_edge(grid.faces, places, surface_normals(grid.faces, places))
    return _sewn(body, grid, places, edge, rib(edge, 10.0, 3.0))
