"""The template head: the mean adult, from which every subject is a displacement.

Built once a process from volumes (volumes.py), cast onto the grid (grid.py), with lids, lips, ears
and eyeballs (eyes.py, mouth.py, ears.py). Left and right are exact mirror images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural import ears, eyes, mouth, teeth
from glsim.faces.procedural.grid import (
    COLUMNS,
    EYE_KNOT,
    HALF_COLUMNS,
    MOUTH_KNOT,
    ROWS,
    knot_row,
    make_rays,
    row_table,
)
from glsim.faces.procedural.nose import nose_relief
from glsim.faces.procedural.sculpt import Array, IntArray, cast_to_surface, smoothstep
from glsim.faces.procedural.topology import (
    SLIT_EYE,
    SLIT_MOUTH,
    SkinTopology,
    build_topology,
)
from glsim.faces.procedural.volumes import EYE_CENTER, HEAD

PART_SKIN, PART_EYE_LINING, PART_MOUTH_LINING, PART_EAR, PART_EYEBALL, PART_TEETH = range(6)
SMOOTHING_PASSES = 8
FLIP = np.array([-1.0, 1.0, 1.0])  # mirror at the median plane


@dataclass(frozen=True, eq=False)
class Template:
    """The mean head and what each vertex is.

    points: (V, 3) float64 mm, canonical frame. faces: (F, 3) int32. part: (V,) PART_*.
    low: (V,) below the mouth's line, or on a lower lid. lid: (V,) +1 on an upper lid's margin or
    its lining, -1 on a lower one, 0 elsewhere. eye_angle: (V,) angle from an eyeball's axis (rad).
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
    """The (V, 3) skin of the left half at every vertex; the right half has its x negated after."""
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
    points = cast_to_surface(rays.origins, rays.directions, HEAD)
    front = front_of(points, -80.0, -29.0)
    points[front, 2] += mouth.lip_relief(points[front, 0], points[front, 1])
    near_nose = front_of(points, -29.5, 0.0)
    points[near_nose, 2] += nose_relief(points[near_nose, 0], points[near_nose, 1])
    near_eye = front_of(points, 0.0, 32.0)
    points[near_eye, 2] += eyes.lid_relief(
        points[near_eye, 0], points[near_eye, 1] - row_table()[knot_row(EYE_KNOT), 0]
    )
    return smooth_grid(points, topology)


def front_of(points: Array, low_y: float, high_y: float) -> NDArray[np.bool_]:
    """(V,) where the front of the face lies between two heights."""
    return np.asarray((points[:, 2] > -40) & (points[:, 1] > low_y) & (points[:, 1] < high_y))


def smooth_grid(points: Array, topology: SkinTopology) -> Array:
    """Takes the last edges off: smooths grid vertices (V, 3), hardly at lids, lips and nostrils.

    Half of the head, mirrored at the midlines; slit and ring vertices stay where they are.
    """
    grid = points[: ROWS * COLUMNS].reshape(ROWS, COLUMNS, 3)
    half = grid[:, : HALF_COLUMNS + 1].copy()
    x, y, z = half[..., 0], half[..., 1], half[..., 2]
    fine = smoothstep(24.0, 15.0, np.hypot(x - EYE_CENTER[0], y - EYE_CENTER[1])) * (z > -30)
    lips = (
        smoothstep(14.0, 9.0, np.abs(y - mouth.STOMION_Y)) * smoothstep(34.0, 28.0, x) * (z > -20)
    )
    nose = (
        0.75 * smoothstep(-38.0, -31.0, y) * smoothstep(30.0, 24.0, y) * smoothstep(24.0, 18.0, x)
    )
    rate = 0.5 * (1.0 - np.maximum.reduce([fine, lips, nose * (z > 0)]))[..., None]
    for _ in range(SMOOTHING_PASSES):
        wide = np.concatenate([half[:, 1:2] * FLIP, half, half[:, -2:-1] * FLIP], axis=1)
        tall = np.concatenate([half[:1], half, half[-1:]], axis=0)
        mean = 0.25 * (wide[:, :-2] + wide[:, 2:] + tall[:-2] + tall[2:])
        mean[0], mean[-1] = half[0], half[-1]
        half += rate * (mean - half)
    points = points.copy()
    points[: ROWS * COLUMNS] = half[:, np.abs(topology.column[:COLUMNS])].reshape(-1, 3)
    return points


def hang_linings(points: Array, topology: SkinTopology) -> None:
    """Moves the slits' inner rings of ``points`` (V, 3) to their places behind lids and lips."""
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
        hung = [
            margin.get((*k, bool(lo)), margin.get((*k, False)))
            for k, lo in zip(keys, low, strict=True)
        ]
        points[chosen] = place(points[np.array(hung)], topology.ring[chosen], low)


@lru_cache(maxsize=1)
def template() -> Template:
    """The template head (about half a second, once a process)."""
    topology = build_topology()
    skin = skin_points(topology)
    hang_linings(skin, topology)
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
