"""Clothes: shells over the body that rest on the skin, hang and fold, with openings and seams.

A garment is made in four steps. Its area is cut out of the skin. It spans the trunk and the limbs,
and falls. Its edges are finished. Its folds are drawn (shaders/lib/folds.glsl).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from glsim.core.array_types import Array, Floats, Reals, Whole
from glsim.core.mesh import reduced, vertex_normals
from glsim.core.products import product
from glsim.core.seeds import keyed_rng
from glsim.looks.binding import Shell
from glsim.looks.cloth_body import ARMS, FEET, LEGS, TRUNK, ClothBody
from glsim.looks.garments import Garment
from glsim.looks.noise import smooth_noise, smooth_step
from glsim.looks.seams import sewn

#: Share of a garment's triangles that is drawn. Chosen by eye: below it facets show
#: (docs/results/speed.md has what it changes).
_DRAWN_SHARE = 0.4
#: Gap between skin and resting cloth, mm, without half the cloth's thickness. Chosen.
_REST_MM: Final = 1.5
#: Rounds of smoothing: of what moves the skin, of the cloth, of the heights of creases. Chosen.
_MOVED, _ROUNDS, _HEAPED = 3, 8, 10
#: Height of the slices in which trunk and limbs are spanned, mm, number of directions around them,
#: and largest distance of cloth that spans, mm. Chosen.
_SLICE_MM, _TURNS, _SPAN_MM = 25.0, 48, 80.0
#: Narrowing of cloth that falls, mm per mm, at hang 0 (a tenth at 1); height above the crotch of
#: the widest place of a seat, mm; length of the toes that shoes leave out, mm. Chosen.
_NARROWER, _SEAT_MM, _TOES_MM = 0.4, 210.0, 25.0
#: Distance between fine folds, mm (lib/folds.glsl). Heights of folds and creases, relative to the
#: garment's: chosen so that residuals of depth correlate as on the cloth of 17 people before a
#: Kinect V2, by 0.44 at two pixels along y. A person's factor; how far folds wind, mm: chosen.
_FOLD_MM, _HANGING, _PILED, _CRUMPLED, _WARP_MM = 23.0, 0.9, 0.5, (0.6, 1.4), 18.0


def make_clothes(
    body: ClothBody, garments: Sequence[Garment], tucked: bool, scale: float, seed: int
) -> list[tuple[Shell, Floats]]:
    """Make an upper garment, a lower garment and shoes; a bust gets an upper garment only.

    A tucked hem is inside the lower garment. ``scale`` is the size relative to a mean adult.
    """
    upper, lower, shoes = garments
    height = float(body.neck[1]) - body.crotch_mm
    hem_mm = body.crotch_mm + float(keyed_rng(seed, "hem").uniform(0.1, 0.18)) * height
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
    shells = []
    for top, inside, garment, limbs, end_mm, number in pieces if on_leg.any() else pieces[:1]:
        piece = body.cut(top, inside)
        if len(piece.grid.faces) >= 20:
            shells.append(_garment(piece, garment, limbs, end_mm, number, scale))
    return shells


def _garment(
    piece: ClothBody, garment: Garment, limbs: tuple[int, int], hem_mm: float,
    seed: int, scale: float,
) -> tuple[Shell, Floats]:  # fmt: skip
    """Make a garment on the skin ``piece`` with sleeves or legs on ``limbs`` and a hem at height y.

    ``scale``: size relative to a mean adult. Returns the cloth and its folds, as in ``Mesh``.
    """
    on_limb = np.isin(piece.part, limbs)
    piece = replace(piece, part=piece.part * on_limb)
    hem, down, y = float(piece.neck[1]) - hem_mm, piece.local[:, 1], piece.skin[:, 1]
    # The level is 0 at the top of the garment, 1 at its hem or cuffs.
    level = np.where(on_limb, piece.share / min(garment.limb, 1.0), down / max(hem, 100.0))
    held = on_limb & (limbs == ARMS and garment.limb > 0.5) | garment.gathered
    end = held * smooth_step(level, 0.9, 0.98)  # ribs at the end
    lies = ~on_limb * smooth_step(piece.normal[:, 1], 0.35, 0.85)  # on the shoulders
    loose = (1 - lies) * (1 - end) * smooth_step(piece.opening, 0.0, 90.0)
    if limbs == LEGS:
        # Trousers lie on a seat, and nothing is spanned between the legs.
        loose *= smooth_step(np.where(on_limb, down, 2 * (y - hem_mm) - 50), 0.0, 200.0)
    if limbs == FEET:
        loose *= 1 - smooth_step(y - y.min(), 45.0, 80.0)  # shoes end at the ankle
        lies = loose  # their ease is in the hull
    trunk = garment.ease * smooth_step(level, 0.0, 0.3) + garment.flare * np.clip(level, 0, 1.1)
    limb = garment.limb_ease + garment.limb_flare * np.clip(level, 0, 1.1)
    if limbs == ARMS:  # a shirt lies on a seat
        trunk *= 0.3 + 0.7 * smooth_step(y - piece.crotch_mm, 60.0, _SEAT_MM)
    room = (1 - lies) * np.where(on_limb, limb, trunk) * (1 - 0.85 * end) * scale
    edges, rest = _edges(piece), _REST_MM + 0.5 * garment.thick
    moved = np.column_stack([loose[:, None] * _spanned(piece, garment), room + rest])
    moved = _smoothed(edges, moved, _MOVED)
    hull = piece.skin + moved[:, :3]
    surface = hull + moved[:, 3:] * vertex_normals(hull, piece.grid.faces)
    surface = _smoothed(edges, surface, _ROUNDS)  # cloth does not bend sharply
    if limbs == FEET:
        surface[:, 1] = np.maximum(surface[:, 1], y.min())
    else:
        under = rest - ((surface - piece.skin) * piece.normal).sum(axis=1)
        surface += np.maximum(under, 0.0)[:, None] * piece.normal
    if garment.placket:
        front = np.exp(-((piece.local[:, 0] / (14 * scale)) ** 4))
        surface[:, 2] += garment.placket * front * ((piece.local[:, 2] > 0) & ~on_limb)
    points, faces, bases, drop = sewn(piece, garment, surface, scale)
    points, drawn, nearest = reduced(points, faces, _DRAWN_SHARE)
    drop, base = drop[nearest].astype(np.float32), bases[nearest]
    anchors = piece.grid.anchors.taken(base)
    offset = points - drop - anchors.place(piece.rest_mm[piece.grid.base])
    grid = piece.grid._replace(anchors=anchors, faces=drawn.astype(np.int64))
    elbow_and_cuff = _bump(piece.share, 0.5, 0.13) + _bump(level, 0.94, 0.09)
    waist = 0.7 * _bump(level, 0.72, 0.22) * (limbs == ARMS)
    heap = np.where(on_limb, elbow_and_cuff, waist)
    heap = _smoothed(edges, heap[:, None], _HEAPED)[:, 0]
    calm = np.maximum(lies, ~on_limb * (limbs == LEGS))  # trousers lie on the hips
    height = garment.fold * scale * smooth_step(piece.rim, 0.0, 40.0) * (1 - 0.7 * calm)
    heights = height * np.stack([_HANGING * (1 - end), _PILED * heap])
    return Shell(grid, piece.rest_mm, offset, drop), _folds(points, heights.T[base], seed)


def _folds(points: Reals, heights: Reals, seed: int) -> Floats:
    """Compute the places among folds and their heights, (N, 8) float32, as in ``Mesh``.

    ``points``: (N, 3) mm at rest. ``heights``: (N, 2) mm, of folds and of creases.
    """
    rng = keyed_rng(seed, "folds")
    # Depth counts less: folds go straight down where a chest slopes.
    places = points * (1.0, 1.0, 0.6) + rng.uniform(0, 3e3, 3)
    places += _WARP_MM * smooth_noise(points / 120.0, seed)[:, None]
    leaning = places + places[:, 1:2] * (rng.uniform(-0.4, 0.4), 0.0, 0.0)
    hanging = leaning / (1.0, 8.0, 1.0) / _FOLD_MM
    creases = (places + 0.45 * places[:, [1, 0, 2]]) / (3.0, 1.0, 3.0) / _FOLD_MM
    heights = heights * rng.uniform(*_CRUMPLED)
    columns = (hanging, heights[:, :1], creases, heights[:, 1:])
    return np.concatenate(columns, axis=1).astype(np.float32)


def _edges(piece: ClothBody) -> tuple[Whole, Whole, Reals]:
    """Return the ends of all edges of the grid, both ways, and their weights in a mean."""
    first, second = np.ascontiguousarray(piece.grid.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).T)
    return first, second, 1 / np.bincount(first, minlength=len(piece.skin))[first]


def _smoothed(edges: tuple[Whole, Whole, Reals], values: Reals, rounds: int) -> Array:
    """Smooth (N, k) values over the grid: in each round 0.6 of them become their neighbours'."""
    first, second, weight = edges
    rows = np.ascontiguousarray(values.T)
    for _ in range(rounds):
        means = [np.bincount(first, weight * row[second], len(row)) for row in rows]
        rows = 0.4 * rows + 0.6 * np.stack(means)
    return np.asarray(rows.T, np.float64)


def _spanned(piece: ClothBody, garment: Garment) -> Reals:
    """Compute the displacements from the skin to cloth that spans its hollows, (N, 3) mm.

    Cloth under tension goes straight from bulge to bulge: a slice of trunk, limb or foot becomes
    its convex hull. From the armpits and down the legs it falls, the straighter the more it
    hangs, but it lies on a seat.
    """
    moved = np.zeros_like(piece.skin)
    turn = np.linspace(0, 2 * np.pi, _TURNS, endpoint=False)
    ways = np.stack([np.cos(turn), np.sin(turn)])
    armpit = float(piece.neck[1] - piece.armpits[:, 1].mean())
    seat = float(piece.neck[1]) - piece.crotch_mm - _SEAT_MM
    for number in np.unique(piece.part):
        chosen = np.flatnonzero(piece.part == number)
        local = piece.local[chosen]
        flat, along = local[:, [0, 2]], local[:, 1]
        if number in FEET:  # a shoe has one end, not five
            along = np.minimum(along, along.max() - _TOES_MM)
        place = (along - along.min()) / _SLICE_MM
        row, part = place.astype(np.int64), (place % 1.0)[:, None]
        support = np.full((row.max() + 2, _TURNS), -np.inf)
        for rows in (row, row + 1):
            np.maximum.at(support, rows, product(flat, ways))
        for k in range(1, len(support)):
            down = along.min() + k * _SLICE_MM
            falls = number not in (TRUNK, *ARMS) or armpit < down < seat
            narrower = _NARROWER * (1 - 0.9 * garment.hang) * _SLICE_MM if falls else np.inf
            support[k] = np.maximum(support[k], support[k - 1] - narrower)
        around = (1 - part) * support[row] + part * support[row + 1]
        centre = product(around, ways.T) * (2 / _TURNS)  # the hull's Steiner point
        flat = flat - centre
        radius = np.maximum(np.linalg.norm(flat, axis=1), 1e-3)[:, None]
        cosine = np.maximum(product(flat / radius, ways), 0.1)
        around += garment.ease * (number in FEET)
        reach = ((around - product(centre, ways)) / cosine).min(axis=1)[:, None]
        x, z = (flat * np.clip(reach / radius - 1, 0.0, _SPAN_MM / radius)).T
        out = np.column_stack([x, along - local[:, 1], z])
        moved[chosen] = product(out, piece.axes[number].T)
    return moved


def _bump(value: Reals, middle: float, width: float) -> Reals:
    return np.asarray(np.exp(-(((value - middle) / width) ** 2)))
