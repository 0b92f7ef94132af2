"""Eyes: the lid margins, the thickness of the lids, and the eyeballs.

Millimetres, subject's left eye (mirrored for the right one).
"""

from __future__ import annotations

import numpy as np

from glsim.faces.procedural.lids import EYE_RADIUS, LID_REACH_ROWS, LID_THICKNESS
from tools.heads.falloff import Array, IntArray, bump, smoothstep
from tools.heads.volumes import EYE_CENTER

CANTHUS_X = (17.05, 45.9)  # medial, lateral; Farkas 1994: en-en 33, ex-ex 91
CANTHUS_Y = (-1.3, 0.8)  # relative to the slit's row; the eye tilts outwards by about 4 deg
UPPER_LID = 4.9  # mm above the line between the corners (fissure height 10.5, Farkas ps-pi)
LOWER_LID = 5.0
IRIS_RADIUS = 5.9  # mm; white-to-white 11.7, Ruefer et al. 2005
PUPIL_RADIUS = 2.0
EYEBALL_RINGS, EYEBALL_SECTORS = 13, 28


def lid_lines(x: Array) -> tuple[Array, Array]:
    """Return heights (N,) of the upper and lower lid margin above the slit's row, at ``x`` (N,)."""
    s = np.clip((x - CANTHUS_X[0]) / (CANTHUS_X[1] - CANTHUS_X[0]), 0.0, 1.0)
    chord = CANTHUS_Y[0] + s * (CANTHUS_Y[1] - CANTHUS_Y[0])
    chord = chord * smoothstep(6.0, 14.0, x) * smoothstep(62.0, 50.0, x)
    peak_up, peak_low = s**0.86, s**1.12  # the upper lid peaks medially, the lower laterally
    up = UPPER_LID * (4 * peak_up * (1 - peak_up)) ** 0.72
    low = LOWER_LID * (4 * peak_low * (1 - peak_low)) ** 0.80
    return chord + up, chord - low


def open_lids(x: Array, rows_below: Array, low: np.ndarray) -> Array:
    """Return the y displacement (N,) of grid vertices that opens the slit to the fissure (mm).

    Args:
        rows_below: (N,) rows below the slit's row (negative above it).
    """
    up, down = lid_lines(x)
    target = np.where(low | (rows_below > 0), down, up)
    return np.asarray(target * bump(rows_below, LID_REACH_ROWS))


def lid_offset(x: Array, above: Array) -> Array:
    """Return the z offset (N,) of the skin at the lid creases (mm).

    The upper crease is about 5 mm above the margin and fades inwards, the lower is shallow.

    Args:
        above: (N,) y relative to the slit's row.
    """
    up, low = lid_lines(x)
    s = (x - CANTHUS_X[0]) / (CANTHUS_X[1] - CANTHUS_X[0])
    fade = smoothstep(-0.15, 0.25, s) * smoothstep(1.30, 0.85, s)
    upper = -0.9 * bump(above - up - 4.6, 1.3) + 0.5 * bump(above - up - 7.4, 2.2)
    lower = -0.5 * bump(above - low + 5.5, 1.6)
    return np.asarray(fade * (upper + lower))


def lid_rings(margin: Array, ring: IntArray, low: np.ndarray) -> Array:
    """Return positions (N, 3) of the rings behind the lids, from their margin vertices (N, 3).

    Ring 1 is the inner edge of the margin, on the globe; ring 2 is hidden behind the lid.
    """
    center = np.asarray(EYE_CENTER)
    away = margin - center
    distance = np.linalg.norm(away, axis=1)
    depth = np.maximum(distance - (EYE_RADIUS + 0.25), 0.0)
    depth = np.minimum(depth, LID_THICKNESS)  # the corners stay shallow
    inner = margin - away / distance[:, None] * depth[:, None]
    up = np.where(low, -1.0, 1.0)
    corner = smoothstep(0.0, 4.0, margin[:, 0] - CANTHUS_X[0])
    corner *= smoothstep(0.0, 4.0, CANTHUS_X[1] - margin[:, 0])
    hidden = inner + np.stack([0 * up, 1.2 * up * corner, -1.6 - 1.2 * corner], axis=1)
    return np.asarray(np.where((ring == 1)[:, None], inner, hidden))


def eyeball() -> tuple[Array, IntArray, Array]:
    """Build the front of the left eyeball: vertices (V, 3), triangles (F, 3), axis angles (V,).

    Two of its rings lie on the edges of the pupil and of the iris.
    """
    iris = np.arcsin(IRIS_RADIUS / EYE_RADIUS)
    pupil = np.arcsin(PUPIL_RADIUS / EYE_RADIUS)
    knots = np.array([0.0, 0.5 * pupil, pupil, pupil + 0.06, 0.6 * iris, iris, iris + 0.06])
    angle = np.concatenate(
        [knots, np.linspace(iris + 0.06, np.deg2rad(105), EYEBALL_RINGS - 6)[1:]]
    )
    turn = np.arange(EYEBALL_SECTORS) * 2 * np.pi / EYEBALL_SECTORS
    a, t = np.meshgrid(angle[1:], turn, indexing="ij")
    cornea = 1.0 + 0.035 * smoothstep(iris + 0.1, 0.5 * iris, a)  # mm/mm; bulge about 0.4 mm
    unit = np.stack([np.sin(a) * np.cos(t), np.sin(a) * np.sin(t), np.cos(a)], axis=-1)
    points = (EYE_RADIUS * cornea[..., None] * unit).reshape(-1, 3)
    points = np.concatenate([[[0.0, 0.0, 1.035 * EYE_RADIUS]], points]) + np.asarray(EYE_CENTER)
    rings = len(angle) - 1
    index = 1 + np.arange(rings * EYEBALL_SECTORS).reshape(rings, EYEBALL_SECTORS)
    after = np.roll(index, -1, axis=1)
    fan = np.stack([0 * index[0], index[0], after[0]], axis=1)
    inner, outer = index[:-1].ravel(), index[1:].ravel()
    inner2, outer2 = after[:-1].ravel(), after[1:].ravel()
    faces = np.concatenate(
        [fan, np.stack([inner, outer, outer2], 1), np.stack([inner, outer2, inner2], 1)]
    )
    return points, faces.astype(np.int32), np.concatenate([[0.0], a.ravel()])
