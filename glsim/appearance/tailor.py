"""Make the clothes of a subject: garments with collars and cuffs, trousers, skirts and shoes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array, Mask
from glsim.appearance.binding import Binding
from glsim.appearance.cloth import ClothBody
from glsim.appearance.drape import Fit, drape
from glsim.appearance.garments import Garment, Lower
from glsim.appearance.noise import smooth_noise
from glsim.appearance.rims import Edge, collar, find_edge, hem, rib
from glsim.appearance.shell import Shell
from glsim.appearance.skin_grid import SkinGrid
from glsim.appearance.skirt import make_skirt
from glsim.appearance.tubes import hang
from glsim.geometry.mesh import vertex_normals
from glsim.settings.seeds import keyed_rng

#: Lengths of an arm and a leg, mm, over which their shares count near a cut.
_ARM_MM, _LEG_MM = 520.0, 780.0
_ELBOW, _KNEE = 0.52, 0.5
#: Long sleeves lose this share of their room to the cuff, short ones gain some at their hem, mm;
#: and the slope by which they come back to the arm; chosen.
_TAPER, _SHORT_FLARE_MM, _SLEEVE_SLOPE = 0.45, 4.0, 0.09
#: A tank top: radius of its neckline, mm, and place of its armholes as a share of the half width.
_SCOOP_MM, _ARMHOLE = 72.0, 0.72
#: Folds of a bust are lower: its meshes have long triangles that cannot carry them; chosen.
_BUST_FOLDS: Final = 0.65
#: What cuts a garment off.
_NECK, _CUFF, _HEM = 0, 1, 2
#: Where the nearest cut of an edge is farther away, mm, the skin itself ends there.
_UNCUT_MM: Final = 1.0

#: One can look into cloth so far, mm: it has an inner side there, in the wide legs of shorts, which
#: look ahead when people sit, nearly everywhere; chosen.
_SEEN_MM: Final = {"cloth": 45.0, "shorts": 260.0, "shoes": 0.0}

#: Binding, triangles, and those of them that cast shadows.
Worn = tuple[Binding, NDArray[np.int32], NDArray[np.int32]]


def make_garment(
    body: ClothBody, garment: Garment, tucked: bool, scale: float, seed: int
) -> Worn | None:
    """Return a garment; None if it covers nothing.

    Args:
        body: the subject.
        garment: what is worn.
        tucked: whether its hem is inside trousers or a skirt.
        scale: size of the subject over that of a mean adult.
        seed: of the folds.
    """
    cloth = body.cloth
    low = _garment_hem_mm(body, tucked, seed)
    is_long = garment.sleeve > 0.5
    fit = Fit(
        ease=garment.ease * scale,
        flare=0.0 if tucked else garment.flare * scale,
        slope=garment.slope,
        limb_ease=garment.sleeve_ease * scale,
        limb_flare=(-_TAPER * garment.sleeve_ease if is_long else _SHORT_FLARE_MM) * scale,
        limb_slope=_SLEEVE_SLOPE,
        fold=garment.fold * scale * (1.0 if body.arms else _BUST_FOLDS),
        thick=garment.thick,
        hem_mm=low,
        cuff=garment.sleeve,
        gathered=garment.gathered or tucked,
        cuffed=is_long,
    )
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
        _cut_tank_top(body, cuts, scale)
    if garment.placket:
        front = np.exp(-(((body.skin[:, 0] - body.neck[0]) / (14 * scale)) ** 4))
        surface[:, 2] += garment.placket * front * (cloth.front > 0.3)
    piece = _cut(body, surface, cuts)
    if piece is None:
        return None
    grid, places, kind, edge = piece
    at_neck = kind[edge.points] == _NECK
    neck = collar(edge, garment.collar, body.neck, scale, garment.thick)
    strips = [(at_neck, neck)]
    if garment.gathered:
        strips.append((~at_neck, rib(edge, 24.0 * scale, garment.thick)))
    else:
        strips.append((~at_neck, hem(edge, garment.thick)))
    return _sewn(body, grid, places, edge, strips, is_collar=True)


def _cut_tank_top(body: ClothBody, cuts: Array, scale: float) -> None:
    """Cut a round neckline and armholes, in place: two straps stay on the shoulders."""
    out = body.skin - body.neck
    across = np.abs(out[:, 0])
    half = float(np.abs(body.armpits[:, 0] - body.neck[0]).mean())
    over = body.skin[:, 1] - body.armpits[:, 1].mean()
    ahead = np.clip(out[:, 2], 0, None)
    low = np.clip(-out[:, 1] - 20 * scale, 0, None) * np.where(out[:, 2] > 0, 0.7, 1.3)
    cuts[_NECK] = np.sqrt(across**2 + (0.35 * ahead) ** 2 + low**2) - _SCOOP_MM * scale
    side = np.where(over > -30, _ARMHOLE * half - across, half - across)
    cuts[_CUFF] = np.minimum(cuts[_CUFF], side)


def _garment_hem_mm(body: ClothBody, tucked: bool, seed: int) -> float:
    """Return the height (y) of a garment's hem: at the waist, or 20 to 70 mm over the crotch."""
    if tucked:
        return body.waist_mm
    height = float(body.neck[1]) - body.crotch_mm
    return body.crotch_mm + float(keyed_rng(seed, "hem").uniform(0.03, 0.12)) * height


def _cut(
    body: ClothBody, surface: Array, cuts: Array
) -> tuple[SkinGrid, Array, NDArray[np.int64], Edge] | None:
    """Cut cloth off where one of (K, N) distances is below 0.

    Returns:
        The grid, (M, 3) places, (M,) which distance is the smallest (_HEM where the skin ends), and
        the edge; None if nothing is left.
    """
    inside = cuts.min(axis=0)
    if (inside > 0)[body.cloth.grid.faces].any(axis=1).sum() < 20:
        return None
    grid, blend = body.cloth.grid.clipped(inside)
    places = blend.of(surface)
    edge = find_edge(grid.faces, places, vertex_normals(places, grid.faces))
    distances = blend.of(cuts.T)
    uncut = distances.min(axis=1) > _UNCUT_MM  # the skin itself ends there, below the shoulders
    return grid, places, np.where(uncut, _HEM, distances.argmin(axis=1)), edge


def _sewn(
    body: ClothBody,
    grid: SkinGrid,
    places: Array,
    edge: Edge,
    strips: Sequence[tuple[Mask, Array]],
    seen_mm: float = _SEEN_MM["cloth"],
    *,
    is_collar: bool = False,
) -> Worn:
    """Sew strips to the edges of cloth.

    Args:
        body: the subject.
        grid: of the cloth.
        places: (M, 3) mm of the points of the grid.
        edge: of the cloth; ``places`` move onto it.
        strips: each with (P,) the part of the edge that it goes round, and (R, P, 3) offsets;
            one can look into the cloth at the last part.
        seen_mm: how far.
        is_collar: whether the first strip is stiff: it stands off the garment's edge in the frame
            of the head, not in that of skin that a dropping jaw pulls.
    """
    places[edge.points] = edge.places
    bases, placed, faces = [np.arange(len(places))], [places], [grid.faces]
    stiff, turned, count = [np.zeros_like(places)], [], len(places)
    casts = [grid.faces]  # hems hide nothing that the cloth beside them does not hide
    for number, (part, rows) in enumerate(strips):
        alone = is_collar and number == 0
        own = edge.points[part]
        ends = edge.ends[np.isin(edge.ends, own).all(axis=1)]
        first, second = np.searchsorted(own, ends.T)
        before = (ends[:, 0], ends[:, 1])
        for row in rows[:, part]:
            after = (count + first, count + second)
            strip = [np.stack([before[1], before[0], after[0]], 1),
                     np.stack([before[1], after[0], after[1]], 1)]  # fmt: skip
            faces += strip
            if alone:  # a collar that is folded down shows the cloth's other side
                turned += [part[:, ::-1] for part in strip]
                casts += strip
            bases.append(own)
            placed.append(places[own] + (0.0 if alone else row))
            stiff.append(row if alone else np.zeros_like(row))
            before, count = after, count + len(own)
    points = np.concatenate(bases)
    whole = SkinGrid(grid.base, grid.triangles, grid.anchors.taken(points), np.concatenate(faces))
    skin = whole.anchors.place(body.rest_mm[whole.base]).astype(np.float64)
    drop = np.concatenate(stiff).astype(np.float32) if is_collar else None
    shell = Shell(whole, body.rest_mm, np.concatenate(placed) - skin, drop)
    rims = edge.places[strips[-1][0]][::4]
    away = np.linalg.norm(places[:, None] - rims, axis=2).min(axis=1, initial=np.inf)
    open_to = grid.faces[(away < seen_mm)[grid.faces].all(axis=1)]
    both = np.concatenate([whole.faces, open_to[:, ::-1], *turned]).astype(np.int32)
    return shell, both, np.concatenate(casts).astype(np.int32)


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
        ease=waist,
        flare=3.0,
        slope=0.25,
        limb_ease=lower.ease * scale,
        limb_flare=lower.flare * scale,
        limb_slope=lower.slope,
        fold=lower.fold * scale,
        thick=2.5,
        hem_mm=body.crotch_mm,
        cuff=lower.length,
        gathered=False,
        cuffed=lower.name == "joggers",
    )
    surface = drape(body, fit, body.legs, _KNEE, seed + 40)
    on_leg, on_arm = np.isfinite(cloth.leg), np.isfinite(cloth.arm)
    cuts = np.full((3, len(surface)), 1e3)
    # Under a garment that hangs over them nobody sees the top of trousers.
    top_mm = body.waist_mm if over else min(body.waist_mm, _garment_hem_mm(body, False, seed) + 60)
    cuts[_NECK] = np.where(on_arm, -1.0, top_mm + 12 - body.skin[:, 1])
    cuts[_CUFF, on_leg] = _LEG_MM * (lower.length - cloth.leg[on_leg])
    cuts[_CUFF, cloth.foot] = -1.0
    piece = _cut(body, surface, cuts)
    if piece is None:
        return None
    grid, places, kind, edge = piece
    top = kind[edge.points] == _NECK
    strips = [(top, rib(edge, 26.0 * scale, 2.5)), (~top, hem(edge, 2.5))]
    seen_mm = _SEEN_MM["shorts" if lower.length < 0.6 else "cloth"]
    return _sewn(body, grid, places, edge, strips, seen_mm)


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
    grid, places, _, edge = piece
    whole = np.ones(len(edge.points), bool)
    return _sewn(body, grid, places, edge, [(whole, rib(edge, 10.0, 3.0))], _SEEN_MM["shoes"])
