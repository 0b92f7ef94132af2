"""Identity fields of the nose and the surroundings of the eyes (see identity.py)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tools.heads.falloff import Array, bump, smoothstep
from tools.heads.fields import Field, FieldPoints, front_weight, widen
from tools.heads.volumes import NASION_Y, SUBNASALE_Y


def nose_height(p: FieldPoints) -> Array:
    """Height of the nose, n-sn (mm)."""
    share = smoothstep(NASION_Y, SUBNASALE_Y, p.y) * smoothstep(-90.0, -45.0, p.y)
    return p.displacement(0, -share * smoothstep(52.0, 14.0, p.x) * front_weight(p), 0)


def nose_protrusion(p: FieldPoints) -> Array:
    """Protrusion of the nose tip, sn-prn (mm)."""
    share = np.interp(p.y, (-30.5, -27.0, -20.0, 26.0), (0.0, 0.4, 1.0, 0.0))
    height = smoothstep(19.0, 39.0, p.z + 0.30 * np.maximum(p.y + 20, 0))
    return p.displacement(0, 0, share * (0.25 + 0.75 * height) * smoothstep(22.0, 6.0, p.x))


def nose_breadth(p: FieldPoints) -> Array:
    """Width across the wings, al-al (mm)."""
    weight = bump(p.y + 22, 12.0) * smoothstep(34.0, 19.0, p.x) * (p.z > -20)
    return widen(p, 17.3, weight)


def nose_hump(p: FieldPoints) -> Array:
    """Height of the dorsum at its middle (mm)."""
    return p.displacement(0, 0, p.gaussian((0, 4, 24), (8.5, 13, 18)))


def nose_root(p: FieldPoints) -> Array:
    """Depth of the sellion (mm)."""
    return p.displacement(0, 0, -p.gaussian((0, 23, 14), (9, 9, 20)))


def nose_bridge_breadth(p: FieldPoints) -> Array:
    """Width of the bony bridge (mm)."""
    weight = p.gaussian((8, 6, 16), (7, 17, 16))
    return p.displacement(0.6 * weight, 0, 0)


def nose_tip_breadth(p: FieldPoints) -> Array:
    """Width of the lobule (mm)."""
    weight = p.gaussian((6, -18, 34), (6, 8, 10))
    return p.displacement(0.6 * weight, 0, -0.1 * weight)


def nose_tip_lift(p: FieldPoints) -> Array:
    """Height of the tip (nasolabial angle) (mm)."""
    weight = p.gaussian((0, -20, 37), (12, 11, 13))
    return p.displacement(0, weight, 0.15 * weight)


def nose_deviation(p: FieldPoints) -> Array:
    """Lateral deviation of the nose (mm)."""
    weight = np.interp(p.y, (-30, -18, 20), (0.4, 1.0, 0.0)) * smoothstep(20.0, 6.0, p.x)
    weight = weight * (p.z > 0)
    return np.stack([weight, 0 * weight, 0 * weight], axis=1)


def interocular(p: FieldPoints) -> Array:
    """Distance between the inner corners of the eyes, en-en (mm)."""
    weight = bump(p.y - 17, 20.0) * smoothstep(3.0, 16.0, p.x) * smoothstep(75.0, 44.0, p.x)
    return p.displacement(0.5 * weight * front_weight(p), 0, 0)


def eye_depth(p: FieldPoints) -> Array:
    """Depth of the eyeball behind the orbital rim (mm)."""
    return p.displacement(0, 0, -p.gaussian((33, 14, 2), (25, 21, 36)))


def lid_hood(p: FieldPoints) -> Array:
    """Fullness above the upper lid (mm)."""
    weight = p.gaussian((36, 25, 2), (15, 5.0, 20))
    return p.displacement(0, -0.35 * weight, 0.9 * weight)


def tear_trough(p: FieldPoints) -> Array:
    """Depth of the furrow under the lower lid (mm)."""
    x = np.clip(p.x, 17.0, 42.0)
    y = 3.5 - 5.0 * np.sin(np.pi * (x - 17.0) / 50.0)
    weight = bump(p.y - y, 3.0) * bump(p.x - 27, 10.0) * (p.z > -25)
    return p.displacement(0, 0, -1.2 * weight)


def eye_bag(p: FieldPoints) -> Array:
    """Bulge under the lower lid (mm)."""
    return p.displacement(0, -0.2 * (w := p.gaussian((31, 1, 6), (13, 5.0, 18))), 0.9 * w)


def eye_level_asymmetry(p: FieldPoints) -> Array:
    """Height of the left eye above the right (mm)."""
    weight = bump(p.y - 17, 20.0) * smoothstep(8.0, 22.0, p.x) * front_weight(p)
    return p.displacement(0, 0.5 * p.side * weight, 0)


FIELDS: Mapping[str, Field] = {
    field.__name__: field
    for field in (
        nose_height,
        nose_protrusion,
        nose_breadth,
        nose_hump,
        nose_root,
        nose_bridge_breadth,
        nose_tip_breadth,
        nose_tip_lift,
        nose_deviation,
        interocular,
        eye_depth,
        lid_hood,
        tear_trough,
        eye_bag,
        eye_level_asymmetry,
    )
}
