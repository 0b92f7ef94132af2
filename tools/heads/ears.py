"""The ear mesh: a polar sheet with helix, antihelix, concha, tragus and lobule, and a back side.

Millimetres. Farkas 1994: ear length sa-sba 62, width pra-pa 35, protrusion 20-25 degrees,
inclination of the long axis about 15-20 degrees.
"""

from __future__ import annotations

import numpy as np

from glsim.core.products import product
from tools.heads.falloff import Array, IntArray, bump, smoothstep

EAR_ROOT = (67.5, -1.0, -78.0)  # the front attachment, level with the ear's middle
EAR_LENGTH, EAR_WIDTH = 62.0, 34.0
PROTRUSION_DEG, INCLINATION_DEG = 24.0, 12.0
SECTORS = 36
# Front sheet: radius of each ring. Back sheet: radius and offset (mm, negative: behind) of each.
FRONT_RADII = (0.0, 0.16, 0.3, 0.42, 0.52, 0.61, 0.7, 0.78, 0.86, 0.93, 0.98, 1.0)
BACK_RINGS = ((0.97, -3.5), (0.85, -6.0), (0.62, -9.0), (0.45, -16.0))


def outline(turn: Array) -> tuple[Array, Array]:
    """Return the ear's rim in its plane: (back, up) in mm at angle ``turn`` (0 back, pi/2 up)."""
    low, high = smoothstep(0.0, -0.9, np.sin(turn)), smoothstep(0.1, 1.0, np.sin(turn))
    round_end = np.sign(np.cos(turn)) * np.abs(np.cos(turn)) ** 0.72
    back = EAR_WIDTH / 2 * (np.cos(turn) + low * (0.62 * round_end - np.cos(turn)))
    back = back - 2.5 * low + 2.0 * high
    up = np.sin(turn) * EAR_LENGTH / 2
    return back, up


def ear_offset(radius: Array, turn: Array) -> Array:
    """Return the height of the front sheet above the ear's plane (mm) in polar coordinates."""
    upper = smoothstep(-0.75, -0.2, np.sin(turn))  # the lobule has no helix
    front = smoothstep(0.2, 0.9, -np.cos(turn))
    helix = (3.2 * upper + 0.8) * bump(radius - 0.93, 0.10) * (1 - 0.5 * front)
    scapha = -1.8 * upper * bump(radius - 0.77, 0.10) * (1 - front)
    antihelix = (
        2.8 * bump(radius - 0.58, 0.12) * (1 - front) * smoothstep(-0.98, -0.6, np.sin(turn))
    )
    concha = -8.5 * smoothstep(0.55, 0.15, radius)
    tragus = 4.0 * bump(radius - 0.66, 0.16) * bump(np.sin(turn) + 0.12, 0.30) * front
    return helix + scapha + antihelix + concha + tragus


def ear() -> tuple[Array, IntArray]:
    """Build the left ear: vertices (V, 3) on the template head, triangles (F, 3)."""
    turn = np.arange(SECTORS) * 2 * np.pi / SECTORS
    back, up = outline(turn)
    rows = [np.stack([0 * turn, 0 * turn, ear_offset(0 * turn, turn)], 1)[:1]]
    for radius in FRONT_RADII[1:]:
        center_back, center_up = -2.0 * (1 - radius), -3.0 * (1 - radius)
        rows.append(
            np.stack(
                [center_back + radius * back, center_up + radius * up,
                 ear_offset(np.full_like(turn, radius), turn)], 1
            )
        )  # fmt: skip
    for radius, offset in BACK_RINGS:
        rows.append(np.stack([radius * back - 2 * (1 - radius), radius * up, 0 * turn + offset], 1))
    local = np.concatenate(rows)
    local[:, 0] += EAR_WIDTH / 2  # the hinge is the front edge
    local[:, 2] += 1.5
    a, b = np.deg2rad(PROTRUSION_DEG), np.deg2rad(INCLINATION_DEG)
    tilt = np.array([[np.cos(b), np.sin(b)], [-np.sin(b), np.cos(b)]])
    plane = product(local[:, :2], tilt)
    back_axis = np.array([np.sin(a), 0.0, -np.cos(a)])
    out_axis = np.array([np.cos(a), 0.0, np.sin(a)])
    points = np.asarray(EAR_ROOT) + plane[:, :1] * back_axis + local[:, 2:] * out_axis
    points[:, 1] += plane[:, 1]
    count = len(FRONT_RADII) - 1 + len(BACK_RINGS)
    index = 1 + np.arange(count * SECTORS).reshape(count, SECTORS)
    after = np.roll(index, -1, axis=1)
    fan = np.stack([0 * index[0], index[0], after[0]], axis=1)
    inner, outer = index[:-1].ravel(), index[1:].ravel()
    inner2, outer2 = after[:-1].ravel(), after[1:].ravel()
    faces = np.concatenate(
        [fan, np.stack([inner, outer, outer2], 1), np.stack([inner, outer2, inner2], 1)]
    )
    return points, faces.astype(np.int32)
