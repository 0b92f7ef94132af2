"""Edges of garments: smoothed, with hems and collars."""

from __future__ import annotations

import numpy as np

from glsim.core.array_types import Reals, Whole
from glsim.core.mesh import vertex_normals
from glsim.core.products import product, units
from glsim.looks.cloth_body import UP, ClothBody
from glsim.looks.garments import COLLARS, HEMS, Garment, Profile
from glsim.looks.locks import hull_mm

#: Length over which a garment's edges are smoothed, mm, and largest number of rounds. Chosen.
_SEAM_MM, _SEAM_ROUNDS = 22.0, 60


def sewn(
    piece: ClothBody, garment: Garment, surface: Reals, scale: float
) -> tuple[Reals, Whole, Whole, Reals]:
    """Straighten the edges of a garment, and add its hems and its collar.

    ``surface`` holds the points of the cloth, (N, 3) mm; points at its edge are moved in place.
    ``scale``: size relative to a mean adult.

    Returns:
        Points (M, 3), mm; triangles; for each point its point of the grid; and offsets (M, 3), mm,
        that turn with the skull: a standing collar follows the head, not the dropping jaw's skin.
    """
    faces = piece.grid.faces
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = len(surface)
    # Edges that only one triangle has belong to the border.
    forth, back = sides[:, 0] * count + sides[:, 1], sides[:, 1] * count + sides[:, 0]
    ends = sides[~np.isin(forth, back)]
    edge, number = np.unique(ends, return_inverse=True)
    first, second = number.reshape(-1, 2).T
    ways = 2.0 + np.bincount(number.ravel(), minlength=len(edge))[:, None]
    spacing = float(np.median(np.linalg.norm(surface[ends[:, 1]] - surface[ends[:, 0]], axis=1)))
    rounds = int(np.clip((_SEAM_MM / max(spacing, 1.0)) ** 2, 6, _SEAM_ROUNDS))

    def even(values: Reals) -> Reals:
        for _ in range(rounds):
            total = 2.0 * values
            np.add.at(total, first, values[second])
            np.add.at(total, second, values[first])
            values = total / ways
        return values

    normal = _units(even(vertex_normals(surface, faces)[edge]))
    places = even(surface[edge])
    # A neckline, but no waist or ankle, is taut: it spans hollows between bones and muscles.
    on_top, beside = piece.opening[edge] < 3.0, places - piece.neck
    high = product(beside, UP)
    ring = on_top & (np.abs(high) < 150.0) & (garment.collar != "v")
    out = (beside - high[:, None] * UP)[ring]
    places[ring] += hull_mm(out, units(out))[:, None] * units(out) - out
    tangent = np.zeros((len(edge), 3))
    for end in (first, second):
        np.add.at(tangent, end, places[second] - places[first])
    away = _units(even(_units(np.cross(tangent, normal))))
    surface[edge] = places
    top = _collar(garment, away, normal, places - piece.neck, scale)
    hem = _rows(HEMS["rib" if garment.gathered else "hem"], garment.thick, normal, away)
    inner = faces[(piece.rim[faces] < garment.seen_mm).all(axis=1), ::-1]
    bases, points, strips = [np.arange(count)], [surface], [faces, inner]
    drops = [np.zeros_like(surface)]
    for on_side, rows in ((on_top, top), (~on_top, hem)):
        side_points = edge[on_side]
        line = ends[np.isin(ends, side_points).all(axis=1)]
        position = np.searchsorted(side_points, line)
        before, total = line, sum(map(len, bases))
        stands = rows is top and garment.collar in COLLARS
        for row in rows[:, on_side]:
            after = total + position
            (a, b), (c, d) = before.T, after.T
            strip = np.concatenate([np.stack([b, a, c], 1), np.stack([b, c, d], 1)])
            # A folded collar shows the cloth's other side.
            strips += [strip, strip[:, ::-1]] if rows is top else [strip]
            bases.append(side_points)
            points.append(surface[side_points] + row)
            drops.append(row * stands)
            before, total = after, total + len(side_points)
    joined = (np.concatenate(values) for values in (points, strips, bases, drops))
    return tuple(joined)  # type: ignore[return-value]


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
