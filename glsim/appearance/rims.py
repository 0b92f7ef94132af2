"""Rims of cloth: hems with thickness, ribs, collars and hoods, along the edges of a garment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.appearance.anatomy import Array
from glsim.appearance.cloth import UP
from glsim.appearance.garments import Collar

#: Profiles of collars: rows of (outward from the neck, up along it) mm from the garment's edge.
#: They begin inside and come back down inside, so that their thickness shows; chosen.
_STAND: Final = ((0, 0), (1, 10), (-1, 22), (-2, 31), (1, 35), (5, 33), (9, 24), (15, 6), (21, -10),
                 (20, -13), (15, -9))  # fmt: skip
_ROLL: Final = ((0, 0), (-2, 10), (-8, 24), (-12, 38), (-11, 46), (-6, 49), (-1, 44), (2, 30),
                 (3, 12), (1, 6), (-3, 6))  # fmt: skip
_ZIP: Final = ((0, 0), (5, 10), (8, 26), (8, 42), (6, 47), (2, 48), (-1, 44), (0, 26), (0, 6))
_HOOD_BACK: Final = ((0, 0), (3, 12), (10, 27), (24, 36), (42, 32), (54, 16), (58, -8), (52, -36),
                     (40, -54), (30, -54))  # fmt: skip
_HOOD_FRONT: Final = ((0, 0), (2, 6), (5, 14), (10, 18), (16, 17), (21, 10), (23, 0), (22, -4),
                      (19, -5), (15, -4))  # fmt: skip


@dataclass(frozen=True, eq=False)
class Edge:
    """The free edge of a piece of cloth: a hem, a cuff or a neckline.

    Args:
        ends: (E, 2) points of the cloth, in the order of its triangles.
        points: (P,) of the cloth that are on the edge, ascending.
        places: (P, 3) mm, smoothed along the edge.
        away: (P, 3) unit vectors along the cloth, away from it.
        normal: (P, 3) of the cloth.
    """

    ends: NDArray[np.int64]
    points: NDArray[np.int64]
    places: Array
    away: Array
    normal: Array


#: Seams are even lines: edges are smoothed over this length, mm, in at most so many passes.
_SEAM_MM, _SEAM_PASSES = 22.0, 60


def find_edge(faces: NDArray[np.int64], surface: Array, normal: Array) -> Edge:
    """Return the edge of (F, 3) triangles of a surface, (N, 3) mm with (N, 3) normals."""
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    count = np.int64(len(surface))
    forth, back = sides[:, 0] * count + sides[:, 1], sides[:, 1] * count + sides[:, 0]
    ends = sides[~np.isin(forth, back)]
    points, number = np.unique(ends, return_inverse=True)
    first, second = number.reshape(-1, 2).T

    def smoothed(values: Array) -> Array:
        for _ in range(passes):
            total = 2.0 * values
            np.add.at(total, first, values[second])
            np.add.at(total, second, values[first])
            values = total / parts
        return values

    ways = np.bincount(number.ravel(), minlength=len(points))
    parts = 2.0 + ways[:, None]
    spacing = float(np.median(np.linalg.norm(surface[ends[:, 1]] - surface[ends[:, 0]], axis=1)))
    passes = int(np.clip((_SEAM_MM / max(spacing, 1.0)) ** 2, 6, _SEAM_PASSES))
    places = smoothed(surface[points])
    tangent = np.zeros((len(points), 3))
    for end in (first, second):
        np.add.at(tangent, end, places[second] - places[first])
    away = _units(smoothed(_units(np.cross(tangent, normal[points]))))
    return Edge(ends, points, places, away, _units(smoothed(normal[points])))


def _units(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-6))


def hem(edge: Edge, thick: float) -> Array:
    """Return (R, P, 3) offsets of a hem: round the edge and back inside the cloth."""
    rows = ((0.6 * thick, -0.1 * thick), (0.8 * thick, -0.9 * thick), (0, -1.2 * thick - 0.8),
            (-14, -1.3 * thick - 1.2))  # fmt: skip
    return np.stack([a * edge.away + n * edge.normal for a, n in rows])


def rib(edge: Edge, width: float, thick: float, lift: float = 0.0) -> Array:
    """Return (R, P, 3) offsets of a ribbed band that goes on from the edge of the cloth.

    Args:
        edge: of the cloth.
        width, thick: of the band, mm.
        lift: how far the band turns up along the neck, mm per mm.
    """
    away = edge.away + lift * UP
    rows = ((0.5, 0.5 * thick + 1), (2, 0.6 * thick + 1.2), (0.5 * width, 0.6 * thick + 1.2),
            (width - 1, 0.5 * thick + 1), (width, 0), (width - 1, -0.8 * thick),
            (-6, -thick - 1))  # fmt: skip
    return np.stack([a * away + n * edge.normal for a, n in rows])


def collar(edge: Edge, kind: Collar, neck: Array, scale: float, thick: float) -> Array:
    """Return (R, P, 3) offsets of a collar from the edge at the neckline.

    Args:
        edge: of the garment.
        kind: of collar.
        neck: (3,) mm, the middle of the neck at its base.
        scale: size of the subject over that of a mean adult.
        thick: thickness of the cloth, mm.
    """
    out: Array = edge.places - neck
    out -= (out * UP).sum(axis=1, keepdims=True) * UP
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-6)
    turn = np.abs(np.arctan2(out[:, 0], out[:, 2]))  # 0 in front, pi behind
    if kind in ("crew", "v", "none"):
        return rib(edge, {"crew": 17.0, "v": 12.0, "none": 6.0}[kind] * scale, thick, 0.12)
    shape: Array
    if kind == "hood":
        behind = np.clip((turn - 0.9) / 1.3, 0, 1)[None, :, None]
        shape = _profile(_HOOD_FRONT, len(turn)) * (1 - behind) + behind * _profile(
            _HOOD_BACK, len(turn)
        )
    elif kind == "roll":
        shape = _profile(_ROLL, len(turn))
    elif kind == "zip":
        shape = _profile(_ZIP, len(turn))
        shape[..., 1] *= 0.25 + 0.75 * np.clip((turn - 0.12) / 0.3, 0, 1)
    else:
        shape = _profile(_STAND, len(turn))
        # The leaf is longest at its two points in front, and the collar is open between them.
        points = np.exp(-(((turn - 0.5) / 0.22) ** 2))
        shape[5:, :, 1] -= (shape[4, :, 1] - shape[5:, :, 1]) * 0.2 * points
        shape[5:, :, 0] += 9.0 * points
        shape *= np.clip((turn - 0.08) / 0.3, 0.12, 1)[:, None]
    shape *= scale
    return np.asarray(shape[..., :1] * out + shape[..., 1:] * UP)


def _profile(rows: tuple[tuple[float, float], ...], count: int) -> Array:
    """Return (R, count, 2) the same rows for every point."""
    return np.repeat(np.array(rows, np.float64)[:, None], count, axis=1)
