"""Identity fields of the skull and the cheeks (see identity.py)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tools.heads.falloff import Array, bump, smoothstep
from tools.heads.fields import Field, FieldPoints, front_weight, widen
from tools.heads.regions import hair_weight
from tools.heads.volumes import MENTON_Y, NASION_Y


def head_breadth(p: FieldPoints) -> Array:
    """Greatest width of the skull, eu-eu (mm)."""
    return widen(p, 75.0, smoothstep(0.0, 45.0, p.y) * smoothstep(10.0, -60.0, p.z))


def head_length(p: FieldPoints) -> Array:
    """Length from glabella to the back of the head, g-op (mm)."""
    return p.displacement(0, 0, -smoothstep(-40.0, -165.0, p.z) * smoothstep(-90.0, -10.0, p.y))


def head_height(p: FieldPoints) -> Array:
    """Height of the crown above the middle of the face (mm)."""
    return p.displacement(0, smoothstep(35.0, 132.0, p.y), 0)


def forehead_breadth(p: FieldPoints) -> Array:
    """Width of the forehead, ft-ft, relative to the mean (mm)."""
    return widen(p, 52.0, bump(p.y - 52, 26.0) * smoothstep(-75.0, -30.0, p.z))


def forehead_slope(p: FieldPoints) -> Array:
    """Backwards lean of the forehead (deg)."""
    above = p.y - 38.0
    above = 0.5 * (above + np.hypot(above, 14.0))  # max(above, 0) without its edge
    lean = above * smoothstep(-110.0, -10.0, p.z)
    return p.displacement(0, 0, -np.deg2rad(1.0) * lean)


def forehead_bulge(p: FieldPoints) -> Array:
    """Prominence of the frontal bosses (mm)."""
    return p.displacement(0, 0, p.gaussian((24, 62, 10), (34, 22, 50)))


def brow_ridge(p: FieldPoints) -> Array:
    """Prominence of the supraorbital ridge (mm)."""
    medial, lateral = p.gaussian((15, 35, 15), (17, 10, 22)), p.gaussian((40, 36, 0), (16, 10, 22))
    return p.displacement(
        0, 0, 1.0 * np.maximum(medial, 0.7 * lateral) + 0.35 * p.gaussian((0, 36, 18), (9, 9, 20))
    )


def brow_height(p: FieldPoints) -> Array:
    """Height of the brow above the eye (mm)."""
    return p.displacement(0, p.gaussian((30, 34, 6), (30, 10, 30)), 0)


def temple_hollow(p: FieldPoints) -> Array:
    """Depth of the temporal fossa (mm)."""
    return p.displacement(-p.gaussian((60, 38, -38), (22, 20, 24)), 0, 0)


def face_breadth(p: FieldPoints) -> Array:
    """Bizygomatic width, zy-zy (mm)."""
    weight = bump(p.y + 8, 44.0) * smoothstep(-125.0, -70.0, p.z)
    return widen(p, 67.5, weight * smoothstep(8.0, 45.0, p.x))


def face_height(p: FieldPoints) -> Array:
    """Height from nasion to the underside of the chin, n-gn (mm)."""
    span = NASION_Y - MENTON_Y
    share = np.clip((NASION_Y - p.y) / span, 0.0, 1.0)
    return p.displacement(0, -share * smoothstep(-150.0, -105.0, p.y) * front_weight(p), 0)


def midface_depth(p: FieldPoints) -> Array:
    """Prominence of nose and upper jaw (mm)."""
    weight = bump(p.y + 14, 34.0) * smoothstep(62.0, 12.0, p.x) * front_weight(p)
    return p.displacement(0, 0, weight)


def cheekbone(p: FieldPoints) -> Array:
    """Forward prominence of the zygoma (mm)."""
    weight = p.gaussian((45, -8, -8), (19, 15, 28))
    return p.displacement(0.5 * weight, 0.0, 0.85 * weight)


def cheek_fullness(p: FieldPoints) -> Array:
    """Thickness of buccal fat (mm)."""
    weight = p.gaussian((43, -30, -16), (20, 26, 30))
    return p.displacement(0.8 * weight, -0.1 * weight, 0.6 * weight)


def jowl(p: FieldPoints) -> Array:
    """Sag of the cheek over the jaw, beside the chin (mm)."""
    weight = p.gaussian((35, -74, -12), (14, 13, 20))
    return p.displacement(0.55 * weight, -0.55 * weight, 0.35 * weight)


def nasolabial_fold(p: FieldPoints) -> Array:
    """Depth of the fold from the wing of the nose to beside the corner of the mouth (mm)."""
    y = np.clip(p.y, -54.0, -20.0)
    x = np.interp(-y, (20.0, 30.0, 42.0, 54.0), (19.0, 24.0, 31.5, 34.0))
    along = smoothstep(-55.0, -38.0, p.y) * smoothstep(-15.0, -28.0, p.y) * (p.z > -30)
    furrow = -0.8 * bump(p.x - x, 3.6) + 0.8 * bump(p.x - x - 8.5, 7.0)
    return p.displacement(0, 0, along * furrow)


def facial_fat(p: FieldPoints) -> Array:
    """Thickness of subcutaneous fat of cheeks, jaw and throat (mm)."""
    cheeks = p.gaussian((46, -34, -26), (26, 36, 38))
    throat = p.gaussian((18, -98, -28), (34, 16, 34))
    lids = 0.35 * p.gaussian((34, 26, 0), (18, 7, 20))
    return (cheeks + 1.3 * throat + lids)[:, None] * p.normals


def hair_volume(p: FieldPoints) -> Array:
    """Thickness of the hair cap; 0 is bald (mm)."""
    top = 1.0 + 0.5 * smoothstep(60.0, 130.0, p.y)
    share = hair_weight(p.points, 24.0) * smoothstep(-75.0, 20.0, p.y) * top
    share = share * (1 - 0.75 * bump(p.z + 85, 16.0) * smoothstep(40.0, 20.0, p.y))
    return share[:, None] * p.normals


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
        midface_depth,
        cheekbone,
        cheek_fullness,
        nasolabial_fold,
        facial_fat,
        jowl,
        hair_volume,
    )
}
