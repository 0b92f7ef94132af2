"""The template head: the mean adult; every subject is a displacement of it.

Built once per process from volumes (volumes.py) by the rays of the grid (grid.py), with lids, lips,
ears, eyeballs and teeth (eyes.py, mouth.py, ears.py, teeth.py). Left and right are exact mirror
images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tools.heads import ears, eyes, mouth, teeth
from tools.heads.falloff import Array, IntArray, smoothstep
from tools.heads.grid import (
    BUST_KNOT,
    COLUMNS,
    EYE_KNOT,
    HALF_COLUMNS,
    MOUTH_KNOT,
    ROWS,
    knot_row,
    make_rays,
    row_table,
)
from tools.heads.nose import nose_offset
from tools.heads.signed_distance import cast_to_surface
from tools.heads.topology import SLIT_EYE, SLIT_MOUTH, SkinTopology, build_topology
from tools.heads.volumes import EYE_CENTER, HEAD, TRUNK

PART_SKIN, PART_EYE_LINING, PART_MOUTH_LINING, PART_EAR, PART_EYEBALL, PART_TEETH = range(6)
SMOOTHING_PASSES = 8
# Smoothing of the nose without shrinking (G. Taubin, SIGGRAPH 1995).
NOSE_PASSES, SMOOTH, UNSHRINK = 8, 0.5, -0.52
FLIP = np.array([-1.0, 1.0, 1.0])  # mirror at the median plane


@dataclass(frozen=True, eq=False)
class Template:
    """The mean head with vertex labels.

    Args:
        points: (V, 3) float64 mm, canonical frame.
        faces: (F, 3) int32.
        part: (V,) PART_*.
        low: (V,) whether below the mouth's line, on a lower lid or a lower tooth.
        row, column, slit, ring: (V,) as in SkinTopology, 0 outside the skin.
        eye_angle: (V,) angle from an eyeball's axis, rad; pi outside the eyeballs.
    """

    points: Array
    faces: IntArray
    part: IntArray
    low: NDArray[np.bool_]
    row: IntArray
    column: IntArray
    slit: IntArray
    ring: IntArray
    eye_angle: Array


def skin_points(topology: SkinTopology) -> Array:
    """Return the (V, 3) skin at |x| for every vertex; the caller negates x on the right."""
    column = np.abs(topology.column)
    rays = make_rays(topology.row, column, np.zeros(len(column)))
    eye_low = topology.low & (topology.slit == SLIT_EYE)
    shift = eyes.open_lids(
        rays.origins[:, 0], (topology.row - knot_row(EYE_KNOT)).astype(np.float64), eye_low
    )
    mouth_rows = topology.row - knot_row(MOUTH_KNOT)
    line = mouth.stomion_line(rays.origins[:, 0]) - mouth.STOMION_Y
    shift += (
        line * np.exp(-np.square(mouth_rows / 4.0)) * smoothstep(40.0, 30.0, rays.origins[:, 0])
    )
    rays = make_rays(topology.row, column, shift)
    rays.directions[topology.ring < 0] = (0.0, 1.0, 0.0)  # the pole
    bust = topology.row >= knot_row(BUST_KNOT)
    points = np.empty_like(rays.origins)
    for chosen, volumes, steps in ((~bust, HEAD, 30), (bust, TRUNK, 60)):
        points[chosen] = cast_to_surface(
            rays.origins[chosen], rays.directions[chosen], volumes, steps
        )
    front = front_of(points, -80.0, -29.0)
    points[front, 2] += mouth.lip_offset(points[front, 0], points[front, 1])
    near_nose = front_of(points, -29.5, 0.0)
    points[near_nose, 2] += nose_offset(points[near_nose, 0], points[near_nose, 1])
    near_eye = front_of(points, 0.0, 32.0)
    points[near_eye, 2] += eyes.lid_offset(
        points[near_eye, 0], points[near_eye, 1] - row_table()[knot_row(EYE_KNOT), 0]
    )
    return smooth_grid(points, topology)


def front_of(points: Array, low_y: float, high_y: float) -> NDArray[np.bool_]:
    """Return (V,) whether a point is on the front of the face between two heights, mm."""
    return np.asarray((points[:, 2] > -40) & (points[:, 1] > low_y) & (points[:, 1] < high_y))


def smooth_grid(points: Array, topology: SkinTopology) -> Array:
    """Smooth the grid vertices (V, 3), weakly at lids, lips and nose.

    Works on half of the head, mirrored at the midlines; slit and ring vertices stay unchanged.
    """
    grid = points[: ROWS * COLUMNS].reshape(ROWS, COLUMNS, 3)
    half = grid[:, : HALF_COLUMNS + 1].copy()
    x, y, z = half[..., 0], half[..., 1], half[..., 2]
    fine = smoothstep(24.0, 15.0, np.hypot(x - EYE_CENTER[0], y - EYE_CENTER[1])) * (z > -30)
    lips = (
        smoothstep(14.0, 9.0, np.abs(y - mouth.STOMION_Y)) * smoothstep(34.0, 28.0, x) * (z > -20)
    )
    nose = 0.7 * smoothstep(-38.0, -31.0, y) * smoothstep(30.0, 24.0, y) * smoothstep(24.0, 18.0, x)
    bust = smoothstep(-138.0, -158.0, y) * (0.65 - 0.2 * smoothstep(110.0, 170.0, x))
    rate = 0.5 * (1.0 - np.maximum.reduce([fine, lips, nose * (z > 0), bust]))[..., None]
    for _ in range(SMOOTHING_PASSES):
        half += rate * (neighbour_mean(half) - half)
    ridge = smoothstep(-33.0, -27.0, y) * smoothstep(26.0, 12.0, y) * smoothstep(24.0, 18.0, x)
    ridge = (ridge * smoothstep(4.0, 14.0, z))[..., None]
    for step in (SMOOTH, UNSHRINK) * NOSE_PASSES:
        half += step * ridge * (neighbour_mean(half) - half)
    points = points.copy()
    points[: ROWS * COLUMNS] = half[:, np.abs(topology.column[:COLUMNS])].reshape(-1, 3)
    return points


def neighbour_mean(half: Array) -> Array:
    """Return the mean of the four neighbours of each vertex of a half grid (ROWS, C, 3)."""
    wide = np.concatenate([half[:, 1:2] * FLIP, half, half[:, -2:-1] * FLIP], axis=1)
    tall = np.concatenate([half[:1], half, half[-1:]], axis=0)
    mean = 0.25 * (wide[:, :-2] + wide[:, 2:] + tall[:-2] + tall[2:])
    mean[0], mean[-1] = half[0], half[-1]
    return np.asarray(mean)


def place_linings(points: Array, topology: SkinTopology) -> None:
    """Move the slits' inner rings of ``points`` (V, 3) behind lids and lips, in place."""
    margin = {
        (int(r), int(c), bool(lo)): i
        for i, (r, c, lo, s, g) in enumerate(
            zip(
                topology.row, topology.column, topology.low, topology.slit, topology.ring,
                strict=True,
            )
        )
        if s and g == 0
    }  # fmt: skip
    for kind, place in ((SLIT_EYE, eyes.lid_rings), (SLIT_MOUTH, mouth.mouth_rings)):
        chosen = np.flatnonzero((topology.slit == kind) & (topology.ring > 0))
        keys = [(int(topology.row[i]), int(topology.column[i])) for i in chosen]
        low = topology.low[chosen]
        margins = [
            margin.get((*k, bool(lo)), margin.get((*k, False)))
            for k, lo in zip(keys, low, strict=True)
        ]
        points[chosen] = place(points[np.array(margins)], topology.ring[chosen], low)


@lru_cache(maxsize=1)
def template() -> Template:
    """Return the template head; built once per process in about half a second."""
    topology = build_topology()
    skin = skin_points(topology)
    place_linings(skin, topology)
    skin[:, 0] *= np.where(topology.column < 0, -1.0, 1.0)
    skin[topology.column == 0, 0] = 0.0
    lined = topology.ring > 0
    part = np.where(
        lined & (topology.slit == SLIT_EYE),
        PART_EYE_LINING,
        np.where(lined & (topology.slit == SLIT_MOUTH), PART_MOUTH_LINING, PART_SKIN),
    )
    pieces, faces, parts = [skin], [topology.faces], [part]
    lows, angles = [topology.low], [np.full(len(skin), np.pi)]

    def add(
        points: Array, triangles: IntArray, label: int, low: NDArray[np.bool_], angle: Array
    ) -> None:
        faces.append(triangles + sum(len(p) for p in pieces))
        pieces.append(points)
        parts.append(np.full(len(points), label))
        lows.append(low)
        angles.append(angle)

    ear_points, ear_faces = ears.ear()
    ball_points, ball_faces, ball_angle = eyes.eyeball()
    for points, triangles, label, angle in (
        (ear_points, ear_faces, PART_EAR, np.full(len(ear_points), np.pi)),
        (ball_points, ball_faces, PART_EYEBALL, ball_angle),
    ):
        nowhere = np.zeros(len(points), dtype=bool)
        add(points, triangles, label, nowhere, angle)
        add(points * FLIP, triangles[:, ::-1], label, nowhere, angle)
    tooth_points, tooth_faces, tooth_low = teeth.teeth()
    add(tooth_points, tooth_faces, PART_TEETH, tooth_low, np.full(len(tooth_points), np.pi))

    points = np.concatenate(pieces)
    all_faces = np.ascontiguousarray(np.concatenate(faces), dtype=np.int32)
    all_faces.setflags(write=False)

    def padded(values: IntArray) -> IntArray:
        return np.concatenate([values, np.zeros(len(points) - len(values), dtype=np.int32)])

    return Template(
        points=points,
        faces=all_faces,
        part=np.concatenate(parts).astype(np.int32),
        low=np.concatenate(lows),
        row=padded(topology.row),
        column=padded(topology.column),
        slit=padded(topology.slit),
        ring=padded(topology.ring),
        eye_angle=np.concatenate(angles),
    )
