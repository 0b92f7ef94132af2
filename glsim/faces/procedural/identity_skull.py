"""The skull and the cheeks: identity fields (see identity.py)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from glsim.faces.procedural.fields import Canvas, Field, front_share, widen
from glsim.faces.procedural.regions import hair_share
from glsim.faces.procedural.sculpt import Array, bump, smoothstep
from glsim.faces.procedural.volumes import MENTON_Y, NASION_Y


def head_breadth(c: Canvas) -> Array:
    """eu-eu, the greatest width of the skull (mm)."""
    return widen(c, 75.0, smoothstep(0.0, 45.0, c.y) * smoothstep(10.0, -60.0, c.z))


def head_length(c: Canvas) -> Array:
    """g-op, glabella to the back of the head (mm)."""
    return c.vector(0, 0, -smoothstep(-40.0, -165.0, c.z) * smoothstep(-90.0, -10.0, c.y))


def head_height(c: Canvas) -> Array:
    """Crown above the middle of the face (mm)."""
    return c.vector(0, smoothstep(35.0, 132.0, c.y), 0)


def forehead_breadth(c: Canvas) -> Array:
    """ft-ft against the mean (mm)."""
    return widen(c, 52.0, bump(c.y - 52, 26.0) * smoothstep(-75.0, -30.0, c.z))


def forehead_slope(c: Canvas) -> Array:
    """Backwards lean of the forehead (deg)."""
    lean = np.maximum(c.y - 38.0, 0.0) * smoothstep(-110.0, -10.0, c.z)
    return c.vector(0, 0, -np.deg2rad(1.0) * lean)


def forehead_bulge(c: Canvas) -> Array:
    """Frontal bosses (mm)."""
    return c.vector(0, 0, c.near((24, 62, 10), (34, 22, 50)))


def brow_ridge(c: Canvas) -> Array:
    """Prominence of the supraorbital ridge (mm)."""
    medial, lateral = c.near((15, 35, 15), (17, 10, 22)), c.near((40, 36, 0), (16, 10, 22))
    return c.vector(
        0, 0, 1.0 * np.maximum(medial, 0.7 * lateral) + 0.35 * c.near((0, 36, 18), (9, 9, 20))
    )


def brow_height(c: Canvas) -> Array:
    """Height of the brow above the eye (mm)."""
    return c.vector(0, c.near((30, 34, 6), (30, 10, 30)), 0)


def temple_hollow(c: Canvas) -> Array:
    """Depth of the temporal fossa (mm)."""
    return c.vector(-c.near((60, 38, -38), (22, 20, 24)), 0, 0)


def face_breadth(c: Canvas) -> Array:
    """zy-zy, bizygomatic width (mm)."""
    weight = bump(c.y + 8, 44.0) * smoothstep(-125.0, -70.0, c.z)
    return widen(c, 67.5, weight * smoothstep(8.0, 45.0, c.x))


def face_height(c: Canvas) -> Array:
    """n-gn, nasion to the underside of the chin (mm)."""
    span = NASION_Y - MENTON_Y
    share = np.clip((NASION_Y - c.y) / span, 0.0, 1.0)
    return c.vector(0, -share * smoothstep(-150.0, -105.0, c.y) * front_share(c), 0)


def cheekbone(c: Canvas) -> Array:
    """Forward prominence of the zygoma (mm)."""
    weight = c.near((45, -8, -8), (19, 15, 28))
    return c.vector(0.5 * weight, 0.0, 0.85 * weight)


def cheek_fullness(c: Canvas) -> Array:
    """Buccal fat (mm)."""
    weight = c.near((43, -30, -16), (20, 26, 30))
    return c.vector(0.8 * weight, -0.1 * weight, 0.6 * weight)


def nasolabial_fold(c: Canvas) -> Array:
    """A furrow from the wing of the nose to beside the corner of the mouth."""
    y = np.clip(c.y, -54.0, -20.0)
    x = np.interp(-y, (20.0, 30.0, 42.0, 54.0), (19.0, 24.0, 31.5, 34.0))
    along = smoothstep(-55.0, -38.0, c.y) * smoothstep(-15.0, -28.0, c.y) * (c.z > -30)
    furrow = -0.8 * bump(c.x - x, 3.6) + 0.8 * bump(c.x - x - 8.5, 7.0)
    return c.vector(0, 0, along * furrow)


def facial_fat(c: Canvas) -> Array:
    """Subcutaneous fat of cheeks, jaw and throat (mm)."""
    cheeks = c.near((46, -34, -26), (26, 36, 38))
    throat = c.near((18, -98, -28), (34, 16, 34))
    lids = 0.35 * c.near((34, 26, 0), (18, 7, 20))
    return (cheeks + 1.3 * throat + lids)[:, None] * c.normals


def hair_volume(c: Canvas) -> Array:
    """Thickness of the hair cap; 0 is bald (mm)."""
    top = 1.0 + 0.5 * smoothstep(60.0, 130.0, c.y)
    share = hair_share(c.points, 24.0) * smoothstep(-75.0, 20.0, c.y) * top
    share = share * (1 - 0.75 * bump(c.z + 85, 16.0) * smoothstep(40.0, 20.0, c.y))
    return share[:, None] * c.normals


FIELDS: Mapping[str, Field] = {
    field.__name__: field
    for field in (
        head_breadth,
        head_length,
        head_height,
        forehead_breadth,
        forehead_slope,
        forehead_bulge,
        brow_ridge,
        brow_height,
        temple_hollow,
        face_breadth,
        face_height,
        cheekbone,
        cheek_fullness,
        nasolabial_fold,
        facial_fat,
        hair_volume,
    )
}
