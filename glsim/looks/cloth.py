"""Clothes: shells over the body that rest on the skin, hang and fold, with openings and seams.

A garment is made in four steps. Its area is cut out of the skin. It spans the trunk, falls from
the chest and is lifted as a membrane. It is folded. Its edges are finished.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np

from glsim.core.array_types import Floats, Mask, Reals, Whole
from glsim.core.mesh import reduced, vertex_normals
from glsim.core.products import norm, principal_axis, product
from glsim.core.seeds import keyed_rng
from glsim.looks.anatomy import Anatomy
from glsim.looks.binding import Points, Shell
from glsim.looks.garments import COLLARS, HEMS, Garment, Profile
from glsim.looks.noise import smooth_noise
from glsim.looks.skin_grid import SkinGrid, make_grid, point_normals

#: Longest edge of the grid, mm, for heads and for whole people: folds are at least 40 mm apart.
_EDGE_MM: Final = {"head": 16.0, "body": 25.0}
#: Share of a garment's triangles that is drawn. Chosen: removing the others changes the clean depth
#: in a crop of the head by 0.05 mm on average (docs/results/speed.md).
_DRAWN_SHARE = 0.35
#: The same share for whole people, whose grid is coarser. Chosen by eye: below it facets show.
_DRAWN_OF_PEOPLE = 0.6
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
#: Gap between skin and resting cloth, mm, without half the cloth's thickness. Chosen.
_REST_MM: Final = 1.5
#: Largest gap at the armpit, mm, and its growth per mm from there, to leave room for the arms. The
#: values were chosen, not measured.
_PIT_MM, _PIT_SLOPE = 10.0, 0.3
#: Gap under hanging cloth, mm: largest excess over the garment's ease; initial value. Chosen.
_FREE_MM, _START_MM = 65.0, 30.0
#: Rounds of smoothing: of the settling membrane, of its lifting directions, of the result. Chosen.
_ROUNDS, _NORMAL_ROUNDS, _SMOOTH_ROUNDS = 24, 8, 8
#: Rounds of smoothing that blend trunk and limbs across their border. Chosen.
_JOINED: Final = 6
#: Height of the slices in which the trunk is spanned, mm, number of directions around it, and
#: largest distance of cloth that spans it, mm. Chosen.
_SLICE_MM, _TURNS, _SPAN_MM = 25.0, 48, 80.0
#: |noise| below which a fold has its crest; the noise's standard deviation is 0.3. Chosen: a
#: quarter of a draped cloth is crest.
_CREST: Final = 0.33
#: Length over which a garment's edges are smoothed, mm, and largest number of rounds. Chosen.
_SEAM_MM, _SEAM_ROUNDS = 22.0, 60

#: A function from values of points to the mean over each point's neighbours.
Averaging = Callable[[Reals], Reals]


@dataclass(frozen=True, eq=False)
class ClothGrid:
    """The grid of the skin that clothes can cover, shared by all subjects of a source.

    Args:
        part: (N,) number of the body part: TRUNK, or one of ARMS, LEGS, FEET.
        neck: (3,) mm, centre of the border between neck and torso of the reference.
        above_neck: (N,) mm, height above the plane of the neck opening.
    """

    grid: SkinGrid
    part: Whole
    neck: Reals
    above_neck: Reals


@dataclass(frozen=True, eq=False)
class ClothBody:
    """The skin of a subject at rest, or the part of it that a garment covers.

    Args:
        rest_mm: (V, 3) mm, vertices of the source.
        part: (N,) number of the body part.
        skin: (N, 3) mm, points of the grid.
        normal: (N, 3) unit normals.
        local: (N, 3) mm in the axes of the body part: across, down along it, forward.
        share: (N,) position along the body part, 0 at its root, 1 at its end.
        down: (N,) mm, distance from the neck along the body.
        opening: (N,) mm, distance below the garment's top edge; for a whole body below the base of
            the neck.
        neck: (3,) mm, centre of the base of the neck.
        crotch_mm: height y of the crotch; for a head without a body a mean adult's.
        armpits: (2, 3) mm, left and right; for a head without a body a mean adult's.
    """

    grid: SkinGrid
    rest_mm: Points
    part: Whole
    skin: Reals
    normal: Reals
    local: Reals
    share: Reals
    down: Reals
    opening: Reals
    neck: Reals
    crotch_mm: float
    armpits: Reals

    @property
    def waist_mm(self) -> float:
        """Height y of the waistband of trousers, mm. The value was chosen."""
        return self.crotch_mm + 0.28 * (float(self.neck[1]) - self.crotch_mm)

    def cut(self, opening: Reals, inside: Reals) -> ClothBody:
        """Cut the body at a garment's edges, where the distances ``inside``, (N,) mm, are 0."""
        whole = replace(self, opening=opening)
        grid, blend = self.grid.clipped(np.minimum(opening, inside))
        names = ("skin", "normal", "local", "share", "down", "opening")
        values: dict[str, Any] = {name: blend.of(getattr(whole, name)) for name in names}
        return replace(whole, grid=grid, part=self.part[blend.first], **values)


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
    grid = make_grid(anatomy.faces, chosen, points, _EDGE_MM["body" if has_body else "head"])
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
    local, share, down = np.zeros_like(skin), np.zeros(len(skin)), np.zeros(len(skin))
    for number in np.unique(part):
        index = np.flatnonzero(part == number)
        part_skin = skin[index]
        start, axis, length = neck, np.array([0.0, -1.0, 0.0]), float(neck[1]) - crotch
        if number in (*ARMS, *LEGS):
            middle, axis = part_skin.mean(axis=0), principal_axis(part_skin)
            axis = axis if product(middle - neck, axis) > 0 else -axis
            along = product(part_skin - middle, axis)
            start, length = middle + along.min() * axis, float(np.ptp(along))
        elif number in FEET:
            start = part_skin.mean(axis=0)
        side = np.cross(axis, [0.0, 0.0, 1.0]) / norm(np.cross(axis, [0.0, 0.0, 1.0]))
        axes = np.stack([side, axis, np.cross(side, axis)], axis=1)
        local[index] = product(part_skin - start, axes)
        share[index] = local[index, 1] / length
        down[index] = local[index, 1] + norm(start - neck)
        if number in ARMS:
            root = part_skin[share[index] < 0.12]
            armpits[number - ARMS[0]] = root[root[:, 1].argmin()]
    normal = point_normals(cloth.grid, base.astype(np.float64))
    return ClothBody(
        cloth.grid, vertices_mm, part, skin, normal, local, share, down, -cloth.above_neck, neck,
        crotch, armpits,
    )  # fmt: skip


def make_clothes(
    body: ClothBody, garments: Sequence[Garment], tucked: bool, scale: float, seed: int
) -> list[Shell]:
    """Make an upper garment, a lower garment and shoes; a bust gets an upper garment only.

    A tucked hem is inside the lower garment. ``scale`` is the size relative to a mean adult.
    """
    upper, lower, shoes = garments
    height = float(body.neck[1]) - body.crotch_mm
    hem_mm = body.crotch_mm + float(keyed_rng(seed, "hem").uniform(0.03, 0.12)) * height
    hem_mm = body.waist_mm if tucked else hem_mm
    on_arm, on_leg, on_foot = (np.isin(body.part, limbs) for limbs in (ARMS, LEGS, FEET))
    y, far = body.skin[:, 1], np.full(len(body.skin), 1e3)
    neck = upper.neckline * scale + body.opening
    if upper.collar == "v":
        beside = np.abs(body.local[:, 0])
        ahead = np.clip(body.local[:, 2] / 40.0, 0, 1)
        neck -= (body.part == TRUNK) * ahead * np.clip(75 - 1.6 * beside, 0, None) * scale
    # Convert shares of a limb to mm: arms are 520 mm long, legs 780 mm.
    cuff = np.where(on_arm, 520.0 * (upper.limb - body.share), y - hem_mm)
    trunk = np.where(on_foot, -1.0, cuff)
    # A hanging upper garment hides the top of the trousers, which is not made.
    top_mm = body.waist_mm + 12 if tucked else min(body.waist_mm, hem_mm + 60) + 12
    leg = np.where(on_leg, 780.0 * (lower.limb - body.share), far)
    legs = np.where(on_arm | on_foot, -1.0, leg)
    upper = replace(upper, gathered=upper.gathered or tucked)
    if tucked:
        lower, upper = replace(lower, ease=9.0), replace(upper, flare=0.0)
    pieces = [
        (neck, trunk, upper, ARMS, hem_mm, seed),
        (top_mm - y, legs, lower, LEGS, body.crotch_mm, seed + 40),
        (far, np.where(on_foot, 1.0, -1.0), shoes, FEET, 0.0, seed + 60),
    ]
    shells, share = [], _DRAWN_OF_PEOPLE if on_leg.any() else _DRAWN_SHARE
    for top, inside, garment, limbs, end_mm, number in pieces if on_leg.any() else pieces[:1]:
        piece = body.cut(top, inside)
        if len(piece.grid.faces) >= 20:
            shells.append(_garment(piece, garment, limbs, end_mm, number, scale, share))
    return shells


def _garment(
    piece: ClothBody,
    garment: Garment,
    limbs: tuple[int, int],
    hem_mm: float,
    seed: int,
    scale: float,
    share: float,
) -> Shell:
    """Make a garment on the skin ``piece`` with sleeves or legs on ``limbs`` and a hem at height y.

    ``scale``: size relative to a mean adult. ``share``: share of the triangles that is drawn.
    """
    on_limb = np.isin(piece.part, limbs)
    as_trunk = (piece.skin - piece.neck) * (-1.0, -1.0, 1.0)
    local = np.where(on_limb[:, None], piece.local, as_trunk)
    piece = replace(piece, part=piece.part * on_limb, local=local)
    hem = max(float(piece.neck[1]) - hem_mm, 100.0)
    # The level is 0 at the top of the garment, 1 at its hem or cuffs.
    level = np.where(on_limb, piece.share / min(garment.limb, 1.0), piece.local[:, 1] / hem)
    rest = _REST_MM + 0.5 * garment.thick
    held = on_limb & (limbs == ARMS and garment.limb > 0.5) | garment.gathered
    end = held * _step(level, 0.9, 0.98)  # ribs at the end
    mean = _averaging(piece)
    if limbs == ARMS:
        skin = _spanned(piece, on_limb, garment.hang, 1 - end, mean)
        piece = replace(piece, skin=skin, normal=vertex_normals(skin, piece.grid.faces))
    border = _repeated(mean, _JOINED, on_limb.astype(np.float64))
    border = 4 * border * (1 - border)

    def joined(values: Reals) -> Reals:
        """Blend the values of trunk and limbs near their border."""
        return np.asarray(values + border * (_repeated(mean, _JOINED, values) - values))

    away = np.linalg.norm(piece.skin[:, None] - piece.armpits, axis=2).min(axis=1)
    trunk = garment.ease * _step(level, 0.0, 0.3) + garment.flare * np.clip(level, 0, 1.1)
    limb = garment.limb_ease + garment.limb_flare * np.clip(level, 0, 1.1)
    wide = _step(piece.local[:, 1], 0.0, 70.0) * on_limb
    ease = (1 - wide) * trunk + wide * limb
    ease *= 1 - _step(piece.normal[:, 1], 0.35, 0.85) * ~on_limb  # cloth rests on the shoulders
    room = joined(ease * (1 - 0.85 * end)) * scale
    free = np.minimum(_PIT_MM + _PIT_SLOPE * away, _FREE_MM)
    room = rest + np.minimum(room, free)
    most = room + free * (1 - 0.9 * end)
    surface, lift = _membrane(piece, room, most, rest, mean)
    fold = _fold_heights(piece, level, on_limb, seed)
    fold = garment.fold * scale * joined(0.5 * fold + 0.5 * mean(fold))
    fold *= 1.2 if limbs == ARMS else 0.8
    loose = np.maximum(lift - rest, 0.0)
    height = np.maximum(np.clip(0.45 + loose / 14.0, 0.45, 1.6) * fold, -0.4 * loose)
    surface += height[:, None] * vertex_normals(surface, piece.grid.faces)
    if garment.placket:
        front = np.exp(-((piece.local[:, 0] / (14 * scale)) ** 4))
        surface[:, 2] += garment.placket * front * ((piece.local[:, 2] > 0) & ~on_limb)
    if limbs == FEET:
        surface = _shoes(piece, surface, garment.ease)
    return _sewn(piece, garment, surface, scale, share)


def _repeated(change: Averaging, rounds: int, values: Reals) -> Reals:
    for _ in range(rounds):
        values = change(values)
    return values


def _averaging(piece: ClothBody) -> Averaging:
    """Return a function that averages (N,) or (k, N) values over neighbours."""
    first, second = np.ascontiguousarray(piece.grid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).T)
    count = len(piece.skin)
    weight = 1 / np.bincount(first, minlength=count)[first]

    def mean(values: Reals) -> Reals:
        if values.ndim == 2:
            return np.stack([mean(row) for row in values])
        return np.asarray(np.bincount(first, weight * values[second], count), np.float64)

    return mean


def _membrane(
    piece: ClothBody, room: Reals, most: Reals, rest: float, mean: Averaging
) -> tuple[Reals, Reals]:
    """Lift cloth off the skin by ``room`` to ``most``, (N,) mm, as a membrane that spans hollows.

    Returns the (N, 3) points of the cloth, mm, and their height above the skin, (N,) mm, which is
    at least ``rest``.
    """
    out = np.ascontiguousarray(piece.normal.T)
    for _ in range(_NORMAL_ROUNDS):
        out = 0.5 * out + 0.5 * mean(out)
    out /= np.maximum(np.sqrt((out * out).sum(axis=0)), 1e-6)
    start = _START_MM * _step(piece.down, 80.0, 240.0)  # 0 on the shoulders
    base, lift = np.ascontiguousarray(piece.skin.T), np.minimum(room + start, most)
    for _ in range(_ROUNDS):
        over = ((mean(base + lift * out) - base) * out).sum(axis=0)
        lift = np.clip(over, room, most)
    surface, normal = base + lift * out, piece.normal.T
    for _ in range(_SMOOTH_ROUNDS):  # cloth does not bend sharply
        surface = 0.4 * surface + 0.6 * mean(surface)
    lift = ((surface - base) * normal).sum(axis=0)
    surface = surface + np.maximum(rest - lift, 0.0) * normal
    return np.ascontiguousarray(surface.T), np.maximum(lift, rest)


def _spanned(piece: ClothBody, on_limb: Mask, hang: float, loose: Reals, mean: Averaging) -> Reals:
    """Move the skin of the trunk, (N, 3) mm, out to where cloth spans its hollows.

    Cloth under tension goes straight around the trunk from bulge to bulge: a slice becomes its
    convex hull. Below the armpits cloth falls, the straighter the more ``hang``, 0 to 1.
    ``loose``: (N,) share of the way.
    """
    trunk = np.flatnonzero(~on_limb)
    skin, top_mm = piece.skin[trunk], float(piece.skin[:, 1].max())
    flat = (skin - np.median(skin, axis=0))[:, [0, 2]]
    place = (top_mm - skin[:, 1]) / _SLICE_MM
    row, part = place.astype(np.int64), (place % 1.0)[:, None]
    turn = np.linspace(0, 2 * np.pi, _TURNS, endpoint=False)
    ways = np.stack([np.cos(turn), np.sin(turn)])
    support = np.zeros((row.max() + 2, _TURNS))
    for rows in (row, row + 1):
        np.maximum.at(support, rows, product(flat, ways))
    armpit = max(int((top_mm - piece.armpits[:, 1].mean()) / _SLICE_MM), 0)
    for k in range(armpit + 1, len(support)):
        support[k] = np.maximum(support[k], support[k - 1] - 0.5 * (1 - hang) * _SLICE_MM)
    radius = np.maximum(np.linalg.norm(flat, axis=1), 1e-3)
    unit = flat / radius[:, None]
    cosine = np.maximum(product(unit, ways), 0.1)
    reach = (((1 - part) * support[row] + part * support[row + 1]) / cosine).min(axis=1)
    # Cloth rests on the shoulders and at its upper edge, and lies on a seat.
    share = _step(piece.down, 60.0, 160.0) * _step(piece.opening, 0.0, 90.0) * loose
    share *= 1 - _step(piece.normal[:, 1], 0.65, 0.95)
    share *= _step(piece.skin[:, 1] - piece.crotch_mm, 110.0, 210.0)
    moved = np.zeros((3, len(piece.skin)))
    moved[::2, trunk] = share[trunk] * np.clip(reach - radius, 0.0, _SPAN_MM) * unit.T
    return piece.skin + _repeated(mean, _JOINED, moved).T


def _shoes(piece: ClothBody, surface: Reals, ease: float) -> Reals:
    """Return the points of shoes, (N, 3) mm: a hull around each foot, which hides the toes."""
    floor = float(piece.skin[:, 1].min())
    hull = surface.copy()
    for foot in FEET:
        points = np.flatnonzero(piece.part == foot)
        skin = piece.skin[points]
        middle = np.array([np.median(skin[:, 0]), floor + 35.0, 0.0])
        out = (skin - middle) * (1.0, 1.0, 0.0)
        radius = np.maximum(np.linalg.norm(out, axis=1), 1.0)
        row = ((skin[:, 2] - skin[:, 2].min()) / 10.0).astype(np.int64)
        column = ((np.arctan2(out[:, 1], out[:, 0]) / np.pi + 1) * 9.99).astype(np.int64)
        cells = np.zeros((row.max() + 3, 20))
        np.maximum.at(cells, (row + 1, column), radius)
        for _ in range(2):
            cells = np.maximum(np.maximum(np.roll(cells, 1, 1), np.roll(cells, -1, 1)), cells)
        for _ in range(2):
            cells = 0.5 * (0.5 * (np.roll(cells, 1, 1) + np.roll(cells, -1, 1)) + cells)
        hull[points, 2] = np.minimum(hull[points, 2], skin[:, 2].max() - 20.0)
        hull[points] += ((cells[row + 1, column] + ease) / radius - 1)[:, None] * out
    columns = _repeated(_averaging(piece), _SMOOTH_ROUNDS, np.ascontiguousarray(hull.T))
    ankle = _step(piece.skin[:, 1] - floor, 45.0, 80.0)[:, None]
    shoes = ankle * surface + (1 - ankle) * columns.T
    shoes[:, 1] = np.maximum(shoes[:, 1], floor)
    return np.asarray(shoes)


def crests(places: Reals, seed: int) -> Floats:
    """Compute fold heights, (N,) float32, -0.6 to 0.85: narrow crests about one unit apart."""
    value = smooth_noise(places, seed) / np.float32(_CREST)
    return np.asarray(1.6 / (1 + value * value) - 0.75, np.float32)


def _fold_heights(piece: ClothBody, level: Reals, on_limb: Mask, seed: int) -> Reals:
    """Compute the relative heights of the folds, (N,), about -0.5 to 1.5.

    There are three kinds. Flutes fall to the hem and wind around limbs. Short folds lie where cloth
    piles up: at waist, elbows, knees and cuffs. Lines of tension run from the armpits to the
    opposite hip. ``level`` is (N,), 0 at the top of the garment, 1 at its hem or cuffs.
    """
    local = piece.local + np.outer(piece.part, (1e3, 0.0, 0.0))  # limbs fold differently
    warp = 22.0 * smooth_noise(local / 120.0, seed + 6)[:, None]
    fine = np.where(on_limb, 0.7, 1.0)[:, None]
    wound = local + warp + np.outer(0.5 * on_limb * local[:, 1], (1.0, 0.0, 0.0))
    flutes = crests(wound / (85.0, 380.0, 85.0) / fine, seed)
    leaning = local + 0.45 * local[:, [1, 0, 2]] * ~on_limb[:, None] + warp
    # Around a limb a fold ends: no rings.
    wide = np.where(on_limb[:, None], (65.0, 42.0, 65.0), (170.0, 58.0, 170.0))
    piled = crests(leaning / wide, seed + 1)
    soft = smooth_noise(local / (80.0, 60.0, 80.0), seed + 2)
    heap = np.where(
        on_limb,
        np.exp(-(((piece.share - 0.5) / 0.13) ** 2)) + np.exp(-(((level - 0.94) / 0.09) ** 2)),
        0.7 * np.exp(-(((level - 0.72) / 0.22) ** 2)),
    )
    height = 0.5 * soft + 0.9 * flutes * np.clip(1.6 * level - 0.2, 0, 1) + piled * heap
    for side, armpit in zip((1, -1), piece.armpits, strict=True):
        away = (piece.skin - armpit) * (1.0, -1.0, 1.0)
        draw = keyed_rng(seed, f"pull {side}")
        amount, turn = draw.uniform(0.3, 1.5), draw.uniform(0.4, 1.1)
        # The noise is stretched along a line down and to the middle: its crests follow this line.
        along = np.sin(turn) * side * away[:, 0] - np.cos(turn) * away[:, 1]
        across = np.cos(turn) * side * away[:, 0] + np.sin(turn) * away[:, 1]
        pulled = crests(np.stack([along / 190, across / 80, away[:, 2] / 130], 1), seed + 4 + side)
        near = np.exp(-((np.linalg.norm(away, axis=1) / 190.0) ** 2)) * ~on_limb
        height += amount * near * pulled
    return np.asarray(height)


def _sewn(piece: ClothBody, garment: Garment, surface: Reals, scale: float, share: float) -> Shell:
    """Straighten the edges of a garment, and add its hems and its collar.

    ``surface`` holds the points of the cloth, (N, 3) mm; points at its edge are moved in place.
    ``scale`` and ``share`` are the arguments of ``_garment``.
    """
    faces = piece.grid.faces
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = len(surface)
    first, second = np.ascontiguousarray(sides.T)
    # Directed edges cancel around an inner point; the other edges belong to the border.
    net = np.bincount(first, second, count) - np.bincount(second, first, count)
    rim = sides[(net != 0)[sides].all(axis=1)]
    forth, back = rim[:, 0] * count + rim[:, 1], rim[:, 1] * count + rim[:, 0]
    ends = rim[~np.isin(forth, back)]
    edge, number = np.unique(ends, return_inverse=True)
    first, second = number.reshape(-1, 2).T
    ways = 2.0 + np.bincount(number.ravel(), minlength=len(edge))[:, None]
    spacing = float(np.median(np.linalg.norm(surface[ends[:, 1]] - surface[ends[:, 0]], axis=1)))
    rounds = int(np.clip((_SEAM_MM / max(spacing, 1.0)) ** 2, 6, _SEAM_ROUNDS))

    def smoothed(values: Reals) -> Reals:
        total = 2.0 * values
        np.add.at(total, first, values[second])
        np.add.at(total, second, values[first])
        return total / ways

    even = partial(_repeated, smoothed, rounds)
    normal = _units(even(vertex_normals(surface, faces)[edge]))
    places = even(surface[edge])
    tangent = np.zeros((len(edge), 3))
    for end in (first, second):
        np.add.at(tangent, end, places[second] - places[first])
    away = _units(even(_units(np.cross(tangent, normal))))
    surface[edge] = places
    on_top = piece.opening[edge] < 3.0
    top = _collar(garment, away, normal, places - piece.neck, scale)
    hem = _rows(HEMS["rib" if garment.gathered else "hem"], garment.thick, normal, away)
    bases, placed, strips, stiff = [np.arange(count)], [surface], [], []
    drops = [np.zeros_like(surface)]
    stands = garment.collar in COLLARS  # it follows the head, since a dropping jaw pulls the skin
    for on_side, rows in ((on_top, top), (~on_top, hem)):
        side_points = edge[on_side]
        line = ends[np.isin(ends, side_points).all(axis=1)]
        position = np.searchsorted(side_points, line)
        before, total = line, sum(map(len, bases))
        for row in rows[:, on_side]:
            after = total + position
            strip = [np.stack([before[:, 1], before[:, 0], after[:, 0]], 1),
                     np.stack([before[:, 1], after[:, 0], after[:, 1]], 1)]  # fmt: skip
            strips += strip
            stiff += strip if rows is top else []  # a folded collar shows the cloth's other side
            is_stiff = stands and rows is top
            bases.append(side_points)
            placed.append(surface[side_points] + (0.0 if is_stiff else row))
            drops.append(row if is_stiff else np.zeros_like(row))
            before, total = after, total + len(side_points)
    near = np.zeros(count, bool)
    near[edge] = garment.seen_rings > 0
    for _ in range(garment.seen_rings - 1):
        near[faces[near[faces].any(axis=1)]] = True
    inner = faces[near[faces].all(axis=1)]
    both = np.concatenate([faces, *strips, inner[:, ::-1], *(strip[:, ::-1] for strip in stiff)])
    points, drawn, nearest = reduced(np.concatenate(placed), both, share)
    anchors = piece.grid.anchors.taken(np.concatenate(bases)[nearest])
    offset = points - anchors.place(piece.rest_mm[piece.grid.base])
    drop = np.concatenate(drops)[nearest].astype(np.float32) if stands else None
    grid = piece.grid._replace(anchors=anchors, faces=drawn.astype(np.int64))
    return Shell(grid, piece.rest_mm, offset, drop)


def _rows(profile: Profile, thick: float, normal: Reals, away: Reals) -> Reals:
    """Compute offsets, (R, P, 3) mm, from an edge of P points to the R rows of points of a hem.

    For each row the profile holds: the distance away from the cloth, mm; and along the normal, a
    multiple of the thickness, and mm. ``normal`` and ``away`` are (P, 3) unit vectors.
    """
    return np.stack([a * away + (n * thick + m) * normal for a, n, m in profile])


def _collar(garment: Garment, away: Reals, normal: Reals, beside: Reals, scale: float) -> Reals:
    """Compute the offsets of a collar along the edge of the neck opening, in the form of ``_rows``.

    ``beside`` is (P, 3) mm, the edge relative to the neck; ``scale`` is that of ``_garment``.
    """
    if garment.collar in HEMS:
        return _rows(HEMS[garment.collar], garment.thick, normal, away + 0.12 * UP)
    out = _units(beside - (beside * UP).sum(axis=1, keepdims=True) * UP)
    turn = np.abs(np.arctan2(out[:, 0], out[:, 2]))  # 0 in front, pi behind
    front, back = (np.array(rows, np.float64)[:, None] for rows in COLLARS[garment.collar])
    behind = np.clip((turn - 0.9) / 1.3, 0, 1)[None, :, None]
    shape = (1 - behind) * front + behind * back
    if garment.collar == "shirt":
        # The collar has two points in front, with the opening between them.
        points = np.exp(-(((turn - 0.5) / 0.22) ** 2))
        shape[5:, :, 1] -= (shape[4, :, 1] - shape[5:, :, 1]) * 0.2 * points
        shape[5:, :, 0] += 9.0 * points
        shape *= np.clip((turn - 0.08) / 0.3, 0.12, 1)[:, None]
    return np.asarray(scale * (shape[..., :1] * out + shape[..., 1:] * UP))


def _units(vectors: Reals) -> Reals:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-6))


def _step(value: Reals, low: float, high: float) -> Reals:
    """Interpolate smoothly from 0 at ``low`` to 1 at ``high`` (smoothstep)."""
    share = np.clip((value - low) / (high - low), 0, 1)
    return np.asarray(share * share * (3 - 2 * share))
